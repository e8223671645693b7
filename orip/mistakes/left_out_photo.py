"""How the other photos would fit without one of them, from the adjustment with all: by one linear step."""

from __future__ import annotations

import numpy as np

from orip.adjustment.residual_sums import joint_effects
from orip.bundle.solve import SolvedBlock

_LARGEST_SIGMA0 = 6.0
"""sigma0 of the others above which a complete adjustment without the photo is not worth its time: three times that of a
block that fits. Where a photo was to blame, it was below 2 in all trials."""


def may_fit_without(solved: SolvedBlock, photo: str) -> bool:
    """Tell whether the other photos may fit when one is left out; not known where the adjustment has not converged."""
    return not solved.converged or not sigma0_without(solved, photo) > _LARGEST_SIGMA0


def sigma0_without(solved: SolvedBlock, photo: str) -> float:
    """Return sigma0 of the observations with full weight when those of a photo are left out, to the first order.

    The square sum falls by v^T (I - H)^-1 v; see `orip.adjustment.residual_sums`. NaN where the photo has no
    observation with full weight, or nothing checks the others.

    Parameters
    ----------
    solved : SolvedBlock
    photo : str
        Its name.
    """
    points, equations = solved.block.photo_points, solved.equations
    row = [record.name for record in solved.block.photos].index(photo)
    full = equations.active & (solved.weight_factors >= 1.0)
    # photo points are the first kind of observation
    mine = np.flatnonzero(full[: points.xy.size] & np.repeat(points.photo == row, 2))
    if not len(mine):
        return np.nan
    effects = joint_effects(equations, solved.normals, solved.problem.layout, mine)
    fall, checked = effects.square_sum_changes(np.arange(len(mine))[None])
    redundancy = solved.variance.redundancy_used - float(checked[0])
    square_sum = float(equations.residual[full] @ equations.residual[full]) - float(fall[0])
    return float(np.sqrt(max(square_sum, 0.0) / redundancy)) if redundancy > 0.0 else np.nan
