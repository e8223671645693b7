"""Photo points under a wrong number: the point that they probably are, or two points under one number.

A photo point that does not fit may lie where another point should appear that is not measured in its photo. Rays that
miss the point where the other rays of their number meet, but meet somewhere else, are those of a second point.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, combinations

import numpy as np

from orip.arrays import IntArray
from orip.errors import ProjectWarning
from orip.mistakes.adjusted_rays import AdjustedRays
from orip.mistakes.doubted_observations import doubted_photo_points
from orip.records.block import Block
from orip.records.names import places_of_names
from orip.records.results.solution import Solution
from orip.wording import counted_names

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
                f"{text} in {self._photos([worst])}; without any one of these photos its other rays meet, so that it "
                f"may be wrong in any of them: measure it again there, or check its number{more}"
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
