"""Photo points under a wrong number, two points under one number, and one point under two."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, combinations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.doubted_observations import AdjustedRays, doubted_photo_points
from orip.mistakes.hypothesis import fit_of_adjustment, is_good
from orip.records.block import Block
from orip.records.names import places_of_names
from orip.records.results.solution import Solution
from orip.wording import counted_names

# A photo point that does not fit may lie where another point should appear that is not measured in its photo. Rays that
# miss the point where the other rays of their number meet, but meet somewhere else, are those of a second point.

_MOST = 0.05
"""Largest part of the photo points that may be doubted; with more, it is not single points that are wrong."""

_LEAST_RAYS, _MOST_RAYS = 4, 12
"""Least and most rays of a point that are divided into those of two: fewer meet by chance, more take too long."""

_RAYS_OF_PAIR = 2
"""Of so many rays neither can be called wrong."""

_MOST_ALONE = 5
"""Most points with one ray among which one is sought that another ray meets: of more, some are met by chance."""

_BY_CHANCE = 0.01
"""Largest expected number of points near a photo point by chance; with more of them a match proves nothing."""


def misnamed_points(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for the doubted photo points, with the point that they probably are.

    Parameters
    ----------
    block : Block
        As gathered.
    solution : Solution
        With down-weighting.
    """
    doubted = doubted_photo_points(block, solution)
    if not 0 < len(doubted) <= _MOST * len(block.photo_points.photo):
        return []
    return _DoubtedPhotoPoints(block, solution, doubted.tolist()).warnings()


class _DoubtedPhotoPoints:
    """Photo points that are doubted, and what they may be; rows are those of `Block.photo_points`."""

    def __init__(self, block: Block, solution: Solution, rows: Sequence[int]) -> None:
        self.block, self.solution = block, solution
        self.rays = AdjustedRays(block, solution)
        self.place = places_of_names(solution.points.names)
        # Photo points that lost weight because all residuals are larger than they should be are no blunders. Without
        # its own ray the position of a point is no better known than that ray: hence the factor.
        self.rows = [row for row in rows if not self._distance(row) <= np.sqrt(2.0) * self.rays.limit(row)]
        self.measured: dict[int, set[int]] = {}
        self.rays_of: dict[int, list[int]] = {}
        points = block.photo_points
        used: list[bool] = np.all(points.used, axis=1).tolist()
        for row, (photo, point) in enumerate(zip(points.photo.tolist(), points.point.tolist(), strict=True)):
            self.measured.setdefault(photo, set()).add(point)
            if used[row]:
                self.rays_of.setdefault(point, []).append(row)
        self.alone = {point: rays[0] for point, rays in self.rays_of.items() if len(rays) == 1}

    def warnings(self) -> list[ProjectWarning]:
        """Return what the photo points are; if none is another point, the one that is off most."""
        renamed: dict[tuple[str, str], list[int]] = {}
        unexplained: dict[str, list[int]] = {}
        exchanged = self._exchanged()
        for row in (row for row in self.rows if row not in set(chain(*exchanged))):
            other = self._other_point(row)
            if other is None:
                unexplained.setdefault(self._point(row), []).append(row)
            else:
                renamed.setdefault((self._point(row), other), []).append(row)
        found = [self._exchange_warning(*pair) for pair in exchanged]
        found += [self._renamed_warning(name, other, rows) for (name, other), rows in renamed.items()]
        found += [
            self._second_point_warning(name, second)
            for name, rows in unexplained.items()
            if len(second := self._second_group(rows)) > 1
        ]
        return found or self._blunder_warning()

    def _second_group(self, rows: Sequence[int]) -> Sequence[int]:
        """Return the rays of a point that meet in a second place; empty if there is none.

        Parameters
        ----------
        rows : sequence of int
            Those of its photo points that are doubted.
        """
        own = self._used_rows(rows[0])
        if self.rays.meeting(own) is not None:  # all of them: its coordinates are wrong, and not its rays
            return ()
        if len(rows) < len(own):
            return rows if self.rays.meeting(rows) is not None else ()
        if not _LEAST_RAYS <= len(own) <= _MOST_RAYS:
            return ()
        # nothing says which rays are right: those that meet, while all others meet, too
        for first in combinations(own, 2):
            meeting = [row for row in own if row in first or self.rays.meeting([*first, row]) is not None]
            others = [row for row in own if row not in meeting]
            if len(others) > 1 and self.rays.meeting(meeting) and self.rays.meeting(others):
                return others
        return ()

    def _used_rows(self, row: int) -> list[int]:
        """Return all photo points of the same point that take part."""
        return self.rays_of.get(int(self.block.photo_points.point[row]), [])

    def _exchanged(self) -> list[tuple[int, int]]:
        """Return the pairs of photo points of one photo that are each where the other one should be."""
        photo = self.block.photo_points.photo
        return [
            (one, other)
            for one, other in combinations(self.rows, 2)
            if photo[one] == photo[other] and self._is_at(one, other) and self._is_at(other, one)
        ]

    def _is_at(self, row: int, other: int) -> bool:
        """Tell whether a photo point is where the point of another one should appear."""
        xyz = self.solution.points.values[[self.place[self._point(other)]]]
        return bool(self.rays.distances(row, xyz)[0] <= np.sqrt(2.0) * self.rays.limit(row))

    def _exchange_warning(self, row: int, other: int) -> ProjectWarning:
        one, another = self._point(row), self._point(other)
        text = (
            f"points {one} and {another} are exchanged there: each is where the other should appear; exchange their "
            "numbers in the POINTS lines"
        )
        return ProjectWarning("misnamed-point", self._photos([row]), text)

    def _renamed_warning(self, name: str, other: str, rows: Sequence[int]) -> ProjectWarning:
        text = (
            f"what was measured there as point {name} is where point {other} should appear, and {other} is not "
            f"measured there: it is probably {other}; correct the number in the POINTS lines"
        )
        return ProjectWarning("misnamed-point", self._photos(rows), text)

    def _second_point_warning(self, name: str, rows: Sequence[int]) -> ProjectWarning:
        text = (
            f"its rays in {self._photos(rows)} meet in one place and those in the other photos in another: one number "
            "for two points; give one of them another number"
        )
        return ProjectWarning("misnamed-point", f"point {name}", text)

    def _blunder_warning(self) -> list[ProjectWarning]:
        """Return a warning for the photo point that is off most, of those whose other rays meet."""
        rows = [row for row in self.rows if self.rays.meeting(self._other_rows(row)) is not None]
        if not rows:
            return []
        worst = max(rows, key=lambda row: np.nan_to_num(self._distance(row), nan=np.inf))
        more = f" ({len(rows) - 1} more do not fit)" if len(rows) > 1 else ""
        text = f"point {self._point(worst)} does not fit by {self._distance(worst):.3f} mm and was down-weighted"
        if others := self._as_likely(worst):
            text = (
                f"{text} in {self._photos([worst])}; leaving out any one of these photos makes the remaining rays "
                f"meet, so the error may be in any of them: remeasure the point there, or check its number{more}"
            )
        else:
            text = f"{text}; its other rays meet: measure it again in this photo, or check its number{more}"
        return [ProjectWarning("blunder", self._photos([worst, *others]), text)]

    def _as_likely(self, row: int) -> list[int]:
        """Return the other photo points of the same point without which its rays meet as well."""
        rays = [row, *self._other_rows(row)]
        return [
            other
            for other in sorted(rays[1:])
            if len(rays) > _RAYS_OF_PAIR and self.rays.meeting([ray for ray in rays if ray != other]) is not None
        ]

    def _distance(self, row: int) -> float:
        """Return how far (mm) a photo point is from the image of its adjusted point."""
        xyz = self.solution.points.values[[self.place[self._point(row)]]]
        return float(self.rays.distances(row, xyz)[0])

    def _other_rows(self, row: int) -> list[int]:
        """Return the other photo points of the same point, without the doubted ones."""
        return [other for other in self._used_rows(row) if other not in self.rows]

    def _other_point(self, row: int) -> str | None:
        """Return the point that a photo point fits and that is not measured in its photo; None if there is none."""
        measured = self.measured[int(self.block.photo_points.photo[row])]
        others = np.array([k for k in range(len(self.block.point_names)) if k not in measured], dtype=np.int64)
        if not len(others):
            return None
        if (alone := self._met_alone(row, others)) is not None:
            return alone
        distance, limit = self.rays.distances(row, self.solution.points.values[others]), self.rays.limit(row)
        area = float(np.prod(np.ptp(self.block.photo_points.xy, axis=0)))
        in_photo = np.count_nonzero(distance < np.sqrt(area))
        if not (distance <= limit).any() or in_photo * np.pi * limit**2 > _BY_CHANCE * area:
            return None
        return self.block.point_names[int(others[int(np.nanargmin(distance))])]

    def _met_alone(self, row: int, others: IntArray) -> str | None:
        """Return the only point of one ray that a photo point's ray meets; None if there is none, or several."""
        alone = [self.alone[point] for point in others.tolist() if point in self.alone]
        if len(alone) > _MOST_ALONE:
            return None
        met = [other for other in alone if self.rays.meeting([other, row]) is not None]
        return self._point(met[0]) if len(met) == 1 else None

    def _point(self, row: int) -> str:
        return self.block.point_names[int(self.block.photo_points.point[row])]

    def _photos(self, rows: Sequence[int]) -> str:
        names = [self.block.photos[int(self.block.photo_points.photo[row])].name for row in rows]
        return counted_names("photo", names)


_TOGETHER = 4.0
"""Standard deviations of their difference within which two points are in one place."""

_PHOTOS_HELD = 2.0
"""Factor from standard deviations with all photos held to those of points relative to their neighbours, at most."""


_SELDOM, _MARGIN, _FEWEST = 0.05, 0.5, 4
"""Expected number of rays that meet by chance, anywhere; how far around the other points, as a part of their extent, a
meeting place may be; and how many of these are needed."""

_MOST_SINGLE = 200
"""Points of one ray that are compared: where there are more, it is the way they were measured."""

_MOST_COMPARED = 500
"""Points from which it is told how many pairs share no photo."""

_MOST_POINTS = 5_000
"""In larger blocks points lie near each other by chance."""


def points_under_two_numbers(block: Block, solution: Solution, solved: SolvedBlock) -> list[ProjectWarning]:
    """Return a warning for each pair of points, not both of control, that are probably one point.

    Points whose rays have errors of their own come from matching, which loses a point in one photo and finds it again
    in another: that takes nothing from what it has measured, and nobody gave the numbers.

    Parameters
    ----------
    block : Block
        As gathered.
    """
    if len(block.point_names) > _MOST_POINTS or not is_good(fit_of_adjustment(solved)):
        return []
    known, *variances = _determined_points(solved)
    shown = _shown(solved, known)
    pairs = _in_one_place(solved.state.points[known], variances, _apart(shown))
    pairs = pairs[~(shown[pairs[:, 0]] & shown[pairs[:, 1]]).any(axis=1)] if len(pairs) else pairs
    rays, place = AdjustedRays(block, solution), block.point_index()
    names, control = solved.block.point_names, {point.name for point in solved.block.control_points}
    named = [sorted(names[row] for row in known[pair]) for pair in pairs]
    named = [pair for pair in named if not control.issuperset(pair)]
    named += _of_single_rays(solved, rays, [names[row] for row in known if names[row] not in control])
    warnings = []
    for first, second in named:
        rows = np.flatnonzero(np.isin(block.photo_points.point, [place[first], place[second]]))
        is_matched = np.ptp(block.photo_points.error[rows], axis=0).any()
        if not is_matched and rays.meeting(rows) is not None:
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


def _determined_points(solved: SolvedBlock) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the indices (t,) of determined points, and variances (t, 3) of their coordinates.

    The second ones are relative to neighbouring points: what moves the whole block moves points together.
    """
    columns, reduced = solved.problem.unknowns.points, solved.problem.layout.reduced
    free: BoolArray = np.array((columns >= reduced).all(axis=1))
    free[free] = ~solved.normals.removed[columns[free]].any(axis=1)
    rows = np.flatnonzero(free)
    place = (columns[rows, 0] - reduced) // 3
    variance = np.diagonal(solved.cofactors.blocks[place], axis1=1, axis2=2)
    held = np.square(solved.normals.blocks.half[place]).sum(axis=1)
    scale = solved.deviation_scale**2
    return rows, scale * variance, scale * np.minimum(variance, _PHOTOS_HELD**2 * held)


def _apart(shown: BoolArray) -> float:
    """Return the part of the pairs of points that no photo shows both of, from an even selection of points."""
    some = shown[:: 1 + len(shown) // _MOST_COMPARED].astype(np.float32)
    return float(np.mean(some @ some.T == 0.0)) if len(some) else 1.0


def _in_one_place(xyz: FloatArray, variances: Sequence[FloatArray], apart: float) -> IntArray:
    """Return the pairs (p, 2) of points that are within `_TOGETHER` standard deviations of their difference.

    Of several variances (t, 3) the first are taken with which points are together by chance seldom enough; `apart` is
    the part of the pairs that may be one point.
    """
    nothing = np.empty((0, 2), dtype=np.int64)
    count = len(xyz)
    if count < 2:
        return nothing
    extent = np.maximum(np.ptp(xyz, axis=0), 1e-12)
    for variance in variances:
        usual = _TOGETHER * np.sqrt(2.0 * np.median(variance, axis=0))
        if 0.5 * apart * count**2 * float(np.prod(np.minimum(1.0, 2.0 * usual / extent))) <= _BY_CHANCE:
            break
    else:
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
