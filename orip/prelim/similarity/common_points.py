"""Points whose coordinates are known in two systems, in full or in part."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.similarity import Similarity
from orip.prelim.sampling import median

LEAST_ERROR = 1e-3
"""Least standard deviation, as a part of the median, so that no coordinate decides alone."""


class CommonPoints(Struct, frozen=True):
    """n points in two systems.

    Parameters
    ----------
    source, target : arrays (n, 3)
        NaN in `target` where a coordinate is not known.
    source_deviation, target_deviation : arrays (n, 3)
        Standard deviations, each in its own system.
    trusted : array (n,) of bool
        Never weighted down: projection centres, which cannot be confused.
    """

    source: FloatArray
    target: FloatArray
    source_deviation: FloatArray
    target_deviation: FloatArray
    trusted: BoolArray

    @property
    def known(self) -> BoolArray:
        """Return which target coordinates are known, array (n, 3)."""
        return np.isfinite(self.target)

    @property
    def full(self) -> BoolArray:
        """Return which points are known in all three coordinates, array (n,)."""
        return np.asarray(self.known.all(axis=1))

    @property
    def arrays(self) -> tuple[FloatArray, ...]:
        """Return coordinates and deviations, as the compiled loops take them."""
        return tuple(
            map(np.ascontiguousarray, (self.source, self.target, self.source_deviation, self.target_deviation))
        )

    def of(self, rows: IntArray) -> CommonPoints:
        """Return some of the points."""
        return CommonPoints(
            self.source[rows],
            self.target[rows],
            self.source_deviation[rows],
            self.target_deviation[rows],
            self.trusted[rows],
        )

    @property
    def extent(self) -> float:
        """Return the root mean square distance of the points from their centroid in the target system."""
        known = self.known
        counts, target = known.sum(axis=0), np.where(known, self.target, 0.0)
        reduced = np.where(known, target - target.sum(axis=0) / counts, 0.0)
        return math.sqrt(float(((reduced**2).sum(axis=0) / counts).sum()))

    def errors(self, at: Similarity) -> FloatArray:
        """Return the standard deviations (n, 3) of differences in the target system."""
        moved = (at.scale**2) * (self.source_deviation**2 @ (at.rotation**2).T)
        errors = np.sqrt(moved + self.target_deviation**2)
        known = errors[self.known]
        positive = known[known > 0]
        return np.maximum(errors, LEAST_ERROR * median(positive) if positive.size else 1.0)
