"""The inverse of N = R^T R where R is not zero: what the cofactors of observations need, and no more.

From R N^-1 = R^-T, panel by panel from the last one on: what a panel needs of N^-1 has been computed by then
(Takahashi, Fagan and Chen 1973; Erisman and Tinney 1975, *On computing certain elements of the inverse of a sparse
matrix*).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg.lapack import dtrtrs

from orip.arrays import BoolArray, FloatArray
from orip.sequential.panels import Panel, pivotal


def cofactors_in_band(factor: FloatArray, panels: Sequence[Panel], determined: BoolArray) -> FloatArray:
    """Return N^-1 (n, n) for the unknowns that a row of R has in common; elsewhere it is zero.

    Parameters
    ----------
    factor : array (n or more, n or more)
        R.
    panels : sequence of Panel
        All its rows.
    determined : array (n,) of bool
        The unknowns that are not held.
    """
    found, end, reaching = np.zeros((len(determined), len(determined))), 0, []
    for panel in panels:
        # what a row has in common, all rows below it have that have one of both
        end = max(end, panel.end)
        reaching.append(panel._replace(end=end))
    for panel in reversed(reaching):
        own, beyond = slice(panel.first, panel.last), slice(panel.last, panel.end)
        block, across = pivotal(factor[own, own]), factor[own, beyond]
        found[own, beyond] = -dtrtrs(block, across @ found[beyond, beyond])[0]
        found[beyond, own] = found[own, beyond].T
        inverse = dtrtrs(block, np.diag(determined[own].astype(np.float64)), trans=1)[0]
        found[own, own] = dtrtrs(block, inverse - across @ found[beyond, own])[0]
    return found
