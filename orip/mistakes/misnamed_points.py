"""Photo points under the number of another point: which one they are, or that two points have one number.

A photo point that does not fit where its point is may fit where another one is that the photo should show and does not.
Rays that do not meet where the other rays of their point do, but meet elsewhere, are those of a second point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from orip.errors import ProjectWarning
from orip.mistakes.adjusted_rays import PhotoSight
from orip.records.block import Block
from orip.records.solution import Solution
from orip.wording import counted_names

_DOUBTED = 0.5
"""Weight factor below which a photo point is not where its point is."""

_MOST = 0.05
"""Part of the photo points that may be doubted; with more it is not single points that are wrong."""

_BY_CHANCE = 0.01
"""Expected number of points that fit a place by chance, above which a fit says nothing."""


def misnamed_points(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for each doubted photo point, with the point that it probably is.

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
    return _Doubted(block, solution, doubted.tolist()).warnings()


def doubted_photo_points(solution: Solution) -> NDArray[np.int64]:
    """Return the rows of the photo points that an adjustment has gone without."""
    rows = solution.residuals
    weights = rows.weight_factor[np.array(rows.kind) == "photo"].reshape(-1, 2)
    return np.flatnonzero((weights < _DOUBTED).any(axis=1))


class _Doubted:
    """Photo points that are doubted, and what they may be."""

    def __init__(self, block: Block, solution: Solution, rows: Sequence[int]) -> None:
        self.block, self.solution = block, solution
        self.sight = PhotoSight(block, solution)
        self.place = {name: row for row, name in enumerate(solution.points.names)}
        # what loses weight since all residuals are larger than they should be is no blunder; where a point is without
        # that ray is no better known than the ray itself
        self.rows = [row for row in rows if not self._off(row) <= np.sqrt(2.0) * self.sight.limit(row)]
        self.measured: dict[int, set[int]] = {}
        for photo, point in zip(block.photo_points.photo.tolist(), block.photo_points.point.tolist(), strict=True):
            self.measured.setdefault(photo, set()).add(point)

    def warnings(self) -> list[ProjectWarning]:
        """Return what the photo points are; where they are nothing else, the one that is off most."""
        alone: dict[str, list[int]] = {}
        others: dict[tuple[str, str], list[int]] = {}
        for row in self.rows:
            other = self._other_point(row)
            if other is None:
                alone.setdefault(self._point(row), []).append(row)
            else:
                others.setdefault((self._point(row), other), []).append(row)
        found = [self._renamed(name, other, rows) for (name, other), rows in others.items()]
        twice = {name: rows for name, rows in alone.items() if len(rows) > 1 and self.sight.meeting(rows) is not None}
        found += [self._second_point(name, rows) for name, rows in twice.items()]
        return found or self._blunder()

    def _renamed(self, name: str, other: str, rows: Sequence[int]) -> ProjectWarning:
        text = (
            f"what was measured there as point {name} is where point {other} is seen, and that is not measured there: "
            f"it is probably {other}; correct the number in the POINTS lines"
        )
        return ProjectWarning("misnamed-point", self._photos(rows), text)

    def _second_point(self, name: str, rows: Sequence[int]) -> ProjectWarning:
        text = (
            f"its rays in {self._photos(rows)} meet, but not where those in other photos do: one number for two "
            "points; give one of them another number"
        )
        return ProjectWarning("misnamed-point", f"point {name}", text)

    def _blunder(self) -> list[ProjectWarning]:
        """Return a warning for the photo point that is off most, of those whose other rays meet."""
        rows = [row for row in self.rows if self.sight.meeting(self._other_rows(row)) is not None]
        if not rows:
            return []
        row = max(rows, key=lambda each: np.nan_to_num(self._off(each), nan=np.inf))
        more = f" ({len(rows) - 1} more do not fit)" if len(rows) > 1 else ""
        text = (
            f"point {self._point(row)} does not fit by {self._off(row):.3f} mm and was down-weighted; its other rays "
            f"meet: measure it again in this photo, or check its number{more}"
        )
        return [ProjectWarning("blunder", self._photos([row]), text)]

    def _off(self, row: int) -> float:
        """Return how far (mm) a photo point is from where its point is seen."""
        return float(self.sight.off(row, self.solution.points.values[[self.place[self._point(row)]]])[0])

    def _other_rows(self, row: int) -> list[int]:
        points = self.block.photo_points
        same = np.flatnonzero((points.point == points.point[row]) & points.used.all(axis=1))
        return [each for each in same.tolist() if each not in self.rows]

    def _other_point(self, row: int) -> str | None:
        """Return the point that a photo point fits, and that its photo does not show otherwise."""
        mine = self.measured[int(self.block.photo_points.photo[row])]
        others = np.array([k for k in range(len(self.block.point_names)) if k not in mine], dtype=np.int64)
        if not len(others):
            return None
        off, limit = self.sight.off(row, self.solution.points.values[others]), self.sight.limit(row)
        area = float(np.prod(np.ptp(self.block.photo_points.xy, axis=0)))
        seen = np.count_nonzero(off < np.sqrt(area))
        if not (off <= limit).any() or seen * np.pi * limit**2 > _BY_CHANCE * area:
            return None
        return self.block.point_names[int(others[int(np.nanargmin(off))])]

    def _point(self, row: int) -> str:
        return self.block.point_names[int(self.block.photo_points.point[row])]

    def _photos(self, rows: Sequence[int]) -> str:
        names = [self.block.photos[int(self.block.photo_points.photo[row])].name for row in rows]
        return counted_names("photo", names)
