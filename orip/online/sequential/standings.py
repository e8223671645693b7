"""How the equations of observations fit, one by one and many at once: residuals, redundancy numbers, square sums."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.online.sequential.hyper_rows import HyperRow, ObservationRows, PointInTriangle, ReducedRows, stacked
from orip.online.sequential.triangle import Triangle

LEAST_REDUNDANCY = 1e-4
"""Below this redundancy number an equation counts as not checked: of sixteen digits -log10 r are lost, and w would be a
small number over another one. Nor is it taken out of the triangle then, which is built again instead."""


class Standing(NamedTuple):
    """How k equations of an observation fit, all others being in; or as they would fit if they were in.

    Attributes
    ----------
    residual : array (k,)
        Computed minus observed, divided by the a-priori errors.
    cofactor : array (k, k)
        Of the residuals; its diagonal has the redundancy numbers.
    """

    residual: FloatArray
    cofactor: FloatArray

    @property
    def redundancy(self) -> FloatArray:
        """Return the redundancy numbers (k,), from 0 to 1."""
        return np.asarray(np.diagonal(self.cofactor).clip(0.0, 1.0))

    def normalised(self, least_redundancy: float = LEAST_REDUNDANCY) -> FloatArray:
        """Return Baarda's w (k,) with sigma0 = 1; NaN where nothing checks an equation."""
        checked = self.redundancy > least_redundancy
        return np.where(checked, self.residual / np.sqrt(np.where(checked, self.redundancy, 1.0)), np.nan)

    def square(self) -> tuple[float, int]:
        """Return by how much the square sum falls without the observation, and how many equations are checked."""
        squares, checked = falls([self])
        return float(squares[0]), int(checked[0])


def redundancies(standings: Sequence[Standing]) -> list[list[float]]:
    """Return the redundancy numbers of each observation; `Standing.redundancy` of many."""
    found: dict[int, list[float]] = {}
    for places, _, cofactor in _by_size(standings):
        numbers = np.diagonal(cofactor, axis1=1, axis2=2).clip(0.0, 1.0).tolist()
        found.update(zip(places.tolist(), numbers, strict=True))
    return [found[place] for place in range(len(standings))]


def falls(standings: Sequence[Standing]) -> tuple[FloatArray, IntArray]:
    """Return by how much the square sum falls without each observation (m,), and how many equations are checked.

    `Standing.square` of many: matrices of the same size are decomposed together.
    """
    squares, checked = np.zeros(len(standings)), np.zeros(len(standings), dtype=np.int64)
    for same, residual, cofactor in _by_size(standings):
        values, vectors = np.linalg.eigh(cofactor)
        parts = (vectors.transpose(0, 2, 1) @ residual[:, :, None])[:, :, 0]
        is_checked = values > LEAST_REDUNDANCY
        squares[same] = np.sum(np.where(is_checked, parts**2 / np.where(is_checked, values, 1.0), 0.0), axis=1)
        checked[same] = np.count_nonzero(is_checked, axis=1)
    return squares, checked


def _by_size(standings: Sequence[Standing]) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """Yield the places of observations with k equations, their residuals (m, k) and cofactors (m, k, k)."""
    sizes = np.array([len(standing.residual) for standing in standings], dtype=np.int64)
    for size in np.unique(sizes).tolist():
        places = np.flatnonzero(sizes == size)
        same = [standings[place] for place in places.tolist()]
        residual = np.concatenate([standing.residual for standing in same]).reshape(-1, size)
        yield places, residual, np.concatenate([standing.cofactor for standing in same]).reshape(-1, size, size)


# With the equations a of an observation and R of all, p = R^-T a^T has p^T p = a N^-1 a^T, the cofactor of what the
# adjustment says about it.


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


# What is left of an observation without its point, L, has the cofactors L N^-1 L^T in the reduced unknowns. Points with
# as many photos and observations are computed together. That has fewer digits than a substitution where the datum is
# weak: with the weight of all control at a millionth, redundancy numbers of 512 photos are right to 3e-6.

_NUMBERS = 4_000_000
"""Elements of N^-1 that are taken out of it at once."""

OfPoint = tuple[HyperRow, list[int]]
"""A hyper-row and the places of its observations."""


def standings_of_many(
    points: Mapping[str, PointInTriangle], triangle: Triangle, observations: Sequence[ObservationRows]
) -> list[Standing]:
    """Return how observations that are in fit."""
    cofactors, solution = triangle.cofactors(), triangle.solution()
    found: dict[int, Standing] = {}
    for alike in _alike(points, observations):
        at_once = max(1, _NUMBERS // max(1, len(alike[0][0].columns) ** 2))
        for start in range(0, len(alike), at_once):
            found.update(_together(alike[start : start + at_once], observations, cofactors, solution))
    return [found[place] for place in range(len(observations))]


def _alike(points: Mapping[str, PointInTriangle], observations: Sequence[ObservationRows]) -> list[list[OfPoint]]:
    """Return points with their observations, in groups with arrays of the same shapes."""
    places: dict[str | int, list[int]] = {}
    for place, rows in enumerate(observations):
        places.setdefault(place if rows.point is None else rows.point, []).append(place)
    groups: dict[tuple[tuple[int, ...], ...], list[OfPoint]] = {}
    for name, of_point in places.items():
        rows = observations[of_point[0]]
        hyper_row = _without_point(rows) if rows.point is None else points[str(name)].hyper_row
        shapes = (hyper_row.coupling.shape, *(observations[place].by_reduced.shape for place in of_point))
        groups.setdefault(shapes, []).append((hyper_row, of_point))
    return list(groups.values())


def _without_point(rows: ObservationRows) -> HyperRow:
    """Return a hyper-row without any row, for an observation that touches no point."""
    nothing = np.zeros((0, len(rows.columns)))
    return HyperRow(np.zeros(0, dtype=np.int64), nothing[:, :0], rows.columns, nothing, nothing[:, 0], 0)


def _together(
    alike: Sequence[OfPoint], observations: Sequence[ObservationRows], cofactors: FloatArray, solution: FloatArray
) -> Iterator[tuple[int, Standing]]:
    """Yield how the observations of points fit whose arrays have the same shapes."""
    hyper_rows = [hyper_row for hyper_row, _ in alike]
    factor, coupling, right, columns, coordinates = (
        np.array([getattr(hyper_row, name) for hyper_row in hyper_rows])
        for name in ("factor", "coupling", "right", "columns", "coordinates")
    )
    known, part = solution[columns][:, :, None], cofactors[columns[:, :, None], columns[:, None, :]]
    for places in zip(*(of_point for _, of_point in alike), strict=True):
        rows = [observations[place] for place in places]
        size, length = rows[0].by_reduced.shape
        by_point = np.concatenate([one.by_point for one in rows]).reshape(len(rows), size, 3)
        by_reduced = np.concatenate([one.by_reduced for one in rows]).reshape(len(rows), size, length)
        of_rows = np.concatenate([one.columns for one in rows]).reshape(len(rows), length)
        observed = np.concatenate([one.right for one in rows]).reshape(len(rows), size, 1)
        of_point = np.take_along_axis(by_point, coordinates[:, None, :], axis=2)
        # R_p^-T A_p^T, and what is left of the equations without the point
        own = np.linalg.solve(factor.transpose(0, 2, 1), of_point.transpose(0, 2, 1)).transpose(0, 2, 1)
        left = -own @ coupling
        at = np.count_nonzero(columns[:, None, :] < of_rows[:, :, None], axis=2)
        left[np.arange(len(rows))[:, None, None], np.arange(size)[:, None], at[:, None, :]] += by_reduced
        residual = left @ known + own @ right[:, :, None] - observed
        explained = np.einsum("nic,nkc->nik", left @ part, left) + np.einsum("nir,nkr->nik", own, own)
        yield from zip(places, map(Standing, residual[:, :, 0], np.eye(size) - explained), strict=True)
