"""Least squares adjustment of relative orientations: five unknowns, parallaxes as observations, Danish weights."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.adjustment.weights import LEAST_WEIGHT, danish_weights
from orip.arrays import BoolArray, FloatArray
from orip.geometry.essential import TwoPhotos
from orip.geometry.rotation import cross_matrix, rotation_about_axes
from orip.prelim.least_squares import GaussNewton, enlarged_diagonal, least_squares, shortened

# As in `orip.geometry.essential` the ground is the left photo's system, image vectors are (x, y, -C) in millimetres,
# and R takes the right photo's system to the left one's.


class Pairs(NamedTuple):
    """n points in two photos.

    Attributes
    ----------
    left, right : arrays (n, 3)
        Image vectors, mm.
    error : array (n,)
        A-priori standard deviation of a parallax, mm: sqrt(2) times that of a photo coordinate.
    """

    left: FloatArray
    right: FloatArray
    error: FloatArray

    def of(self, rows: NDArray[np.bool_]) -> Pairs:
        """Return some of the points."""
        return Pairs(self.left[rows], self.right[rows], self.error[rows])

    def equal(self, others: Pairs) -> bool:
        """Tell whether others are the same points, measured and weighted alike."""
        return all(map(np.array_equal, self, others))


class Parallaxes(NamedTuple):
    """Parallaxes of n points and their partials.

    Attributes
    ----------
    value : array (..., n)
        mm.
    by_base : array (..., n, 3)
        By the base, mm per unit of the base; nothing along the base itself.
    by_rotation : array (..., n, 3)
        By a small rotation of the right photo about the axes of the left one, mm per radian.
    """

    value: FloatArray
    by_base: FloatArray
    by_rotation: FloatArray


class Meeting(NamedTuple):
    """Where the rays of n points come nearest to each other.

    Attributes
    ----------
    coordinates : array (..., n, 3)
        Halfway between the rays, in units of the base; not finite where they are parallel.
    along_left, along_right : arrays (..., n)
        Multiples of the image vectors; negative behind the photo.
    """

    coordinates: FloatArray
    along_left: FloatArray
    along_right: FloatArray

    @property
    def in_front(self) -> NDArray[np.bool_]:
        """Whether the point lies in front of both photos, array (..., n)."""
        return (self.along_left > 0.0) & (self.along_right > 0.0)


def parallaxes(essential: FloatArray, pairs: Pairs) -> FloatArray:
    """Return the parallaxes of n points for essential matrices (..., 3, 3), array (..., n), mm.

    Notes
    -----
    F = left^T E right over the length of its gradient by the four photo coordinates, to first order the shift of both
    image points that makes the rays meet (Sampson 1982), times sqrt(2): in the normal case this is y left - y right.
    """
    f, gradient_left, gradient_right = _condition(essential, pairs)
    return np.asarray(f * np.sqrt(2.0 / _square(gradient_left, gradient_right)))


def parallaxes_with_partials(photos: TwoPhotos, pairs: Pairs) -> Parallaxes:
    """Return the parallaxes of n points and their partials.

    Parameters
    ----------
    photos : TwoPhotos
        The base may have any length.
    pairs : Pairs

    Returns
    -------
    Parallaxes

    Notes
    -----
    E is linear in base and rotation. The derivative of F / |g| by the elements of E is a sum of two dyads of vectors
    of the left and the right photo; with dE = [db]x R and dE = [b]x [dr]x R those become cross products.
    """
    base, to_left = photos.base[..., :, None], photos.rotation
    f, gradient_left, gradient_right = _condition(cross_matrix(photos.base) @ to_left, pairs)
    square = _square(gradient_left, gradient_right)
    value = f * np.sqrt(2.0 / square)
    gradient_left[..., 2, :] = gradient_right[..., 2, :] = 0.0
    left, right = pairs.left.T, to_left @ pairs.right.T
    shrinking = (value / square)[..., None, :]
    left_factor = np.sqrt(2.0 / square)[..., None, :] * left - shrinking * gradient_left
    right_factor = -shrinking * (to_left @ gradient_right)
    by_base = _cross(right, left_factor) + _cross(right_factor, left)
    by_rotation = _cross(_cross(base, left_factor), right) + _cross(_cross(base, left), right_factor)
    return Parallaxes(value, np.swapaxes(by_base, -1, -2), np.swapaxes(by_rotation, -1, -2))


def meeting_points(photos: TwoPhotos, pairs: Pairs) -> Meeting:
    """Return where the rays of n points come nearest to each other, the least squares intersection of two rays."""
    base, left, right = photos.base[..., :, None], pairs.left.T, photos.rotation @ pairs.right.T
    normal = _cross(left, right)
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = normal / (normal**2).sum(axis=-2, keepdims=True)
        along_left = (_cross(base, right) * scaled).sum(axis=-2)
        along_right = (_cross(base, left) * scaled).sum(axis=-2)
        coordinates = 0.5 * (along_left[..., None, :] * left + base + along_right[..., None, :] * right)
    return Meeting(np.swapaxes(coordinates, -1, -2), along_left, along_right)


# below, vectors of n points are columns (..., 3, n): sums over components are then fast


def _condition(essential: FloatArray, pairs: Pairs) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F (..., n) and its gradients (..., 3, n) by the left and the right image vectors."""
    gradient_left = essential @ pairs.right.T
    gradient_right = np.swapaxes(essential, -1, -2) @ pairs.left.T
    return (gradient_left * pairs.left.T).sum(axis=-2), gradient_left, gradient_right


def _square(gradient_left: FloatArray, gradient_right: FloatArray) -> FloatArray:
    """Return the square (..., n) of the gradient by the four photo coordinates; never quite zero."""
    x, y = gradient_left[..., 0, :], gradient_left[..., 1, :]
    u, v = gradient_right[..., 0, :], gradient_right[..., 1, :]
    return np.asarray(np.maximum(x * x + y * y + u * u + v * v, 1e-300))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of columns (..., 3, n) or (..., 3, 1)."""
    ax, ay, az = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    bx, by, bz = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)


# The unknowns are two components of the base across itself and a small rotation of the right photo: no direction of the
# base and no rotation is singular. Several starts are adjusted side by side.

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
