"""Points as they are in the triangle: their hyper-rows, and what they say about the reduced unknowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from orip.sequential.hyper_row import HyperRow, ObservationRows, factored
from orip.sequential.reduced_rows import ReducedRows


class PointInTriangle(NamedTuple):
    """A point as it is in the triangle."""

    hyper_row: HyperRow
    reduced: tuple[ReducedRows, ...]


class PointsInTriangle(dict[str, PointInTriangle]):
    """Points by name, and how many coordinates of them are determined."""

    def __init__(self, points: Mapping[str, PointInTriangle] | None = None) -> None:
        super().__init__(points or {})
        self.coordinates = sum(len(point.hyper_row.coordinates) for point in self.values())

    def __setitem__(self, name: str, point: PointInTriangle) -> None:
        before = self.get(name)
        self.coordinates += len(point.hyper_row.coordinates)
        self.coordinates -= 0 if before is None else len(before.hyper_row.coordinates)
        super().__setitem__(name, point)

    def taken(self, name: str) -> PointInTriangle:
        """Take a point out, and return it."""
        point = self.pop(name)
        self.coordinates -= len(point.hyper_row.coordinates)
        return point

    def __reduce__(self) -> tuple[type[PointsInTriangle], tuple[dict[str, PointInTriangle]]]:
        """Return how a copy is made: set item by item, it would count the coordinates twice."""
        return PointsInTriangle, (dict(self),)

    def copy(self) -> PointsInTriangle:
        """Return the same points, to go back to them."""
        return PointsInTriangle(self)


def factored_point(observations: Sequence[ObservationRows]) -> PointInTriangle:
    """Return a point that its observations alone determine."""
    hyper_row, reduced = factored(observations)
    return PointInTriangle(hyper_row, (reduced,) if len(reduced.right) else ())
