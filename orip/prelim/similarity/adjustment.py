"""Adjustment of a spatial similarity by least squares with Danish weights.

Two systems rarely fit as well as the a-priori errors promise: points of a bad camera may fit twenty times worse. The
scale of the errors is therefore estimated from the residuals themselves, by the median, and never taken below 1;
residuals above three times it are down-weighted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import LEAST_WEIGHT, MEDIAN_OF_NORMAL, danish_weights
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation
from orip.geometry.similarity import (
    UNKNOWNS,
    Similarities,
    Similarity,
    similarity_with_partials,
)
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.least_squares import LARGEST_TURN, GaussNewton, least_squares, shortened
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
    similarity : Similarity
    angles : array (3,)
        omega, phi, kappa of its rotation.
    scale_deviation : float
    shift_deviation, angle_deviation : arrays (3,)
        0 for what was held.
    residuals : array (n, 3)
        Transformed minus target; NaN where not known.
    weight_factor : array (n, 3)
        1 where not known.
    iterations : int
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
    common : CommonPoints
    start : Similarity
    unknowns : array of int
        `ALL_UNKNOWNS` or `NO_ROTATION`.

    Returns
    -------
    SimilarityAdjustment

    Raises
    ------
    ValueError
        When the coordinates are fewer than the unknowns or do not determine them.
    """
    if np.count_nonzero(common.known) < len(unknowns):
        message = f"{np.count_nonzero(common.known)} coordinates, {len(unknowns)} are needed"
        raise ValueError(message)
    return (_compiled_adjustment(common, start, unknowns) if is_compiled() else None) or _adjustment(
        common, start, unknowns
    )


def _compiled_adjustment(common: CommonPoints, start: Similarity, unknowns: IntArray) -> SimilarityAdjustment | None:
    """Do what `_adjustment` does in the compiled loop; None where the equations may not be regular."""
    found, shape = np.empty(NUMBERS_FOUND), common.source.shape
    found[0], found[1:10], found[10:13] = start.scale, start.rotation.ravel(), start.shift
    factors, residuals, space = np.empty(shape), np.empty(shape), np.empty((4, *shape))
    if not kernels.adjust_similarity(
        *common.arrays, common.trusted, RULES, found, factors, residuals, space, len(unknowns),
    ):  # fmt: skip
        return None
    return adjustment_of(found, residuals, factors)


def adjustment_of(found: FloatArray, residuals: FloatArray, factors: FloatArray) -> SimilarityAdjustment:
    """Return an adjustment as the compiled loops leave it: `SimilarityFound` in adjustment.h."""
    scale, scale_deviation, s0, iterations = found[[0, 16, 23, 24]].tolist()
    return SimilarityAdjustment(
        Similarity(scale, found[1:10].reshape(3, 3), found[10:13]), found[13:16], scale_deviation, found[17:20],
        found[20:23], residuals, factors, int(iterations), s0,
    )  # fmt: skip


def _adjustment(common: CommonPoints, start: Similarity, unknowns: IntArray) -> SimilarityAdjustment:
    problem = _SimilarityProblem(common, start, unknowns)
    found = least_squares(problem, problem.start, GaussNewton(), _STEPS, reweightings=_FREE_STEPS - 1)
    return problem.result(found.best, found.iterations)


class _Estimate(NamedTuple):
    """One similarity of the points reduced to their centroid.

    Attributes
    ----------
    at : Similarities
        One.
    residual : array (1, k)
        Transformed minus target over the standard deviation, of the k known coordinates.
    design : array (1, k, u)
        Partials of the residuals.
    weights : array (1, k)
    step : float
        Length of the step that led here, in standard deviations of the unknowns.
    """

    at: Similarities
    residual: FloatArray
    design: FloatArray
    weights: FloatArray
    step: float


class _SimilarityProblem:
    """The adjustment of one similarity; source points are reduced to their centroid, so that the shift is its image."""

    def __init__(self, common: CommonPoints, start: Similarity, unknowns: IntArray) -> None:
        self.common, self.unknowns = common, unknowns
        self.centroid = common.source.mean(axis=0)
        self.reduced = common.source - self.centroid
        self.known = common.known
        self.errors = common.errors(start)[self.known]
        self.trusted = np.repeat(common.trusted[:, None], 3, axis=1)[self.known]
        self.redundancy = len(self.errors) - len(unknowns)
        at = Similarities(np.array([start.scale]), start.rotation[None], np.asarray(start.apply(self.centroid))[None])
        self.start = self.reweighted(self._linearised(at, np.ones((1, len(self.errors))), np.inf))

    def _linearised(self, at: Similarities, weights: FloatArray, step: float) -> _Estimate:
        found = similarity_with_partials(at, self.reduced)
        residual = (found.value - self.common.target)[:, self.known] / self.errors
        design = found.by_unknowns[:, self.known][:, :, self.unknowns] / self.errors[:, None]
        return _Estimate(at, residual, design, weights, step)

    def reweighted(self, here: _Estimate) -> _Estimate:
        residual = np.abs(here.residual[0])
        if self.redundancy <= 0 or self.trusted.all():
            return here._replace(weights=np.ones((1, len(residual))))
        shrunk = np.sqrt(len(residual) / self.redundancy)
        scale = float(np.median(residual[~self.trusted])) * shrunk / MEDIAN_OF_NORMAL
        limit = _LIMIT if scale <= 1.0 else scale * student_limit(self.redundancy)
        return here._replace(weights=np.where(self.trusted, 1.0, danish_weights(residual, limit))[None])

    def stepped(self, here: _Estimate, _damping: FloatArray) -> _Estimate:
        factors, residual, design = here.weights[0], here.residual[0], here.design[0]
        normal, scaling = _scaled_normals(design, factors)
        right = scaling * (design.T @ (factors * residual))
        change = -np.linalg.solve(normal, right)
        step = float(np.sqrt(max(0.0, -float(change @ right)) / len(self.unknowns)))
        changes = np.zeros((1, UNKNOWNS))
        changes[0, self.unknowns] = change * scaling
        changes = shortened(changes, np.linalg.norm(changes[:, 4:], axis=1))
        return self._linearised(here.at.moved(changes), here.weights, step)

    def costs(self, here: _Estimate, weights: FloatArray) -> FloatArray:
        return np.asarray((weights * here.residual**2).sum(axis=1))

    def converged(self, before: _Estimate, after: _Estimate) -> bool:
        return after.step < _STEADY and bool(np.abs(after.weights - before.weights).max() < _STEADY_WEIGHTS)

    def result(self, end: _Estimate, iterations: int) -> SimilarityAdjustment:
        at, residual, design, factors = end.at, end.residual[0], end.design[0], end.weights[0]
        normal, scaling = _scaled_normals(design, factors)
        cofactor = scaling[:, None] * np.linalg.inv(normal) * scaling
        s0 = _unit_weight_error(residual, design, factors, cofactor)
        similarity = Similarity(
            float(at.scale[0]), at.rotation[0], at.shift[0] - at.scale[0] * (at.rotation[0] @ self.centroid)
        )
        covariance = np.zeros((UNKNOWNS, UNKNOWNS))
        covariance[np.ix_(self.unknowns, self.unknowns)] = cofactor * (1.0 if s0 is None else s0**2)
        angles = angles_from_rotation(similarity.rotation)
        deviations = _deviations(similarity, angles, self.centroid, covariance)
        residuals, weights = np.full(self.known.shape, np.nan), np.ones(self.known.shape)
        residuals[self.known], weights[self.known] = residual * self.errors, factors
        return SimilarityAdjustment(
            similarity,
            angles,
            float(deviations[0]),
            deviations[1:4],
            deviations[4:],
            residuals,
            weights,
            iterations,
            s0 or 0.0,
        )


def _unit_weight_error(
    residual: FloatArray, design: FloatArray, factors: FloatArray, cofactor: FloatArray
) -> float | None:
    """Return the standard error of unit weight from the observations of full weight; None without redundancy."""
    redundancy = 1.0 - factors * ((design @ cofactor) * design).sum(axis=1)
    full = factors == 1.0
    used = float(redundancy[full].sum())
    # redundancy numbers add up to whole numbers apart from rounding
    return float(np.sqrt((residual[full] ** 2).sum() / used)) if used > 1e-6 else None


def _scaled_normals(design: FloatArray, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations with unit diagonal, and the scaling of the unknowns that made it."""
    normal = design.T @ (factors[:, None] * design)
    diagonal = np.diag(normal)
    if not (diagonal > 0.0).all():
        message = "the points do not determine the transformation"
        raise ValueError(message)
    scaling = 1.0 / np.sqrt(diagonal)
    normal = scaling[:, None] * normal * scaling
    if np.linalg.eigvalsh(normal)[0] < _SINGULAR:
        message = "the points do not determine the transformation"
        raise ValueError(message)
    return normal, scaling


def _deviations(similarity: Similarity, angles: FloatArray, centroid: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the deviations of scale, shift and angles from the covariance of the unknowns at the centroid."""
    unit = Similarities(np.array([similarity.scale]), similarity.rotation[None], np.zeros((1, 3)))
    lever = similarity_with_partials(unit, centroid[None]).by_unknowns[0, 0]
    change = np.eye(UNKNOWNS)
    change[0, 0] = similarity.scale
    # T = (image of the centroid) - m R centroid
    change[1:4, 0], change[1:4, 4:] = -lever[:, 0], -lever[:, 4:]
    change[4:, 4:] = angle_rates_from_axes_rotation(angles)
    return np.asarray(np.sqrt(np.maximum(np.diag(change @ covariance @ change.T), 0.0)))


def student_limit(redundancy: float) -> float:
    """Return the limit that a residual exceeds as rarely as a normal one exceeds 3, for s0 of small redundancy.

    Expansion of Student's distribution (Abramowitz and Stegun 1964, 26.7.5).
    """
    z = _LIMIT
    first, second = (z**3 + z) / 4.0, (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    return z + first / redundancy + second / redundancy**2
