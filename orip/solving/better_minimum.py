"""Whether an adjustment ended where it should, and which of two adjustments of a block ended at the better minimum."""

from __future__ import annotations

import numpy as np

from orip.adjustment.convergence import TerminationReason
from orip.arrays import BoolArray
from orip.bundle.results.ground import undetermined_photos
from orip.bundle.results.reliability import lost_rays
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.records.block import Block
from orip.records.observation_kinds import CONTROL_POINT
from orip.structs import replace
from orip.wording import agreeing, counted, counted_names

_ABSURD_SIGMA0 = 5.0
"""sigma0 above which a wrong minimum is suspected: a-priori errors are seldom wrong by a larger factor."""

_MANY_DOWN_WEIGHTED = 0.2
"""Part of all photo points above which blunders cannot be the reason."""

_MOST_OF_A_PHOTO = 0.5
"""Part of its photo points that do not fit above which the photo is out of place, not its points."""

_MANY_CONTROL = 0.3
"""Part of the control points, and two at least, that a block with nothing else on the ground seldom contradicts."""

_HANDFUL = 10
"""Redundancy below which some observations can mostly be left out so that the others fit."""

_LOWER = 1e-6
"""Relative difference of costs: iterations end when corrections are 1e-4 of the standard deviations, and the cost
follows with their square."""


def doubt_about(solved: SolvedBlock) -> str:
    """Return what is suspicious about the end of an adjustment, to complete "the adjustment ..."; "" if nothing is.

    An adjustment that was started far from its minimum does not converge, or leaves photos undetermined, points behind
    their cameras or far away, residuals of many times the a-priori errors or a photo that fits few of its points.
    """
    if solved.reason in (TerminationReason.MAX_ITERATIONS, TerminationReason.DIVERGED):
        return "did not converge"
    if names := _undetermined_photos(solved):
        return f"left {counted_names('photo', names)} undetermined"
    if behind := _points_behind(solved):
        return f"put {counted_names('point', behind)} behind {agreeing(len(behind), 'its camera', 'their cameras')}"
    sigma0 = solved.variance.sigma0
    if not np.isfinite(sigma0) and solved.variance.redundancy > 0:
        return "left no observation with full weight that another one checks"
    if sigma0 > _ABSURD_SIGMA0:
        return f"ended at sigma0 {sigma0:.4g}"
    used, reduced = _down_weighted_points(solved)
    if reduced.sum() > _MANY_DOWN_WEIGHTED * used.sum():
        return f"down-weighted {reduced.sum()} of the {counted(int(used.sum()), 'photo point')}"
    if names := _lost_points(solved, used, reduced):
        return f"left {counted_names('point', names)} undetermined, of which no ray fits"
    if names := _photos_out_of_place(solved, used, reduced):
        return f"down-weighted most points of {counted_names('photo', names)}"
    return ""


def doubt_about_given(solved: SolvedBlock) -> str:
    """Return the same of an adjustment from given values, which may be those of an earlier solution that was wrong.

    A block that starts bent may end so, with all that would straighten it down-weighted: then it contradicts much of
    the control that alone places it on the ground.
    """
    if doubt := doubt_about(solved):
        return doubt
    names = _contradicted_control(solved)
    return f"contradicts {counted_names('control point', names)}" if names else ""


def is_better(other: SolvedBlock, given: SolvedBlock) -> bool:
    """Tell whether another adjustment of the same observations ended at a better minimum.

    One that has converged and determines all photos is better than one that has not, else the lower robust cost is:
    unless it is so only because observations have lost weight that a handful of others check.
    """
    rank, other_rank = _soundness(given), _soundness(other)
    if other_rank != rank:
        return other_rank > rank
    reduced, other_reduced = (int(np.count_nonzero(_down_weighted_points(solved)[1])) for solved in (given, other))
    if other_reduced > reduced and other.variance.redundancy < _HANDFUL:
        return False
    # without down-weighting, too, an observation that is lost must cost more than one that fits
    weighing = replace(
        given.weighing,
        start=given.weighing.start or 1,
        scale=_scale_of_errors(given, other),
        of_tracks=given.weighing.of_tracks or other.weighing.of_tracks,
    )
    return weighing.cost(other.equations) < (1.0 - _LOWER) * weighing.cost(given.equations)


def _scale_of_errors(*ends: SolvedBlock) -> float:
    """Return how many times too small the a-priori errors are: where residuals are larger, all cost nearly the same.

    An observation that is left out would then be as cheap as one that fits like all others.
    """
    known = [end.variance.sigma0 for end in ends if np.isfinite(end.variance.sigma0)]
    return max(1.0, min(known, default=1.0))


def _soundness(solved: SolvedBlock) -> tuple[bool, int]:
    return solved.converged, -len(_undetermined_photos(solved))


def _undetermined_photos(solved: SolvedBlock) -> list[str]:
    return _names(solved.block, np.flatnonzero(undetermined_photos(solved).any(axis=1)).tolist())


def _points_behind(solved: SolvedBlock) -> list[str]:
    """Return the points that lie behind the camera of a photo that shows them."""
    state = solved.state
    points = solved.block.photo_points.of(np.flatnonzero(lost_rays(solved)))
    offset = state.points[points.point] - state.centres[points.photo]
    depth = np.einsum("ni,ni->n", offset, state.rotations[points.photo, :, 2])
    rows = np.unique(points.point[(depth >= 0.0) & points.in_use])
    return [solved.block.point_names[row] for row in rows.tolist()]


def _down_weighted_points(solved: SolvedBlock) -> tuple[BoolArray, BoolArray]:
    """Return which photo points (n,) are used, and which of them are down-weighted."""
    points = solved.block.photo_points
    used: BoolArray = points.in_use
    # photo points are the first kind of observation
    factors = solved.weight_factors[: 2 * len(points.photo)].reshape(-1, 2)
    return used, np.asarray(used & (factors < 1.0).any(axis=1))


def _lost_points(solved: SolvedBlock, used: BoolArray, reduced: BoolArray) -> list[str]:
    """Return the points that nothing determines since all of their rays, several, have lost weight."""
    point, count = solved.block.photo_points.point, len(solved.block.point_names)
    number, wrong = np.bincount(point[used], minlength=count), np.bincount(point[reduced], minlength=count)
    columns = solved.problem.unknowns.points
    undetermined = (solved.normals.removed[columns] & (columns != CONSTANT)).any(axis=1)
    return [solved.block.point_names[row] for row in np.flatnonzero(undetermined & (number > 1) & (wrong == number))]


def _photos_out_of_place(solved: SolvedBlock, used: BoolArray, reduced: BoolArray) -> list[str]:
    """Return the photos most of whose points are down-weighted."""
    photo, count = solved.block.photo_points.photo, len(solved.block.photos)
    number, wrong = np.bincount(photo[used], minlength=count), np.bincount(photo[reduced], minlength=count)
    return _names(solved.block, np.flatnonzero(wrong > _MOST_OF_A_PHOTO * number).tolist())


def _contradicted_control(solved: SolvedBlock) -> list[str]:
    """Return the control points that have lost weight, if they are many and nothing else is on the ground."""
    if solved.block.stations or solved.block.elements:
        return []
    first, used, reduced = 0, set[str](), list[str]()
    for kind in solved.problem.observations:
        rows = slice(first, first + len(kind.rows.error))
        first = rows.stop
        if kind.rows.kind == CONTROL_POINT:
            active, names = solved.equations.active[rows], np.array(list(kind.rows.point), dtype=object)
            used |= set(names[active].tolist())
            reduced += names[active & (solved.weight_factors[rows] < 1.0)].tolist()
    found = list(dict.fromkeys(reduced))
    return found if len(found) > max(1.0, _MANY_CONTROL * len(used)) else []


def _names(block: Block, rows: list[int]) -> list[str]:
    return [block.photos[row].name for row in rows]
