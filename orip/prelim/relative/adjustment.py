"""Least squares adjustment of relative orientations: five unknowns, parallaxes as observations, Danish weights.

The unknowns are two components of the base across itself and a small rotation of the right photo: no direction of the
base and no rotation is singular. Several starts are adjusted side by side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.adjustment.weights import LEAST_WEIGHT, danish_weights
from orip.arrays import BoolArray, FloatArray
from orip.geometry.essential import TwoPhotos
from orip.geometry.rotation import rotation_about_axes
from orip.prelim.least_squares import GaussNewton, enlarged_diagonal, least_squares, shortened
from orip.prelim.relative.parallax import Pairs, Parallaxes, parallaxes_with_partials

MAX_STANDARD_RESIDUAL = 5.0

_CONVERGED = 1e-9
"""Correction, in standard deviations of the unknowns, at which iterations end; rounding leaves some 1e-11."""

_WEIGHTS_HELD = 12
"""Iteration after which weights are held: one that alternates at the limit would never converge."""

_REWEIGHTINGS = _WEIGHTS_HELD - 1

_LONGEST_STEP = 0.3
"""Largest rotation of one step, radians: from a poor start the linear step may lead anywhere."""

_REGULAR = 1e-13
"""Part of the trace added to the diagonal, so that the equations can be solved where five points determine nothing."""

DANISH = (MAX_STANDARD_RESIDUAL, LEAST_WEIGHT, _CONVERGED, _LONGEST_STEP, _REGULAR, _WEIGHTS_HELD)
"""The constants as the compiled loop takes them: `RelativeDanish` in pair_loops.h."""


class AdjustedPairs(NamedTuple):
    """k relative orientations after the adjustment.

    Attributes
    ----------
    photos : TwoPhotos
        k bases and rotations.
    parallax : array (k, n)
        mm.
    weight_factor : array (k, n)
    iterations : int
    """

    photos: TwoPhotos
    parallax: FloatArray
    weight_factor: FloatArray
    iterations: int

    def residuals(self, pairs: Pairs) -> FloatArray:
        """Return the absolute parallaxes in units of their a-priori error, array (k, n)."""
        return np.abs(self.parallax) / pairs.error


class RelativePrecision(NamedTuple):
    """How well the points determine the adjusted orientation.

    Attributes
    ----------
    redundancy_number : array (n,)
        Of the parallaxes.
    cofactor : array (6, 6)
        Of the unit base (nothing along itself) and of a small rotation about the left photo's axes.
    """

    redundancy_number: FloatArray
    cofactor: FloatArray


def adjust_relative(start: TwoPhotos, pairs: Pairs, scale: FloatArray | float, max_iterations: int) -> AdjustedPairs:
    """Adjust k relative orientations.

    Parameters
    ----------
    start : TwoPhotos
        k bases and rotations.
    pairs : Pairs
    scale : float or array (k,)
        Residuals are weighted down above five times their a-priori error times this scale.
    max_iterations : int
        Fewer where no correction is larger than 1e-9 standard deviations of its unknown.

    Returns
    -------
    AdjustedPairs
    """
    problem = _ParallaxProblem(pairs, scale, len(start.base))
    found = least_squares(problem, problem.start(start), GaussNewton(), max_iterations, reweightings=_REWEIGHTINGS)
    best = found.best
    return AdjustedPairs(best.photos, best.parallaxes.value, best.weights, found.iterations)


class _Estimate(NamedTuple):
    """k orientations, their parallaxes with partials, weights (k, n), and squared lengths (k,) of the last steps."""

    photos: TwoPhotos
    parallaxes: Parallaxes
    weights: FloatArray
    squared_step: FloatArray


class _ParallaxProblem:
    """The parallaxes of n points, from k starts side by side."""

    def __init__(self, pairs: Pairs, scale: FloatArray | float, starts: int) -> None:
        self._pairs = pairs
        self._unit = pairs.error * np.broadcast_to(np.asarray(scale, dtype=np.float64), starts)[:, None]

    def start(self, photos: TwoPhotos) -> _Estimate:
        nowhere = np.full(len(photos.base), np.inf)
        return self.reweighted(_Estimate(photos, parallaxes_with_partials(photos, self._pairs), np.empty(0), nowhere))

    def stepped(self, at: _Estimate, _damping: FloatArray) -> _Estimate:
        design, across = _design(at.photos, self._pairs, at.parallaxes)
        weighted = np.swapaxes(design * at.weights[..., None], 1, 2)
        right = weighted @ (-at.parallaxes.value / self._pairs.error)[..., None]
        step = np.asarray(np.linalg.solve(_regular(weighted @ design), right)[..., 0], dtype=np.float64)
        photos = _moved(at.photos, across, step)
        # the squared correction in standard deviations, dx^T N dx, is dx^T right at the solution
        squared_step = (step * right[..., 0]).sum(axis=1)
        return _Estimate(photos, parallaxes_with_partials(photos, self._pairs), at.weights, squared_step)

    def reweighted(self, at: _Estimate) -> _Estimate:
        return at._replace(weights=danish_weights(np.abs(at.parallaxes.value) / self._unit, MAX_STANDARD_RESIDUAL))

    def costs(self, at: _Estimate, weights: FloatArray) -> FloatArray:
        return np.asarray((weights * (at.parallaxes.value / self._pairs.error) ** 2).sum(axis=1))

    def converged(self, _before: _Estimate, after: _Estimate) -> BoolArray:
        return after.squared_step < _CONVERGED**2


def precision_of(adjusted: AdjustedPairs, pairs: Pairs) -> RelativePrecision:
    """Return redundancy numbers and cofactors of one adjusted orientation, from the a-priori errors."""
    photos, weights = adjusted.photos, adjusted.weight_factor
    design, across = _design(photos, pairs, parallaxes_with_partials(photos, pairs))
    inverse = np.linalg.inv(_regular(np.swapaxes(design * weights[..., None], 1, 2) @ design))
    redundancy = 1.0 - weights * ((design @ inverse) * design).sum(axis=-1)
    whole = np.zeros((6, 5))
    whole[:3, :2] = across[0]
    whole[3:, 2:] = np.eye(3)
    return RelativePrecision(np.maximum(redundancy[0], 0.0), whole @ inverse[0] @ whole.T)


def _design(photos: TwoPhotos, pairs: Pairs, found: Parallaxes) -> tuple[FloatArray, FloatArray]:
    """Return the design matrices (k, n, 5) in units of the a-priori error, and the directions across the bases."""
    across = _across(photos.base)
    design = np.concatenate([found.by_base @ across, found.by_rotation], axis=-1) / pairs.error[:, None]
    return design, across


def _across(base: FloatArray) -> FloatArray:
    """Return two directions (k, 3, 2) across each of k bases."""
    return np.asarray(np.linalg.qr(base[..., None], mode="complete")[0][..., 1:])


def _regular(normals: FloatArray) -> FloatArray:
    return enlarged_diagonal(normals, 0.0, _REGULAR * np.trace(normals, axis1=1, axis2=2))


def _moved(photos: TwoPhotos, across: FloatArray, step: FloatArray) -> TwoPhotos:
    step = shortened(step, np.abs(step).max(axis=1), _LONGEST_STEP)
    base = photos.base + (across @ step[:, :2, None])[..., 0]
    base /= np.linalg.norm(base, axis=1, keepdims=True)
    return TwoPhotos(base, rotation_about_axes(step[:, 2:]) @ photos.rotation)
