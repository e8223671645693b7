"""Points known in two systems, adjustment of a similarity between them by least squares, and points that do not fit.

Two systems rarely fit as well as the a-priori errors promise: points of a bad camera may fit twenty times worse. The
scale of the errors is therefore estimated from the residuals themselves, by the median, and never taken below 1;
residuals above three times it are down-weighted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import LEAST_WEIGHT, MEDIAN_OF_NORMAL
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.similarity import UNKNOWNS, Similarity
from orip.prelim.compiled import LARGEST_TURN, kernels
from orip.prelim.rays import ImageRays
from orip.prelim.sampling import median
from orip.wording import counted

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


_NAMED = 6
"""Number of points that are named one by one."""

_FOR_BENDING = 12
"""Common points from which on it can be told whether they are off as bent strips are: twice the coefficients."""

_STANDING_OUT = 5.0
"""Median difference from the bent strip above which a point does not belong to it: 7.7 standard deviations."""

_BENT = 0.6
"""Ratio of median residuals after and before below which strips are bent: polynomials alone leave 0.8."""

_DISTORTION = 0.005
"""Part of the largest photo coordinate that a camera which is not calibrated displaces images by."""

_ROUNDS, _LEAST_LENGTH = 20, 1e-12
"""Rounds of reweighting; and a length that is none."""

_MM = 1000.0
"""Millimetres in a metre."""


def room_for_cameras(rays: object, photos: Sequence[int]) -> float:
    """Return how far points of photos may be off at photo scale (m) as cameras are not calibrated; 0: they are."""
    if not isinstance(rays, ImageRays) or not len(rays.cameras.of_photo):
        return 0.0
    is_unknown = bool((rays.cameras.of_photo[list(photos)] >= 0).any())
    return _DISTORTION * float(np.abs(rays.xy).max()) / _MM if is_unknown else 0.0


def misfits(points: Sequence[str], coordinates: FloatArray, found: SimilarityAdjustment, room: float) -> list[str]:
    """Return a sentence for each point that does not fit, for the first few of many.

    Parameters
    ----------
    points : sequence of str, length n
    coordinates : array (n, 3)
    room : float
        How far points may be off as the cameras are not calibrated; those that are off by more are not named where
        their neighbours are off alike.
    """
    fits, off_by = found.fits[: len(points)], found.lengths[: len(points)]
    lengths, is_bent = off_by, np.zeros(len(points), dtype=bool)
    if room:
        left = np.linalg.norm(unbent(coordinates, found.residuals[: len(points)]), axis=1)
        is_bent = ~fits & (off_by <= room)
        if median(left) < _BENT * median(off_by):
            lengths, is_bent = left, is_bent | (~fits & (left <= _STANDING_OUT * median(left)))
    sentences = _standing_out(points, lengths, fits | is_bent)
    if is_bent.any():
        most = float(off_by[is_bent].max()) * _MM
        of_points = f"{counted(int(is_bent.sum()), 'point')} off by up to {most:.2g} mm at photo scale"
        sentences.append(f"{of_points}, as they are where the camera is not calibrated: no point need be wrong")
    return sentences


def _standing_out(points: Sequence[str], lengths: FloatArray, fits: BoolArray) -> list[str]:
    if fits.all():
        return []
    usual = lengths[fits]
    others = f" (the others: {float(np.sqrt(np.mean(usual**2))) * _MM:.2g} mm)" if len(usual) else ""
    off = [k for k in np.argsort(-lengths) if not fits[k]]
    sentences = [
        f"point {points[k]} does not fit: it is off by {lengths[k] * _MM:.2g} mm at photo scale{others}"
        for k in off[:_NAMED]
    ]
    return [*sentences, f"{len(off) - _NAMED} more points do not fit"] if len(off) > _NAMED else sentences


def unbent(coordinates: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return what residuals (n, 3) at coordinates (n, 3) differ from a bent strip by.

    Errors of the camera bend strips: residuals of their connection follow polynomials of the second order in the plane
    of the points, as in the adjustment of strips by polynomials (Schut 1964). They are fitted with weights that fall
    above the median difference, so that no wrong point leads them. Fewer points than `_FOR_BENDING` are taken as they
    are.
    """
    if len(coordinates) < _FOR_BENDING:
        return residuals
    centred = coordinates - coordinates.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    x, y = (centred @ axes[:2].T).T / max(float(np.abs(centred).max()), _LEAST_LENGTH)
    design = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    weight, left = np.ones(len(x)), residuals
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)[:, None]
        polynomials, *_ = np.linalg.lstsq(design * root, residuals * root, rcond=None)
        left = residuals - design @ polynomials
        lengths = np.linalg.norm(left, axis=1)
        weight = 1.0 / np.maximum(lengths / max(median(lengths), _LEAST_LENGTH), 1.0)
    return np.asarray(left)
