"""One point under two numbers: two points in one place that no photo shows together."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.adjusted_rays import AdjustedRays
from orip.mistakes.fit_comparison import fit_of_adjustment, is_good
from orip.records.block import Block
from orip.records.results.solution import Solution

_TOGETHER = 4.0
"""Standard deviations of their difference within which two points are in one place."""

_BY_CHANCE = 0.01
"""Largest expected number of points so near each other by chance; with more of them a match proves nothing."""

_SELDOM, _MARGIN, _FEWEST = 0.05, 0.5, 4
"""Expected number of rays that meet by chance, anywhere; how far around the other points, as a part of their extent, a
meeting place may be; and how many of these are needed."""

_MOST_SINGLE = 200
"""Points of one ray that are compared: where there are more, it is the way they were measured."""

_MOST_POINTS = 5_000
"""In larger blocks points lie near each other by chance."""


def points_under_two_numbers(block: Block, solution: Solution, solved: SolvedBlock) -> list[ProjectWarning]:
    """Return a warning for each pair of tie points that are probably one point.

    Parameters
    ----------
    block : Block
        As gathered.
    solution : Solution
    solved : SolvedBlock
    """
    if len(block.point_names) > _MOST_POINTS or not is_good(fit_of_adjustment(solved)):
        return []
    tie, variance = _tie_points(solved)
    pairs = _in_one_place(solved.state.points[tie], variance)
    shown = _shown(solved, tie)
    pairs = pairs[~(shown[pairs[:, 0]] & shown[pairs[:, 1]]).any(axis=1)] if len(pairs) else pairs
    rays, place = AdjustedRays(block, solution), block.point_index()
    named = [sorted(solved.block.point_names[row] for row in tie[pair]) for pair in pairs]
    named += _of_single_rays(solved, rays, [solved.block.point_names[row] for row in tie])
    warnings = []
    for first, second in named:
        rows = np.flatnonzero(np.isin(block.photo_points.point, [place[first], place[second]]))
        if rays.meeting(rows) is not None:
            text = (
                "their rays meet in one place, and no photo shows both: probably one point under two numbers; give it "
                "one number"
            )
            warnings.append(ProjectWarning("same-point", f"points {first} and {second}", text))
    return warnings


def _of_single_rays(solved: SolvedBlock, rays: AdjustedRays, determined: list[str]) -> list[list[str]]:
    """Return pairs of a point of one ray and a determined one, or another one of one ray, whose rays meet.

    Two rays meet by chance now and then, but seldom among the other points.
    """
    block, points, place = rays.block, rays.block.photo_points, rays.block.point_index()
    with_control = {point.name for point in block.control_points}
    control = {
        point.name for point in block.control_points if point.kind == "control" and None not in point.coordinates
    }
    used = np.flatnonzero(points.in_use)
    single = [
        int(row) for row in used[np.bincount(points.point, minlength=len(place))[points.point[used]] == 1]
        if block.point_names[points.point[row]] not in with_control
    ]  # fmt: skip
    known = {name: row for row, name in enumerate(solved.block.point_names)}
    determined = [*determined, *sorted(control & known.keys())]
    places = solved.state.points[[known[name] for name in determined]]
    if not 0 < len(single) <= _MOST_SINGLE or len(places) < _FEWEST:
        return []
    found = []
    shown = np.zeros((len(place), len(block.photos)), dtype=bool)
    shown[points.point, points.photo] = True
    frame = float(np.median(np.ptp(points.xy, axis=0)))
    by_chance = len(single) ** 2 * max(map(rays.limit, single)) / frame
    for number, row in enumerate(single):
        name, photo = block.point_names[points.point[row]], points.photo[row]
        near = rays.distances(row, block.ground.to_project(places)) <= rays.limit(row)
        pairs = [other for other, is_near in zip(determined, near, strict=True) if is_near]
        found += [sorted((name, other)) for other in pairs if not shown[place[other], photo]]
        for other in single[number + 1 :] if by_chance <= _SELDOM else ():
            meeting = rays.meeting([row, other]) if points.photo[other] != photo else None
            if meeting is not None and _is_among(meeting[0], block.ground.to_project(places)):
                found.append(sorted((name, block.point_names[points.point[other]])))
    return found


def _is_among(position: FloatArray, places: FloatArray) -> bool:
    margin = _MARGIN * np.ptp(places, axis=0)
    return bool(((position > places.min(axis=0) - margin) & (position < places.max(axis=0) + margin)).all())


def _tie_points(solved: SolvedBlock) -> tuple[IntArray, FloatArray]:
    """Return the indices (t,) of determined points without control, and the variances (t, 3) of their coordinates."""
    control = {point.name for point in solved.block.control_points}
    columns, reduced = solved.problem.unknowns.points, solved.problem.layout.reduced
    free = (columns >= reduced).all(axis=1)
    free &= np.array([name not in control for name in solved.block.point_names], dtype=bool)
    free[free] = ~solved.normals.removed[columns[free]].any(axis=1)
    rows = np.flatnonzero(free)
    blocks = solved.cofactors.blocks[(columns[rows, 0] - reduced) // 3]
    return rows, solved.deviation_scale**2 * np.diagonal(blocks, axis1=1, axis2=2)


def _in_one_place(xyz: FloatArray, variance: FloatArray) -> IntArray:
    """Return the pairs (p, 2) of points that are within `_TOGETHER` standard deviations of their difference."""
    nothing = np.empty((0, 2), dtype=np.int64)
    count = len(xyz)
    if count < 2:
        return nothing
    extent = np.maximum(np.ptp(xyz, axis=0), 1e-12)
    usual = _TOGETHER * np.sqrt(2.0 * np.median(variance, axis=0))
    if 0.5 * count**2 * float(np.prod(np.minimum(1.0, 2.0 * usual / extent))) > _BY_CHANCE:
        return nothing
    order = np.argsort(xyz[:, 0])
    pairs = []
    for step in range(1, count):
        one, other = order[:-step], order[step:]
        offset = np.abs(xyz[other] - xyz[one])
        limit = _TOGETHER * np.sqrt(variance[one] + variance[other])
        pairs.append(np.column_stack([one, other])[(offset <= limit).all(axis=1)])
        if not (offset[:, 0] <= 2.0 * _TOGETHER * np.sqrt(variance[:, 0].max())).any():
            break
    return np.vstack([nothing, *pairs])


def _shown(solved: SolvedBlock, points: IntArray) -> BoolArray:
    """Return which photos show which points (number of points, number of photos)."""
    shown = np.zeros((len(solved.block.point_names), len(solved.block.photos)), dtype=bool)
    measured = solved.block.photo_points
    shown[measured.point, measured.photo] = True
    return shown[points]
