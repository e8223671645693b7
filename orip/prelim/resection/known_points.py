"""The known points of a photo, and how well orientations of the photo agree with them."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray, IntArray

FEW_BLUNDERS, MANY_BLUNDERS = 0.35, 0.7
"""Largest part of the points that may be blunders: of measured points, and of tracks, in which the known points may be
wrong, too."""


class Orientations(NamedTuple):
    """Rotations (k, 3, 3), photo to ground, and projection centres (k, 3)."""

    rotations: FloatArray
    centres: FloatArray

    def of(self, rows: IntArray | BoolArray | slice) -> Orientations:
        """Return some of them."""
        return Orientations(self.rotations[rows], self.centres[rows])

    def joined(self, others: Orientations) -> Orientations:
        """Return these followed by others."""
        return Orientations(
            np.concatenate([self.rotations, others.rotations]), np.concatenate([self.centres, others.centres])
        )


class KnownPoints(Struct, frozen=True, dict=True):
    """n known points of a photo, from their centroid and in units of their spread: all ground systems are then alike.

    Parameters
    ----------
    vectors : array (n, 3)
        Image vectors (x, y, -C), mm.
    coordinates : array (n, 3)
    deviations : array (n,)
        Standard deviation of a coordinate.
    error_mm : float
        A-priori error of a photo coordinate.
    blunders : float
        Largest part of the points that may be blunders.
    """

    vectors: FloatArray
    coordinates: FloatArray
    deviations: FloatArray
    error_mm: float
    blunders: float = FEW_BLUNDERS

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.coordinates)

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return vectors, coordinates and deviations, as the compiled loops take them."""
        return tuple(map(np.ascontiguousarray, (self.vectors, self.coordinates, self.deviations)))  # type: ignore[return-value]

    @property
    def variance_of_least(self) -> float:
        """Return the variance of unit weight over the sum of the smallest squared residuals that have to fit.

        The mean of the smallest part q of exponentially distributed squares is 1 + (1 - q) ln(1 - q) / q times that of
        all of them.
        """
        count, least = len(self), self.least
        left_out = 1.0 - least / count
        share = 1.0 + (left_out * math.log(left_out) / (1.0 - left_out) if left_out > 0.0 else 0.0)
        return count / max(count - 3, 1) / (2.0 * least * share)

    @cached_property
    def least(self) -> int:
        """Return the number of points that have to fit."""
        return number_that_fits(len(self), self.blunders)

    def squares(self, at: Orientations) -> FloatArray:
        """Return squared standardised residuals (k, n) of orientations; infinite behind the photo."""
        in_photo = self.coordinates @ at.rotations - at.centres[:, None] @ at.rotations
        ahead = np.where(in_photo[:, :, 2] < 0.0, -in_photo[:, :, 2], np.inf)
        scale = -self.vectors[:, 2] / ahead
        residual = in_photo[:, :, :2] * scale[:, :, None] - self.vectors[:, :2]
        variance = self.error_mm**2 + (scale * self.deviations) ** 2
        return np.where(np.isfinite(ahead), np.sum(residual**2, axis=2) / variance, np.inf)

    def fitting(self, squares: FloatArray) -> FloatArray:
        """Return weights (k, n): 1 for the points that fit best, 0 for the others and those behind the photo."""
        limit = _smallest(squares, self.least).max(axis=1, keepdims=True)
        return np.where((squares <= limit) & np.isfinite(squares), 1.0, 0.0)

    def trimmed_variance(self, squares: FloatArray) -> FloatArray:
        """Return the variances of unit weight (k,) estimated from the smallest squared residuals (k, n)."""
        return np.asarray(self.variance_of_least * _smallest(squares, self.least).sum(axis=1))

    def costs(self, squares: FloatArray) -> FloatArray:
        """Return the costs (k,) of orientations: sums of squared residuals (k, n), each counted up to the limit.

        In units of the least variance among the orientations, or of the a-priori one.
        """
        # finite even where all points are behind the photo
        variance = min(max(float(self.trimmed_variance(squares).min()), 1.0), 1e300)
        return np.asarray(np.minimum(squares / variance, LIMIT_OF_TWO_COMPONENTS**2).sum(axis=1))


def number_that_fits(count: int, blunders: float) -> int:
    """Return how many of `count` points have to fit if such a part of them may be blunders."""
    return max(count - int(blunders * count), min(count, 4))


def _smallest(squares: FloatArray, number: int) -> FloatArray:
    return np.asarray(np.partition(squares, number - 1, axis=1)[:, :number])
