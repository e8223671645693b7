"""How many observations fit: by the parts of N^-1 that they need, and not by a substitution of each.

What is left of an observation without its point, L, has the cofactors L N^-1 L^T in the reduced unknowns. Points with
as many photos and observations are computed together. That has fewer digits than a substitution where the datum is
weak: with the weight of all control at a millionth, redundancy numbers of 512 photos are right to 3e-6.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.sequential.hyper_row import HyperRow, ObservationRows
from orip.sequential.points_in_triangle import PointInTriangle
from orip.sequential.standing import Standing
from orip.sequential.triangle import Triangle

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
