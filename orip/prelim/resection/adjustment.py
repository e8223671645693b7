"""Least squares of the space resection: many orientations of one photo at once, on the points that fit them best."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from orip.adjustment.weights import danish_weights
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.perspective import perspective_with_partials
from orip.geometry.rotation import rotation_about_axes

_BLUNDERS = 0.35
"""Largest part of the points that may be blunders."""

IMPROVEMENTS = 3
"""Steps of trimmed least squares: enough to tell good starts from bad ones."""

ITERATIONS = 30
STEADY = 1e-6
"""Last correction, radians and parts of the points' spread: what follows it is of the order of its square."""

SAME_SCALE = 1.04
"""Ratio of two estimates of the variance that give the same limit for blunders."""

LIMIT = 3.5
"""3.5: of residuals with two components one good one in 460 is longer."""

_LARGEST_TURN = 0.5
"""Radians in one iteration: further than that the linearisation means nothing."""


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


@dataclass(frozen=True)
class KnownPoints:
    """n known points of a photo, in units of their own spread, from their centroid: all ground systems are alike then.

    Parameters
    ----------
    vectors : array (n, 3)
        Image vectors (x, y, -C), mm.
    coordinates : array (n, 3)
    deviations : array (n,)
        Standard deviation of a coordinate.
    error_mm : float
        A-priori error of a photo coordinate.
    """

    vectors: FloatArray
    coordinates: FloatArray
    deviations: FloatArray
    error_mm: float

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

        The mean of the smaller part q of exponentially distributed squares is 1 + (1 - q) ln(1 - q) / q of that of all.
        """
        count, least = len(self), self.least
        left_out = 1.0 - least / count
        share = 1.0 + (left_out * math.log(left_out) / (1.0 - left_out) if left_out > 0.0 else 0.0)
        return count / max(count - 3, 1) / (2.0 * least * share)

    @cached_property
    def least(self) -> int:
        """Return the number of points that have to fit."""
        return max(len(self) - int(_BLUNDERS * len(self)), min(len(self), 4))

    def squares(self, at: Orientations) -> FloatArray:
        """Return squared standardised residuals (k, n) of orientations; infinite behind the photo."""
        in_photo = self.coordinates @ at.rotations - at.centres[:, None] @ at.rotations
        ahead = np.where(in_photo[:, :, 2] < 0.0, -in_photo[:, :, 2], np.inf)
        scale = -self.vectors[:, 2] / ahead
        residual = in_photo[:, :, :2] * scale[:, :, None] - self.vectors[:, :2]
        variance = self.error_mm**2 + (scale * self.deviations) ** 2
        return np.where(np.isfinite(ahead), np.sum(residual**2, axis=2) / variance, np.inf)

    def trimmed_variance(self, squares: FloatArray) -> FloatArray:
        """Return the variances of unit weight (k,) that the smallest of squared residuals (k, n) tell of."""
        return np.asarray(self.variance_of_least * _smallest(squares, self.least).sum(axis=1))

    def costs(self, squares: FloatArray) -> FloatArray:
        """Return what orientations cost (k,): the sums of squared residuals (k, n), each blunder at the limit of one.

        In units of the least variance among the orientations, or of the a-priori one.
        """
        # finite even where all points are behind the photo
        variance = min(max(float(self.trimmed_variance(squares).min()), 1.0), 1e300)
        return np.asarray(np.minimum(squares / variance, LIMIT**2).sum(axis=1))


class Linearised(NamedTuple):
    """The equations of k orientations and n points.

    Attributes
    ----------
    residual : array (k, n, 2)
        Computed minus measured, mm.
    partials : array (k, n, 2, 6)
        By rotations about the ground axes and by the projection centre.
    in_front : array (k, n) of bool
    variance : array (k, n)
        Of a residual, mm².
    """

    residual: FloatArray
    partials: FloatArray
    in_front: BoolArray
    variance: FloatArray

    @property
    def squares(self) -> FloatArray:
        """Return the squared standardised residuals (k, n); infinite behind the photo."""
        return np.where(self.in_front, np.sum(self.residual**2, axis=2) / self.variance, np.inf)

    def replaced(self, rows: BoolArray, other: Linearised) -> Linearised:
        """Return the equations with those of some orientations (k,) taken from others."""
        pairs = zip(other, self, strict=True)
        return Linearised(*(np.where(rows.reshape(-1, *[1] * (new.ndim - 1)), new, old) for new, old in pairs))


class Adjusted(NamedTuple):
    """One adjusted orientation.

    Attributes
    ----------
    at : Orientations
        One.
    residual : array (n, 2)
        Computed minus measured, mm.
    squares : array (n,)
        Squared standardised residuals; infinite behind the photo.
    weight_factors : array (n,)
    normals : array (6, 6)
        Normal equations of rotations about the ground axes and projection centre.
    """

    at: Orientations
    residual: FloatArray
    squares: FloatArray
    weight_factors: FloatArray
    normals: FloatArray

    @property
    def redundancy(self) -> int:
        """Return the redundancy of the points with full weight."""
        return max(_redundancy(self.weight_factors), 0)

    @property
    def s0(self) -> float:
        """Return the standard error of unit weight; 1 without redundancy."""
        return math.sqrt(_variance(self.squares, self.weight_factors))


def improved(known: KnownPoints, start: Orientations) -> tuple[Orientations, FloatArray]:
    """Improve k orientations by least trimmed squares (Rousseeuw and Van Driessen 1999).

    Parameters
    ----------
    known : KnownPoints
    start : Orientations

    Returns
    -------
    Orientations
        Not iterated to the end.
    array (k, n)
        Their squared standardised residuals.
    """
    at, here = start, _linearise(known, start)
    damping = np.full(len(start.centres), 1e-3)
    for _ in range(IMPROVEMENTS):
        correction, _ = _solve(here, _fits(here.squares, known.least), damping)
        moved = _moved(at, correction)
        there = _linearise(known, moved)
        better = known.trimmed_variance(there.squares) <= known.trimmed_variance(here.squares)
        damping = np.where(better, damping * 0.1, damping * 10.0)
        at = Orientations(
            np.where(better[:, None, None], moved.rotations, at.rotations),
            np.where(better[:, None], moved.centres, at.centres),
        )
        here = here.replaced(better, there)
    return at, here.squares


def adjusted(known: KnownPoints, start: Orientations, variance: float) -> Adjusted:
    """Adjust one orientation with the weights of the Danish method, one a point.

    Parameters
    ----------
    known : KnownPoints
    start : Orientations
        One.
    variance : float
        Of unit weight: what is a blunder depends on it. It is estimated anew from the points that are none.

    Returns
    -------
    Adjusted
    """
    at, limit = start, max(variance, 1.0)
    for iteration in range(ITERATIONS):
        here = _linearise(known, at)
        factors = danish_weights(np.sqrt(here.squares / limit), LIMIT)
        correction, _ = _solve(here, factors, np.zeros(1))
        at = _moved(at, correction)
        if np.abs(correction).max() < STEADY:
            estimated = max(_variance(here.squares[0], factors[0]), 1.0)
            if 1.0 / SAME_SCALE < estimated / limit < SAME_SCALE or iteration > ITERATIONS // 2:
                break
            limit = estimated
    end = _linearise(known, at)
    _, normals = _solve(end, factors, np.zeros(1))
    return Adjusted(at, end.residual[0], end.squares[0], factors[0], normals[0])


def _linearise(known: KnownPoints, at: Orientations) -> Linearised:
    many, count = len(at.centres), len(known)
    offset = (known.coordinates - at.centres[:, None]).reshape(-1, 3)
    principal_distance = np.tile(-known.vectors[:, 2], many)
    image = perspective_with_partials(offset, np.repeat(at.rotations, count, axis=0), principal_distance)
    scale = (principal_distance / np.linalg.norm(offset, axis=1)).reshape(many, count)
    return Linearised(
        image.xy.reshape(many, count, 2) - known.vectors[:, :2],
        np.concatenate([image.by_rotation, -image.by_point], axis=2).reshape(many, count, 2, 6),
        image.in_front.reshape(many, count),
        known.error_mm**2 + (scale * known.deviations) ** 2,
    )


def _solve(equations: Linearised, weights: FloatArray, damping: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return corrections (k, 6) and normal matrices (k, 6, 6); `damping` (k,) enlarges the diagonal."""
    many = len(weights)
    root = np.sqrt(np.where(equations.in_front, weights / equations.variance, 0.0))[:, :, None]
    design = (equations.partials * root[..., None]).reshape(many, -1, 6)
    misclosure = (equations.residual * root).reshape(many, -1, 1)
    transposed = np.swapaxes(design, 1, 2)
    normals = transposed @ design
    diagonal = np.einsum("kii->ki", normals)
    # what nothing determines stays where it is
    floor = 1e-13 * diagonal.max(axis=1, keepdims=True) + 1e-300
    damped = normals + (damping[:, None] * diagonal + floor)[:, :, None] * np.eye(6)
    return -np.linalg.solve(damped, transposed @ misclosure)[:, :, 0], normals


def _moved(at: Orientations, correction: FloatArray) -> Orientations:
    turn = np.linalg.norm(correction[:, :3], axis=1)
    correction = correction * np.minimum(1.0, _LARGEST_TURN / np.maximum(turn, 1e-300))[:, None]
    return Orientations(rotation_about_axes(correction[:, :3]) @ at.rotations, at.centres + correction[:, 3:])


def _smallest(squares: FloatArray, number: int) -> FloatArray:
    return np.asarray(np.partition(squares, number - 1, axis=1)[:, :number])


def _fits(squares: FloatArray, number: int) -> FloatArray:
    """Return weights (k, n): 1 for the points that fit best, 0 for the others and those behind."""
    limit = _smallest(squares, number).max(axis=1, keepdims=True)
    return np.where((squares <= limit) & np.isfinite(squares), 1.0, 0.0)


def _redundancy(factors: FloatArray) -> int:
    return 2 * int(np.count_nonzero(factors == 1.0)) - 6


def _variance(squares: FloatArray, factors: FloatArray) -> float:
    """Return the variance of unit weight from the points with full weight; 1 without redundancy."""
    redundancy = _redundancy(factors)
    return float(squares[factors == 1.0].sum()) / redundancy if redundancy > 0 else 1.0
