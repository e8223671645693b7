"""Least squares adjustment of relative orientations: five unknowns, parallaxes as observations, Danish weights.

The unknowns are two components of the base across itself and a small rotation of the right photo: no direction of the
base and no rotation is special. Several starts are adjusted side by side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.adjustment.weights import danish_weights
from orip.arrays import FloatArray
from orip.geometry.essential import TwoPhotos
from orip.geometry.rotation import cross_matrix, rotation_about_axes
from orip.prelim.compiled import LEAST_WEIGHT
from orip.prelim.relative.parallax import Pairs, Parallaxes, parallaxes, parallaxes_with_partials

MAX_STANDARD_RESIDUAL = 5.0

_CONVERGED = 1e-9
"""Correction in standard deviations of the unknowns; rounding leaves some 1e-11."""

_WEIGHTS_HELD = 12
"""Iteration after which weights stay: one that jumps to and fro at the limit would never end."""

_LONGEST_STEP = 0.3
"""Radians; from a poor start the linear step may lead anywhere."""

_REGULAR = 1e-13
"""Part of the largest diagonal element that keeps the normal equations solvable where five points determine nothing."""

DANISH = (MAX_STANDARD_RESIDUAL, LEAST_WEIGHT, _CONVERGED, _LONGEST_STEP, _REGULAR, _WEIGHTS_HELD)
"""As the compiled loop takes them: `RelativeDanish` in kernels/relative_adjustment.h."""


class Adjusted(NamedTuple):
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


class Precision(NamedTuple):
    """What the adjusted orientation is good for.

    Attributes
    ----------
    redundancy_number : array (n,)
        Of the parallaxes.
    cofactor : array (6, 6)
        Of the unit base (nothing along itself) and of a small rotation about the left photo's axes.
    """

    redundancy_number: FloatArray
    cofactor: FloatArray


def adjust_relative(start: TwoPhotos, pairs: Pairs, scale: FloatArray | float, max_iterations: int) -> Adjusted:
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
    Adjusted
    """
    limits = pairs.error * np.broadcast_to(np.asarray(scale, dtype=np.float64), len(start.base))[:, None]
    photos, weights = start, np.empty(0)
    for iteration in range(1, max_iterations + 1):
        found = parallaxes_with_partials(photos, pairs)
        if iteration <= _WEIGHTS_HELD:
            weights = danish_weights(np.abs(found.value) / limits, MAX_STANDARD_RESIDUAL)
        design, across = _design(photos, pairs, found)
        weighted = np.swapaxes(design * weights[..., None], 1, 2)
        normals = weighted @ design
        right = weighted @ (-found.value / pairs.error)[..., None]
        step = np.asarray(np.linalg.solve(_regular(normals), right)[..., 0], dtype=np.float64)
        photos = _moved(photos, across, step)
        # the square of the correction in standard deviations, dx^T N dx = dx^T right at the solution
        square = (step * right[..., 0]).sum(axis=1)
        if square.max() < _CONVERGED**2:
            break
    essential = cross_matrix(photos.base) @ photos.rotation
    return Adjusted(photos, parallaxes(essential, pairs), weights, iteration)


def precision_of(adjusted: Adjusted, pairs: Pairs) -> Precision:
    """Return redundancy numbers and cofactors of one adjusted orientation, from the a-priori errors."""
    photos, weights = adjusted.photos, adjusted.weight_factor
    design, across = _design(photos, pairs, parallaxes_with_partials(photos, pairs))
    inverse = np.linalg.inv(_regular(np.swapaxes(design * weights[..., None], 1, 2) @ design))
    redundancy = 1.0 - weights * ((design @ inverse) * design).sum(axis=-1)
    whole = np.zeros((6, 5))
    whole[:3, :2] = across[0]
    whole[3:, 2:] = np.eye(3)
    return Precision(np.maximum(redundancy[0], 0.0), whole @ inverse[0] @ whole.T)


def _design(photos: TwoPhotos, pairs: Pairs, found: Parallaxes) -> tuple[FloatArray, FloatArray]:
    """Return the design matrices (k, n, 5) in units of the a-priori error, and the directions across the bases."""
    across = _across(photos.base)
    design = np.concatenate([found.by_base @ across, found.by_rotation], axis=-1) / pairs.error[:, None]
    return design, across


def _across(base: FloatArray) -> FloatArray:
    """Return two directions (k, 3, 2) across each of k bases."""
    return np.asarray(np.linalg.qr(base[..., None], mode="complete")[0][..., 1:])


def _regular(normals: FloatArray) -> FloatArray:
    largest = np.trace(normals, axis1=1, axis2=2)[:, None, None]
    return np.asarray(normals + (_REGULAR * largest + 1e-300) * np.eye(normals.shape[-1]))


def _moved(photos: TwoPhotos, across: FloatArray, step: FloatArray) -> TwoPhotos:
    longest = np.abs(step).max(axis=1, keepdims=True)
    step = step * np.minimum(1.0, _LONGEST_STEP / np.maximum(longest, 1e-300))
    base = photos.base + (across @ step[:, :2, None])[..., 0]
    base /= np.linalg.norm(base, axis=1, keepdims=True)
    return TwoPhotos(base, rotation_about_axes(step[:, 2:]) @ photos.rotation)
