"""The relative orientation that n points in two photos determine, compiled or by the modules named below.

The best orientations of samples of five points (`orip.prelim.relative.start`) start adjustments of all parallaxes
(`orip.prelim.relative.adjustment`). All points then decide between their results, and the best one is adjusted
until it converges.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.geometry.essential import TwoPhotos
from orip.geometry.perspective import perspective_with_partials
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation, cross_matrix
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.relative.adjustment import (
    DANISH,
    AdjustedPairs,
    Meeting,
    Pairs,
    adjust_relative,
    meeting_points,
    parallaxes,
    precision_of,
)
from orip.prelim.relative.start import (
    POINTS_NEEDED,
    SAMPLING,
    consensus,
    costs_in_front,
    log_of_sets,
    samples_of,
    starting_orientations,
)

_ITERATIONS_TO_COMPARE, _MAX_ITERATIONS = 5, 20

_EQUALLY_GOOD = 4.0
"""Difference of square sums, two standard deviations, below which the points do not tell two orientations apart."""

_SAME = 0.02
"""Radians between orientations that count as the same: their iterations ended at slightly different places."""

_SURE = 3.0
"""Logarithm of the factor by which points have to agree better than by chance; with fewer redundant points, their
number."""

_PLAIN_BASE = 1000.0
"""Median residual of a pure rotation, over the scale, that shows a base whatever the blunders; iterations end there."""

_ROTATION_STEPS = 8

CHOICE = (_ITERATIONS_TO_COMPARE, _MAX_ITERATIONS, _EQUALLY_GOOD, _SAME, _SURE, _PLAIN_BASE, _ROTATION_STEPS)
_RULES = np.array([*SAMPLING, *DANISH, *CHOICE])
"""The constants as the compiled loop takes them: `RelativeRules` in pair_loops.h."""


class PairSolution(Struct, frozen=True):
    """One relative orientation of n points; deviations are those of the a-priori errors.

    Parameters
    ----------
    photos : TwoPhotos
        The base has the length 1.
    angles, angle_deviation : arrays (3,)
        omega, phi, kappa of the right photo in the left one's system.
    base_deviation : array (3,)
        In units of the base, whose largest component is held.
    parallax : array (n,)
        mm.
    weight_factor, redundancy_number : arrays (n,)
    coordinates, deviations : arrays (n, 3)
        Where the rays meet, and its standard deviations for a fixed orientation, in units of the base; NaN for the
        deviations of points that are not usable.
    in_front : array (n,) of bool
        The point is in front of both photos.
    usable : array (n,) of bool
        The point is in front of both photos, has full weight, and its rays are not parallel.
    length : float
        Length of the base, in metres, for which the mean of the usable points' 1 / depth is 1 / C.
    iterations : int
    scale : float
        Of the residuals of the points that agree, at least 1.
    seuw : float
        Standard error of unit weight of the points with full weight; 0 without redundancy.
    left_by_rotation : float
        Median residual of a pure rotation between the two photos, in standard deviations of a parallax, or some number
        above 1000 times the scale.
    by_chance : bool
        As many points would agree as well if they were placed at random.
    ambiguous : bool
        Another orientation fits as well.
    """

    photos: TwoPhotos
    angles: FloatArray
    angle_deviation: FloatArray
    base_deviation: FloatArray
    parallax: FloatArray
    weight_factor: FloatArray
    redundancy_number: FloatArray
    coordinates: FloatArray
    deviations: FloatArray
    in_front: BoolArray
    usable: BoolArray
    length: float
    iterations: int
    scale: float
    seuw: float
    left_by_rotation: float
    by_chance: bool
    ambiguous: bool


def solve(pairs: Pairs) -> PairSolution | None:
    """Orient the right photo to the left one.

    Parameters
    ----------
    pairs : Pairs
        Five points at least.

    Returns
    -------
    PairSolution or None
        None where the points determine nothing.
    """
    return (_compiled_solution if is_compiled() else _solution)(pairs)


def _compiled_solution(pairs: Pairs) -> PairSolution | None:
    """Do what `_solution` does in the compiled loop."""
    count = len(pairs.error)
    found = np.empty(28)
    parallax, weights, redundancy = np.empty(count), np.empty(count), np.empty(count)
    coordinates, deviations = np.empty((count, 3)), np.empty((count, 3))
    in_front, usable = np.empty(count, dtype=np.bool_), np.empty(count, dtype=np.bool_)
    if not kernels.orient_pair(
        *pairs, samples_of(count), log_of_sets(count), _RULES, found, parallax, weights, redundancy, coordinates,
        deviations, in_front, usable,
    ):  # fmt: skip
        return None
    scale, by_chance, ambiguous, iterations, seuw, length, left_by_rotation = found[21:].tolist()
    return PairSolution(
        TwoPhotos(found[:3], found[3:12].reshape(3, 3)), found[12:15], found[18:21], found[15:18], parallax, weights,
        redundancy, coordinates, deviations, in_front, usable, length, int(iterations), scale, seuw, left_by_rotation,
        bool(by_chance), bool(ambiguous),
    )  # fmt: skip


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
