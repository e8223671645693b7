"""How many digits a system of normal equations costs: what tolerances of its solution are derived from.

Forming and solving N dx = r in another order of summation changes dx / sd and the cofactors by some rounding errors
times the condition of N (Higham 2002, theorem 10.4). No diagonal scaling improves on columns of equal length by more
than the number of unknowns (van der Sluis 1969), so that this condition belongs to the block, not to its units.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.adjustment.equations import Equations

EPSILON = float(np.finfo(np.float64).eps)


def condition_of_normals(equations: Equations, weights: NDArray[np.float64], used: NDArray[np.bool_]) -> float:
    """Return the condition of the normal equations with a diagonal of ones.

    It is taken from the singular values of the design matrix, which are exact where N itself has lost digits already.

    Parameters
    ----------
    equations : Equations
        With the stored design matrix.
    weights : array (n,)
        Weight factors.
    used : array (u,) of bool
        Unknowns that are neither fixed nor removed.
    """
    root = np.sqrt(np.where(equations.active, weights, 0.0))
    columns = (equations.design.toarray() * root[:, None])[:, used]
    singular_values = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)
    return float((singular_values[0] / singular_values[-1]) ** 2)
