"""Photo points under a wrong number: the point that they probably are, or two points under one number.

A photo point that does not fit may lie where another point should appear that is not measured in its photo. Rays that
miss the point where the other rays of their number meet, but meet somewhere else, are those of a second point.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, combinations

import numpy as np

from orip.errors import ProjectWarning
from orip.mistakes.adjusted_rays import AdjustedRays
from orip.mistakes.doubted_observations import doubted_photo_points
from orip.records.block import Block
from orip.records.solution import Solution
from orip.wording import counted_names

_MOST = 0.05
"""Part of the photo points that may be doubted; with more it is not single points that are wrong."""

_BY_CHANCE = 0.01
"""Expected number of points that lie near a photo point by chance; with more of them a match proves nothing."""


def misnamed_points(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for the doubted photo points, with the point that they probably are.

    Parameters
    ----------
    block : Block
        As gathered.
    solution : Solution
        With down-weighting.
    """
    doubted = doubted_photo_points(solution)
    if solution.status == "not_converged" or not 0 < len(doubted) <= _MOST * len(block.photo_points.photo):
        return []
    return _DoubtedPhotoPoints(block, solution, doubted.tolist()).warnings()


class _DoubtedPhotoPoints:
    """Photo points that are doubted, and what they may be; rows are those of `Block.photo_points`."""

    def __init__(self, block: Block, solution: Solution, rows: Sequence[int]) -> None:
        self.block, self.solution = block, solution
        self.rays = AdjustedRays(block, solution)
        self.place = {name: row for row, name in enumerate(solution.points.names)}
        # Photo points that lost weight because all residuals are larger than they should be are no blunders. Without
        # its own ray a point is no better known than by the ray: hence the factor.
        self.rows = [row for row in rows if not self._distance(row) <= np.sqrt(2.0) * self.rays.limit(row)]
        self.measured: dict[int, set[int]] = {}
        for photo, point in zip(block.photo_points.photo.tolist(), block.photo_points.point.tolist(), strict=True):
            self.measured.setdefault(photo, set()).add(point)

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
            self._second_point_warning(name, rows)
            for name, rows in unexplained.items()
            if len(rows) > 1 and self.rays.meeting(rows) is not None
        ]
        return found or self._blunder_warning()

    def _exchanged(self) -> list[tuple[int, int]]:
        """Return the pairs of photo points of one photo each of which is where the other one should be."""
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
        text = (
            f"point {self._point(worst)} does not fit by {self._distance(worst):.3f} mm and was down-weighted; its "
            f"other rays meet: measure it again in this photo, or check its number{more}"
        )
        return [ProjectWarning("blunder", self._photos([worst]), text)]

    def _distance(self, row: int) -> float:
        """Return how far (mm) a photo point is from the image of its adjusted point."""
        xyz = self.solution.points.values[[self.place[self._point(row)]]]
        return float(self.rays.distances(row, xyz)[0])

    def _other_rows(self, row: int) -> list[int]:
        """Return the other photo points of the same point, without the doubted ones."""
        points = self.block.photo_points
        same = np.flatnonzero((points.point == points.point[row]) & points.used.all(axis=1))
        return [other for other in same.tolist() if other not in self.rows]

    def _other_point(self, row: int) -> str | None:
        """Return the point that a photo point fits and that is not measured in its photo; None if there is none."""
        measured = self.measured[int(self.block.photo_points.photo[row])]
        others = np.array([k for k in range(len(self.block.point_names)) if k not in measured], dtype=np.int64)
        if not len(others):
            return None
        distance, limit = self.rays.distances(row, self.solution.points.values[others]), self.rays.limit(row)
        area = float(np.prod(np.ptp(self.block.photo_points.xy, axis=0)))
        in_photo = np.count_nonzero(distance < np.sqrt(area))
        if not (distance <= limit).any() or in_photo * np.pi * limit**2 > _BY_CHANCE * area:
            return None
        return self.block.point_names[int(others[int(np.nanargmin(distance))])]

    def _point(self, row: int) -> str:
        return self.block.point_names[int(self.block.photo_points.point[row])]

    def _photos(self, rows: Sequence[int]) -> str:
        names = [self.block.photos[int(self.block.photo_points.photo[row])].name for row in rows]
        return counted_names("photo", names)
