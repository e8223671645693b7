"""Relative orientation with arrays: samples of five points, adjustments of all parallaxes, the choice."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from support.prelim_references.five_points import essential_matrices, two_photos_of
from support.prelim_references.iterations import GaussNewton, enlarged_diagonal, least_squares, shortened

from orip.adjustment.weights import danish_weights
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.perspective import perspective_with_partials
from orip.geometry.rotation import (
    angle_rates_from_axes_rotation,
    angles_from_rotation,
    cross_matrix,
    rotation_about_axes,
)
from orip.geometry.stereo import TwoPhotos
from orip.prelim.relative import given_scale
from orip.prelim.relative.given_scale import PairAtScale
from orip.prelim.relative.solution import (
    _ALIKE,
    _CONVERGED,
    _EQUALLY_GOOD,
    _ITERATIONS_TO_COMPARE,
    _KEPT,
    _LONGEST_STEP,
    _MAX_ITERATIONS,
    _MISSED,
    _NO_BETTER,
    _ORDINARY_SCALE,
    _PLAIN_BASE,
    _REGULAR,
    _ROTATION_STEPS,
    _SAME,
    _SAMPLES_AT_ONCE,
    _SAMPLES_OF_LARGE_SCALE,
    _STARTS,
    _SURE,
    _WEIGHTS_HELD,
    FIT_LIMIT,
    MAX_STANDARD_RESIDUAL,
    POINTS_NEEDED,
    Pairs,
    PairSolution,
    _condition,
    _square,
    log_of_sets,
    parallaxes,
    samples_of,
)
from orip.structs import replace


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


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of columns (..., 3, n) or (..., 3, 1)."""
    ax, ay, az = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    bx, by, bz = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)


_REWEIGHTINGS = _WEIGHTS_HELD - 1


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


def starting_orientations(pairs: Pairs) -> TwoPhotos:
    """Return the best orientations that samples of five points give, best first.

    Parameters
    ----------
    pairs : Pairs
        n >= 5 points.

    Returns
    -------
    TwoPhotos
        At most eight, many of them close to each other; none where the points determine nothing.
    """
    samples = samples_of(len(pairs.error))
    best = _Best(np.empty((0, 3, 3)), 1.0, 0.0)
    for start in range(0, len(samples), _SAMPLES_AT_ONCE):
        drawn = samples[start : start + _SAMPLES_AT_ONCE]
        best = _with_samples(best.essential, drawn, pairs)
        if len(best.essential) and start + len(drawn) >= _samples_needed(best.share, best.scale):
            break
    return best_in_front(best.essential, pairs, best.scale)


class _Best(NamedTuple):
    """Essential matrices (k, 3, 3), the best first, and the scale and share of the points that agree in the first."""

    essential: FloatArray
    scale: float
    share: float


def _with_samples(kept: FloatArray, drawn: IntArray, pairs: Pairs) -> _Best:
    """Return the best matrices of those kept so far and those of more samples."""
    essential = np.concatenate([kept, essential_matrices(pairs.left[drawn], pairs.right[drawn])])
    if not len(essential):
        return _Best(essential, 1.0, 0.0)
    residuals = np.abs(parallaxes(essential, pairs)) / pairs.error
    agreed = consensus(residuals, pairs)
    scale, share = float(agreed.scale[agreed.best]), float(agreed.share[agreed.best])
    return _Best(essential[best_unlike(essential, robust_costs(residuals, scale))], scale, share)


class Consensus(NamedTuple):
    """How many points agree in each of several adjustments, and how well.

    Attributes
    ----------
    log_chance : array (k,)
        Logarithm of how many sets of so many points would agree so well if the points were placed at random: above 0
        the agreement says nothing.
    scale : array (k,)
        Standard residual of the points that agree, at least 1: never better than the a-priori error.
    share : array (k,)
        Of the points that agree.
    """

    log_chance: FloatArray
    scale: FloatArray
    share: FloatArray

    @property
    def best(self) -> int:
        """The adjustment that chance explains least."""
        return int(self.log_chance.argmin())


def consensus(residuals: FloatArray, pairs: Pairs) -> Consensus:
    """Return how many points agree in adjustments with five unknowns.

    Parameters
    ----------
    residuals : array (k, n)
        Absolute parallaxes in units of their a-priori error.
    pairs : Pairs

    Returns
    -------
    Consensus

    Notes
    -----
    A-contrario (Moisan and Stival 2004): m of n points have residuals up to e by chance in (n - 5) C(n, m) C(m, 5)
    p^(m - 5) sets, with the probability p = 2 e / extent of the points; the m for which this number is smallest is
    taken. Neither the scale nor the share of blunders has to be known.
    """
    rows, n = residuals.shape
    if n <= POINTS_NEEDED:
        return Consensus(np.zeros(rows), np.ones(rows), np.ones(rows))
    unit = chance_of_unit(pairs)
    ordered = np.sort(residuals, axis=1)
    agreeing = np.arange(POINTS_NEEDED + 1, n + 1)
    largest = np.clip(np.maximum(ordered[:, POINTS_NEEDED:], _NO_BETTER) * unit, 1e-300, 1.0)
    log_chance = log_of_sets(n) + (agreeing - POINTS_NEEDED) * np.log(largest)
    which = log_chance.argmin(axis=1)
    row, count = np.arange(rows), agreeing[which]
    square = np.cumsum(ordered**2, axis=1)[row, count - 1] / (count - POINTS_NEEDED)
    return Consensus(log_chance[row, which], np.maximum(np.sqrt(square), 1.0), count / n)


def chance_of_unit(pairs: Pairs) -> float:
    """Return the probability that a point placed at random has a parallax up to its a-priori error."""
    extent = max(math.hypot(*(xy[:, :2].max(axis=0) - xy[:, :2].min(axis=0))) for xy in (pairs.left, pairs.right))
    return 2.0 * float(pairs.error.mean()) / max(extent, 1e-300)


def costs_in_front(residuals: FloatArray, in_front: NDArray[np.bool_], scale: float) -> FloatArray:
    """Return the sums of squared residuals in units of the scale; a point behind a photo counts as not fitting."""
    return robust_costs(np.where(in_front, residuals, np.inf), scale)


def robust_costs(residuals: FloatArray, scale: float) -> FloatArray:
    """Return the sums of squared residuals (..., n) in units of the scale, each counted up to the limit."""
    return np.asarray((np.minimum(residuals / scale, FIT_LIMIT) ** 2).sum(axis=-1))


def _samples_needed(share: float, scale: float) -> float:
    """Return how many samples make it likely that one of them is free of blunders."""
    free = min(share**POINTS_NEEDED, 1.0 - 1e-12)
    needed = math.log(_MISSED) / math.log1p(-free)
    return max(needed, _SAMPLES_OF_LARGE_SCALE if scale > _ORDINARY_SCALE else 0.0)


def best_unlike(essential: FloatArray, costs: FloatArray) -> IntArray:
    """Return the rows of the best matrices that are not alike."""
    order = np.argsort(costs, kind="stable")
    flat = essential.reshape(-1, 9)
    chosen: list[np.int64] = []
    while len(order) and len(chosen) < _KEPT:
        chosen.append(order[0])
        order = order[np.abs(flat[order] @ flat[order[0]]) < _ALIKE]
    return np.array(chosen, dtype=np.int64)


def best_in_front(essential: FloatArray, pairs: Pairs, scale: float) -> TwoPhotos:
    """Return of each matrix the orientation with the most points in front, the best orientations first."""
    photos = two_photos_of(essential)
    residuals = np.abs(parallaxes(essential, pairs)) / pairs.error
    costs = costs_in_front(residuals[:, None], meeting_points(photos, pairs).in_front, scale)
    rows = np.arange(len(essential))
    which = costs.argmin(axis=1)
    order = np.argsort(costs[rows, which], kind="stable")[:_STARTS]
    return TwoPhotos(photos.base[rows, which], photos.rotation[rows, which]).of(order)


def _solution(pairs: Pairs) -> PairSolution | None:
    start = starting_orientations(pairs)
    if not len(start.base):
        return None
    residuals = np.abs(parallaxes(cross_matrix(start.base) @ start.rotation, pairs)) / pairs.error
    tried = adjust_relative(start, pairs, consensus(residuals, pairs).scale, _ITERATIONS_TO_COMPARE)
    agreed = consensus(tried.residuals(pairs), pairs)
    scale = float(agreed.scale[agreed.best])
    best, ambiguous = _choice(tried, pairs, scale)
    final = adjust_relative(tried.photos.of(np.array([best])), pairs, scale, _MAX_ITERATIONS)
    precision = precision_of(final, pairs)
    photos = TwoPhotos(final.photos.base[0], final.photos.rotation[0])
    angles = angles_from_rotation(photos.rotation)
    meeting = meeting_points(photos, pairs)
    usable = usable_points(meeting, final.weight_factor[0])
    return PairSolution(
        photos=photos,
        angles=angles,
        angle_deviation=_angle_deviations(angles, precision.cofactor[3:, 3:]),
        base_deviation=_base_deviations(photos.base, precision.cofactor[:3, :3]),
        parallax=final.parallax[0],
        weight_factor=final.weight_factor[0],
        redundancy_number=precision.redundancy_number,
        coordinates=meeting.coordinates,
        deviations=intersection_deviations(photos, meeting.coordinates, usable, pairs),
        in_front=meeting.in_front,
        usable=usable,
        length=0.001 * float((1.0 / meeting.along_left[usable]).sum()) / max(int(usable.sum()), 1),
        iterations=tried.iterations + final.iterations,
        scale=scale,
        seuw=_unit_weight_error(final, precision.redundancy_number, pairs),
        left_by_rotation=left_by_rotation(pairs, scale),
        by_chance=bool(agreed.log_chance[agreed.best] > -min(len(pairs.error) - POINTS_NEEDED, _SURE)),
        ambiguous=ambiguous,
    )


def _choice(tried: AdjustedPairs, pairs: Pairs, scale: float) -> tuple[int, bool]:
    """Return the best of several orientations, and whether another one is as good.

    The points do not always decide: five points have up to ten solutions, a plane has two. Of equally good ones the
    one with the smallest rotation is used.
    """
    in_front = meeting_points(tried.photos, pairs).in_front
    costs = costs_in_front(tried.residuals(pairs), in_front, scale)
    best = int(costs.argmin())
    bases, rotations = tried.photos
    turn = _angle(np.swapaxes(rotations, 1, 2) @ rotations[best])
    between = np.arccos(np.clip(bases @ bases[best], -1.0, 1.0))
    rivals = (costs <= costs[best] + _EQUALLY_GOOD) & (np.maximum(turn, between) > _SAME)
    if not rivals.any():
        return best, False
    rivals[best] = True
    return int(np.where(rivals, _angle(rotations), np.inf).argmin()), True


def _angle(rotation: FloatArray) -> FloatArray:
    cosine = (np.trace(rotation, axis1=-2, axis2=-1) - 1.0) / 2.0
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def usable_points(meeting: Meeting, weight_factor: FloatArray) -> BoolArray:
    """Return which points (n,) fit, lie in front of both photos, and have rays that are not parallel."""
    finite = np.isfinite(meeting.coordinates).all(axis=1)
    return np.asarray((weight_factor == 1.0) & meeting.in_front & finite)


def _unit_weight_error(final: AdjustedPairs, redundancy_number: FloatArray, pairs: Pairs) -> float:
    whole = final.weight_factor[0] == 1.0
    redundancy = float(redundancy_number[whole].sum())
    if len(pairs.error) == POINTS_NEEDED or redundancy < 1e-6:
        return 0.0
    return math.sqrt(float((final.residuals(pairs)[0, whole] ** 2).sum()) / redundancy)


def left_by_rotation(pairs: Pairs, scale: float) -> float:
    """Return the median residual of a pure rotation: see `PairSolution`."""
    length = np.linalg.norm(pairs.left, axis=1)
    left = pairs.left / length[:, None]
    right = pairs.right / np.linalg.norm(pairs.right, axis=1)[:, None]
    weights = np.ones(len(length))
    median = math.inf
    for _ in range(_ROTATION_STEPS):
        # least squares, then the least sum of distances, which blunders do not move (Weiszfeld 1937)
        u, _, vt = np.linalg.svd((left * weights[:, None]).T @ right)
        rotation = (u * [1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        distance = np.linalg.norm(left - right @ rotation.T, axis=1) * length / pairs.error
        median = float(np.median(distance))
        if median > _PLAIN_BASE * scale:
            break
        weights = 1.0 / np.maximum(distance, 1e-3)
    return median


def _base_deviations(base: FloatArray, cofactor: FloatArray) -> FloatArray:
    """Return the root cofactors of the base whose largest component is held."""
    largest = int(np.abs(base).argmax())
    partials = np.eye(3)
    partials[:, largest] -= base / base[largest]
    return np.sqrt(np.maximum(np.diag(partials @ cofactor @ partials.T), 0.0))


def _angle_deviations(angles: FloatArray, cofactor: FloatArray) -> FloatArray:
    partials = angle_rates_from_axes_rotation(angles)
    return np.sqrt(np.maximum(np.diag(partials @ cofactor @ partials.T), 0.0))


def intersection_deviations(photos: TwoPhotos, coordinates: FloatArray, usable: BoolArray, pairs: Pairs) -> FloatArray:
    """Return a-priori standard deviations (n, 3) of the intersections of two rays for a fixed orientation."""
    seen, points = pairs.of(usable), coordinates[usable]
    normals = np.zeros((len(points), 3, 3))
    for centre, rotation, vectors in (
        (np.zeros(3), np.eye(3), seen.left),
        (photos.base, photos.rotation, seen.right),
    ):
        rotations = np.broadcast_to(rotation, (len(points), 3, 3))
        by_point = perspective_with_partials(points - centre, rotations, -vectors[:, 2]).by_point
        normals += np.swapaxes(by_point, 1, 2) @ by_point
    largest = np.trace(normals, axis1=1, axis2=2)[:, None, None]
    inverse = np.linalg.inv(normals + 1e-15 * largest * np.eye(3))
    deviations = np.full_like(coordinates, np.nan)
    error = seen.error / math.sqrt(2.0)
    deviations[usable] = error[:, None] * np.sqrt(np.diagonal(inverse, axis1=1, axis2=2))
    return deviations


def _at_scale(solution: PairSolution, pairs: Pairs, scale: float) -> PairSolution | None:
    samples = samples_of(len(pairs.error))[: given_scale._SAMPLES]
    essential = essential_matrices(pairs.left[samples], pairs.right[samples])
    if not len(essential):
        return None
    costs = robust_costs(np.abs(parallaxes(essential, pairs)) / pairs.error, scale)
    start = best_in_front(essential[best_unlike(essential, costs)], pairs, scale)
    tried = adjust_relative(start, pairs, scale * FIT_LIMIT / MAX_STANDARD_RESIDUAL, given_scale._ITERATIONS)
    residuals = tried.residuals(pairs)
    best = int(costs_in_front(residuals, meeting_points(tried.photos, pairs).in_front, scale).argmin())
    if not _beyond_chance(residuals[best], pairs, scale):
        return None
    photos = TwoPhotos(tried.photos.base[best], tried.photos.rotation[best])
    meeting = meeting_points(photos, pairs)
    usable = usable_points(meeting, tried.weight_factor[best])
    return replace(
        solution,
        photos=photos,
        parallax=tried.parallax[best],
        weight_factor=tried.weight_factor[best],
        coordinates=meeting.coordinates,
        deviations=intersection_deviations(photos, meeting.coordinates, usable, pairs),
        in_front=meeting.in_front,
        usable=usable,
        scale=scale,
        seuw=scale,
    )


def _adjusted(start: TwoPhotos, pairs: Pairs, scale: float) -> PairAtScale | None:
    one = TwoPhotos(start.base[None], start.rotation[None])
    found = adjust_relative(one, pairs, scale * FIT_LIMIT / MAX_STANDARD_RESIDUAL, given_scale._ITERATIONS)
    if not _beyond_chance(found.residuals(pairs)[0], pairs, scale):
        return None
    photos = TwoPhotos(found.photos.base[0], found.photos.rotation[0])
    meeting = meeting_points(photos, pairs)
    usable = usable_points(meeting, found.weight_factor[0])
    deviations = intersection_deviations(photos, meeting.coordinates, usable, pairs)
    return PairAtScale(photos, meeting.coordinates, deviations, usable, scale, left_by_rotation(pairs, scale))


def _beyond_chance(residuals: FloatArray, pairs: Pairs, scale: float) -> bool:
    """Tell whether more points fit than would at random (see `consensus`)."""
    largest = FIT_LIMIT * scale
    fitting = int(np.count_nonzero(residuals <= largest))
    if fitting <= POINTS_NEEDED:
        return False
    sets = log_of_sets(len(residuals))[fitting - POINTS_NEEDED - 1]
    chance = np.log(min(largest * chance_of_unit(pairs), 1.0))
    return bool(sets + (fitting - POINTS_NEEDED) * chance < -given_scale._SURE)
