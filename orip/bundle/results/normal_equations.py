"""The normal equations of an adjustment, with the names of its unknowns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array

from orip.arrays import BoolArray, FloatArray
from orip.bundle.solve import SolvedBlock


class NormalEquations(NamedTuple):
    """N dx = n at the solution, for sigma0 = 1.

    Attributes
    ----------
    names : tuple of n str
        ``camera C35.C``, ``photo 102.X0``, ``point CP3.Z``; without unknowns that are constant.
    matrix : csr_array (n, n)
        A^T W A, where rows of A are divided by their a-priori errors, and W has the weight factors. Lengths are in
        ground units, camera parameters in mm and powers of it. OMEGA, PHI and KAPPA are small rotations about the axes
        X, Y and Z of the adjustment's system, radians; coordinates with a `crs` those of the local frame.
    right : array (n,)
        -A^T W v: nearly zero where the adjustment has converged.
    removed : array (n,) of bool
        Unknowns that nothing determines, and that were held at their values.
    square_sum : float
        v^T W v.
    """

    names: tuple[str, ...]
    matrix: csr_array
    right: FloatArray
    removed: BoolArray
    square_sum: float


def normal_equations(solved: SolvedBlock) -> NormalEquations:
    """Return the normal equations of an adjusted block; exactly met constants are no part of them."""
    equations = solved.equations
    weight = np.where(equations.active & ~equations.exact, solved.weight_factors, 0.0)
    named = [(column, name) for column, name in enumerate(solved.problem.unknowns.names) if name is not None]
    columns = np.array([column for column, _ in named if not solved.problem.layout.fixed[column]], dtype=np.int64)
    names = tuple(
        f"{name.group.lower()} {name.name}.{name.kind}"
        for column, name in named
        if not solved.problem.layout.fixed[column]
    )
    design = csr_array(equations.design[:, columns])
    weighted = diags_array(weight) @ equations.residual
    matrix = csr_array(design.T @ diags_array(weight) @ design)
    return NormalEquations(
        names, matrix, -(design.T @ weighted), solved.normals.removed[columns], float(equations.residual @ weighted)
    )
