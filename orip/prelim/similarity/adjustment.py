"""Adjustment of a spatial similarity by least squares with Danish weights.

Two systems rarely fit as well as the a-priori errors promise: points of a bad camera may fit twenty times worse. The
scale of the errors is therefore estimated from the residuals themselves, by the median, and never taken below 1;
residuals above three times it are down-weighted.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import LEAST_WEIGHT, MEDIAN_OF_NORMAL
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.similarity import UNKNOWNS, Similarity
from orip.prelim.compiled import LARGEST_TURN, kernels
from orip.prelim.similarity.common_points import LEAST_ERROR, CommonPoints

ALL_UNKNOWNS = np.arange(UNKNOWNS)
NO_ROTATION = np.arange(4)
"""Scale and shift: the rotation is held."""

_LIMIT = 3.0
"""Standard residuals up to this limit keep their weight."""

_SINGULAR = 1e-9
"""Smallest eigenvalue of the normal equations with unit diagonal: points off a line by a 30000th of their extent."""

_STEADY, _STEADY_WEIGHTS = 1e-4, 0.01
"""Last step in standard deviations of the unknowns, and change of a weight factor, at which the iterations end."""

_STEPS = 40
_FREE_STEPS = _STEPS // 2
"""Weights that still alternate after half of the steps are held."""

RULES = np.array(
    [_LIMIT, LEAST_WEIGHT, LEAST_ERROR, _SINGULAR, LARGEST_TURN, _STEPS, _FREE_STEPS, MEDIAN_OF_NORMAL],
    dtype=np.float64,
)
"""The constants as the compiled loop takes them: `SimilarityRules` in adjustment.h."""


NUMBERS_FOUND = 25
"""Of `SimilarityFound` in adjustment.h."""


class SimilarityAdjustment(Struct, frozen=True):
    """What an adjustment found; parameters as in `orip.records.preliminary.SimilarityStep`.

    Parameters
    ----------
    angles : array (3,)
        omega, phi, kappa of its rotation.
    shift_deviation, angle_deviation : arrays (3,)
        0 for what was held.
    residuals : array (n, 3)
        Transformed minus target; NaN where not known.
    weight_factor : array (n, 3)
        1 where not known.
    s0 : float
        Of the observations of full weight; 0 with no redundancy.
    """

    similarity: Similarity
    angles: FloatArray
    scale_deviation: float
    shift_deviation: FloatArray
    angle_deviation: FloatArray
    residuals: FloatArray
    weight_factor: FloatArray
    iterations: int
    s0: float

    @property
    def fits(self) -> BoolArray:
        """Return which points keep their full weight in all coordinates, array (n,)."""
        return np.asarray((self.weight_factor == 1.0).all(axis=1))

    @property
    def lengths(self) -> FloatArray:
        """Return the lengths (n,) of the residuals, of the coordinates that are known."""
        known = np.where(np.isnan(self.residuals), 0.0, self.residuals)
        return np.asarray(np.sqrt((known**2).sum(axis=1)))

    @property
    def max_residual(self) -> float:
        """Return the largest residual of full weight."""
        full = np.where(self.weight_factor == 1.0, np.abs(self.residuals), 0.0)
        return float(np.fmax.reduce(full, axis=None, initial=0.0))


def adjust_similarity(
    common: CommonPoints, start: Similarity, unknowns: IntArray = ALL_UNKNOWNS
) -> SimilarityAdjustment:
    """Adjust a similarity by Gauss-Newton with Danish weights for every coordinate.

    Parameters
    ----------
    unknowns : array of int
        `ALL_UNKNOWNS` or `NO_ROTATION`.

    Raises
    ------
    ValueError
        When the coordinates are fewer than the unknowns or do not determine them.
    """
    if np.count_nonzero(common.known) < len(unknowns):
        message = f"{np.count_nonzero(common.known)} coordinates, {len(unknowns)} are needed"
        raise ValueError(message)
    return _adjustment(common, start, unknowns)


def _adjustment(common: CommonPoints, start: Similarity, unknowns: IntArray) -> SimilarityAdjustment:
    found, shape = np.empty(NUMBERS_FOUND), common.source.shape
    found[0], found[1:10], found[10:13] = start.scale, start.rotation.ravel(), start.shift
    factors, residuals, space = np.empty(shape), np.empty(shape), np.empty((4, *shape))
    if not kernels.adjust_similarity(
        *common.arrays, common.trusted, RULES, found, factors, residuals, space, len(unknowns),
    ):  # fmt: skip
        message = "the points do not determine the transformation"
        raise ValueError(message)
    return adjustment_of(found, residuals, factors)


def adjustment_of(found: FloatArray, residuals: FloatArray, factors: FloatArray) -> SimilarityAdjustment:
    """Return an adjustment as the compiled loops leave it: `SimilarityFound` in adjustment.h."""
    scale, scale_deviation, s0, iterations = found[[0, 16, 23, 24]].tolist()
    return SimilarityAdjustment(
        Similarity(scale, found[1:10].reshape(3, 3), found[10:13]), found[13:16], scale_deviation, found[17:20],
        found[20:23], residuals, factors, int(iterations), s0,
    )  # fmt: skip
