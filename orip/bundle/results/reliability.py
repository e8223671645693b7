"""Reliability: the smallest error that a test detects, its effect on the points, and photo points without influence."""

from __future__ import annotations

import numpy as np
from msgspec.structs import astuple

from orip.adjustment.precision import residual_cofactor
from orip.arrays import BoolArray, parts
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.solve import SolvedBlock
from orip.records.results.solution import Reliability, Residuals, Solution
from orip.set_aside import set_aside
from orip.threads import by_threads

# One may be a blunder. Where most rays of a photo or of the control points are lost, the solution is not that of the
# block that was measured, however well the rest fits.


_MOST = 0.5


def lost_rays(solved: SolvedBlock) -> BoolArray:
    """Return which of the block's photo points (n,) are used, but lie behind their camera."""
    start = 0
    for kind in solved.problem.observations:
        rows = slice(start, start + len(kind.rows.used))
        start = rows.stop
        if isinstance(kind, PhotoPointObservations):
            active = solved.equations.active[rows]
            if active.all():  # mostly
                return np.zeros(len(kind.point), dtype=bool)
            idle = kind.rows.used & ~active
            if solved.problem.excluded is not None:
                idle &= ~solved.problem.excluded[rows]
            return np.asarray(idle.reshape(-1, 2).any(axis=1))
    return np.zeros(0, dtype=bool)


def lost_control(solved: SolvedBlock) -> tuple[str, ...]:
    """Return the control points none of whose used rays has an influence; empty unless they are the majority."""
    block, lost = solved.block, lost_rays(solved)
    if not lost.any():
        return ()
    points = block.photo_points
    used = points.partly_in_use
    rays = np.bincount(points.point[used], minlength=len(block.point_names))
    gone = np.bincount(points.point[lost], minlength=len(block.point_names))
    place = block.point_index()
    control = [point.name for point in block.control_points if point.kind == "control" and rays[place[point.name]]]
    found = tuple(name for name in control if gone[place[name]] == rays[place[name]])
    return found if len(found) > _MOST * len(control) else ()


def lost_photos(solved: SolvedBlock) -> tuple[str, ...]:
    """Return the photos behind which most of their points lie."""
    block, lost = solved.block, lost_rays(solved)
    if not lost.any():
        return ()
    points = block.photo_points
    used = np.bincount(points.photo[points.partly_in_use], minlength=len(block.photos))
    gone = np.bincount(points.photo[lost], minlength=len(block.photos))
    return tuple(photo.name for row, photo in enumerate(block.photos) if gone[row] > _MOST * used[row])


NON_CENTRALITY = 4.132
"""Shift of a normalised residual that a test with error probability 0.001 finds with probability 0.80 (Baarda 1968)."""

_TESTABLE = 1e-6


def reliability(residuals: Residuals, deviation_scale: float) -> Reliability:
    """Return the reliability of observations from their redundancy numbers.

    Parameters
    ----------
    residuals : Residuals
    deviation_scale : float
        sigma0, or 1 without redundancy.

    Returns
    -------
    Reliability
        Internal: 4.13 a sqrt(q) / r, with a the a-priori error and q = var(v) / a² (`residual_cofactor`). External:
        4.13 wf sqrt(h q) / r, the influence of such an error on any function of the unknowns, in units of its standard
        deviation, with h = (1 - r) / wf. With full weight they are 4.13 a / sqrt(r) and 4.13 sqrt((1 - r) / r). The
        deviation of the adjusted observation is sigma0 a sqrt(h).
    """
    found = Reliability(*np.empty((3, len(residuals.redundancy_number))))

    def put(part: slice) -> None:
        number, weight_factor = residuals.redundancy_number[part], residuals.weight_factor[part]
        a_priori = residuals.a_priori[part]
        testable = np.where(number > _TESTABLE, number, np.nan)
        share = np.clip(1.0 - number, 0.0, None)
        factor = np.where(weight_factor > 0.0, weight_factor, np.nan)
        # the figures of an adjustment that diverged may overflow; they are printed as they are
        with np.errstate(over="ignore", invalid="ignore"):
            detected = NON_CENTRALITY * np.sqrt(residual_cofactor(testable, factor)) / testable
            np.multiply(a_priori, detected, out=found.minimal_detectable_bias[part])
            np.multiply(detected, np.sqrt(factor * share), out=found.external[part])
            np.multiply(deviation_scale * a_priori, np.sqrt(share / factor), out=found.adjusted_sd[part])

    by_threads(put, parts(len(residuals.redundancy_number)))
    return Reliability(*map(set_aside, astuple(found)))


def reliability_of(solution: Solution) -> Reliability:
    """Return the reliability of the observations of a solution."""
    return reliability(solution.residuals, solution.sigma0 if np.isfinite(solution.sigma0) else 1.0)
