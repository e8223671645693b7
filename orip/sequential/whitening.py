"""How observations fit: their equations divided by the triangle, with the points' own rows of it.

With the equations a of an observation and R of all, p = R^-T a^T has p^T p = a N^-1 a^T, the cofactor of what the
adjustment says about it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.sequential.hyper_row import ObservationRows, stacked
from orip.sequential.points_in_triangle import PointInTriangle
from orip.sequential.reduced_rows import ReducedRows
from orip.sequential.triangle import Triangle


class Whitened(NamedTuple):
    """R^-T a^T of k equations in a hyper-row (r, k) and in the triangle (n, k), l - a x (k,), and which are open."""

    own: FloatArray
    spread: FloatArray
    innovation: FloatArray
    is_open: BoolArray


class _OfPoint(NamedTuple):
    """Some observations of one point: their places among all, R^-T a^T in its hyper-row, and what is left of them."""

    places: list[int]
    own: FloatArray
    reduced: ReducedRows


def whitened(
    points: Mapping[str, PointInTriangle], triangle: Triangle, observations: Sequence[ObservationRows]
) -> list[Whitened]:
    """Return R^-T a^T of observations in their hyper-rows and in the triangle, l - a x, and which rows are open.

    One substitution serves all of them.
    """
    groups = list(_without_points(points, observations))
    columns = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(group.reduced.columns for group in groups)]))
    ends = np.cumsum([0, *(len(group.reduced.right) for group in groups)]).tolist()
    rows = np.zeros((ends[-1], len(columns)))
    for group, (start, end) in zip(groups, pairwise(ends), strict=True):
        rows[start:end, np.searchsorted(columns, group.reduced.columns)] = group.reduced.rows
    spread, is_open = triangle.whitened(columns, rows)
    explained = spread.T @ triangle.right
    found: dict[int, Whitened] = {}
    for group, start in zip(groups, ends, strict=False):
        for place, part in _parts(group.places, observations):
            across = slice(start + part.start, start + part.stop)
            found[place] = Whitened(
                group.own[:, part], spread[:, across], group.reduced.right[part] - explained[across], is_open[across]
            )
    return [found[place] for place in range(len(observations))]


def _without_points(
    points: Mapping[str, PointInTriangle], observations: Sequence[ObservationRows]
) -> Iterator[_OfPoint]:
    """Yield observations by points, with what is left of their equations without these."""
    places: dict[str | int, list[int]] = {}
    for place, rows in enumerate(observations):
        places.setdefault(place if rows.point is None else rows.point, []).append(place)
    for point, of_point in places.items():
        rows = stacked([observations[place] for place in of_point])
        if point in points:
            own, reduced = points[str(point)].hyper_row.whitened(rows)
        else:
            own, reduced = np.zeros((0, len(rows.right))), rows.reduced
        yield _OfPoint(of_point, own, reduced)


def _parts(places: Sequence[int], observations: Sequence[ObservationRows]) -> Iterator[tuple[int, slice]]:
    """Yield the rows of each observation among those that were stacked."""
    start = 0
    for place in places:
        end = start + len(observations[place].right)
        yield place, slice(start, end)
        start = end
