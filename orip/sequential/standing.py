"""How the equations of an observation fit: residuals, redundancy numbers, and the fall of the square sum without it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray, IntArray

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
