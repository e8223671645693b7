"""Relative orientation of a model without initial values: two photos, the points common to them, and nothing else."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orip.geometry.essential import TwoPhotos
from orip.geometry.perspective import perspective_with_partials
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation, cross_matrix
from orip.model.preliminary import ImageRays, NotOriented, RelativeOrientation, SubBlock
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.parallax import Meeting, Pairs, meeting_points, parallaxes
from orip.prelim.photo_index import PhotoIndex, photo_index
from orip.prelim.relative_adjustment import Adjusted, adjust_relative, precision_of
from orip.prelim.relative_remarks import remarks_on
from orip.prelim.relative_start import POINTS_NEEDED, consensus, costs_in_front, starting_orientations

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_ITERATIONS_TO_COMPARE, _MAX_ITERATIONS = 5, 20

_EQUALLY_GOOD = 4.0
"""Difference of square sums, two standard deviations, below which the points do not tell two orientations apart."""

_SAME = 0.02
"""Radians between orientations that are one, iterated more or less."""

_NO_BASE = 3.0
"""Parallaxes left by a rotation alone, in standard deviations of theirs: from there on errors of measuring explain
them, half of which are below 1.2."""

_SURE = 3.0
"""Logarithm of how many times better than chance points agree; fewer than three redundant ones cannot be that sure."""

_PLAIN_BASE = 1000.0
"""No blunders hide a rotation behind that many standard deviations."""

_ROTATION_STEPS = 8

_NO_MODEL = 0.01
"""Standard deviation of parallaxes, as part of the principal distance, that no camera out of calibration makes."""

_FITS = 3.0
"""Standard deviations within which a point fits that is measured under another number."""

_LARGEST_SCALE = 20.0
"""Of errors that a camera out of calibration makes; above it numbers are confused, and their parallaxes say nothing."""


def orient_pair(
    rays: ImageRays,
    left: int,
    right: int,
    *,
    model: str,
    row: int | None,
    column: int | None,
    index: PhotoIndex | None = None,
) -> RelativeOrientation | NotOriented:
    """Orient the right photo to the left one (dependent pair), without initial values.

    Five-point solutions of samples of the points start an adjustment of all parallaxes with Danish weights. It finds
    its way where a third of the points are blunders, and where all residuals are many times the a-priori error: weights
    are reduced above five times the a-priori error or, where it is larger, a robust estimate of what the residuals are.

    Parameters
    ----------
    rays : ImageRays
    left, right : int
        Photos.
    model : str
        Its name.
    row, column : int or None
    index : PhotoIndex, optional
        Of the rays, where many pairs of them are oriented.

    Returns
    -------
    RelativeOrientation or NotOriented

    Notes
    -----
    The residual parallax is y left - y right in the normal case; in general see `orip.prelim.parallax`. Its a-priori
    error is the root of the squares of both photos' errors of a coordinate.

    The base is as long as brings the mean of the points' 1 / depth to 1 / C: in the normal case bx is then the mean
    x parallax. Its largest component fixes the scale and has no standard deviation.

    Standard deviations are those of the a-priori errors times `seuw` (without redundancy, times 1). Those of model
    coordinates are of the intersection of the two rays alone, times `seuw` where that is above 1.
    """
    rows = (index or photo_index(rays)).common_points(left, right)
    names = rays.photos[left], rays.photos[right]
    pairs = Pairs(rays.vectors[rows[0]], rays.vectors[rows[1]], np.hypot(rays.error[rows[0]], rays.error[rows[1]]))
    count = len(pairs.error)
    if count < POINTS_NEEDED:
        points = "1 point" if count == 1 else f"{count} points"
        reason = f"photo {names[0]} and photo {names[1]} share {points}, {POINTS_NEEDED} are needed"
        return NotOriented(model, "", reason)
    solution = _solve(pairs)
    reason = f"the {count} points that photo {names[0]} and photo {names[1]} share determine no orientation"
    if solution is None:
        return NotOriented(model, "", reason)
    fault = _fault(solution, pairs)
    if fault is not None:
        return NotOriented(model, "", f"{reason}: {fault}")
    return _result(rays, (left, right), rows, solution, pairs, (model, row, column))


@dataclass(frozen=True, slots=True)
class _Solution:
    """One relative orientation: of one row of an adjustment."""

    photos: TwoPhotos
    parallax: FloatArray
    weight_factor: FloatArray
    redundancy_number: FloatArray
    cofactor: FloatArray
    iterations: int
    scale: float
    by_chance: bool
    ambiguous: bool
    meeting: Meeting

    @property
    def usable(self) -> BoolArray:
        """Whether a point has full weight, is in front of both photos and has rays that are not parallel."""
        finite = np.isfinite(self.meeting.coordinates).all(axis=1)
        return np.asarray((self.weight_factor == 1.0) & self.meeting.in_front & finite)

    def seuw(self, error: FloatArray) -> float:
        """Return the standard error of unit weight of the points with full weight; 0 without redundancy."""
        whole = self.weight_factor == 1.0
        redundancy = float(self.redundancy_number[whole].sum())
        if len(error) == POINTS_NEEDED or redundancy < 1e-6:
            return 0.0
        return math.sqrt(float(((self.parallax / error)[whole] ** 2).sum()) / redundancy)


def _solve(pairs: Pairs) -> _Solution | None:
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
    return _Solution(
        photos,
        final.parallax[0],
        final.weight_factor[0],
        precision.redundancy_number,
        precision.cofactor,
        tried.iterations + final.iterations,
        scale,
        bool(agreed.log_chance[agreed.best] > -min(len(pairs.error) - POINTS_NEEDED, _SURE)),
        ambiguous,
        meeting_points(photos, pairs),
    )


def _choice(tried: Adjusted, pairs: Pairs, scale: float) -> tuple[int, bool]:
    """Return the best of several orientations, and whether another one is as good.

    The points do not always decide: five points have up to ten solutions, a plane has two. Of equally good ones that
    with the smallest rotation is taken.
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


def _fault(solution: _Solution, pairs: Pairs) -> str | None:
    """Return why an orientation is none, or None."""
    typical = solution.seuw(pairs.error) * float(pairs.error.mean())
    if solution.by_chance or typical > _NO_MODEL * float(np.abs(pairs.left[:, 2]).mean()):
        return f"their rays miss each other by {typical:.2g} mm; are point numbers or photos confused?"
    scale = min(solution.scale, _LARGEST_SCALE)
    if _left_by_rotation(pairs, scale) < _NO_BASE * scale:
        return "there is no base between them; both were taken from one place"
    usable = int(solution.usable.sum())
    if usable < max(POINTS_NEEDED, len(pairs.error) / 2):
        return f"the rays of only {usable} of them meet in front of both photos"
    return None


def _left_by_rotation(pairs: Pairs, scale: float) -> float:
    """Return the median of what is left between the two photos after a rotation alone, in standard deviations."""
    if is_compiled():
        return kernels.rotate_only(*pairs.arrays, np.empty((9, len(pairs.error))), _PLAIN_BASE * scale, _ROTATION_STEPS)
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


def _result(
    rays: ImageRays,
    photos: tuple[int, int],
    rows: tuple[IntArray, IntArray],
    solution: _Solution,
    pairs: Pairs,
    place: tuple[str, int | None, int | None],
) -> RelativeOrientation:
    seuw = solution.seuw(pairs.error)
    unit_weight = seuw or 1.0
    usable = solution.usable
    length = float((1.0 / solution.meeting.along_left[usable]).mean()) / 1000.0
    base = length * solution.photos.base
    angles = angles_from_rotation(solution.photos.rotation)
    whole = solution.weight_factor == 1.0
    points = rays.point[rows[0]]
    names = tuple(rays.points[each] for each in points)
    block = SubBlock(
        place[0],
        np.array(photos, dtype=np.int64),
        np.stack([np.eye(3), solution.photos.rotation]),
        np.stack([np.zeros(3), base]),
        points[usable],
        length * solution.meeting.coordinates[usable],
        max(seuw, 1.0) * _intersection_deviations(base, length, solution, pairs),
    )
    return RelativeOrientation(
        model=place[0],
        left=rays.photos[photos[0]],
        right=rays.photos[photos[1]],
        row=place[1],
        column=place[2],
        points=names,
        left_xy=rays.xy[rows[0]],
        right_xy=rays.xy[rows[1]],
        parallax=solution.parallax,
        parallax_deviation=seuw * pairs.error * np.sqrt(solution.redundancy_number),
        weight_factor=solution.weight_factor,
        in_front=solution.meeting.in_front,
        base=base,
        base_deviation=unit_weight * _base_deviations(base, solution.cofactor[:3, :3] * length**2),
        angles=angles,
        angle_deviation=unit_weight * _angle_deviations(angles, solution.cofactor[3:, 3:]),
        iterations=solution.iterations,
        seuw=seuw,
        max_residual=float(np.abs(solution.parallax[whole]).max()),
        block=block,
        remarks=remarks_on(
            names,
            solution.parallax,
            pairs.error * max(seuw, 1.0),
            solution.weight_factor,
            solution.meeting.in_front,
            base=base,
            seuw=seuw,
            ambiguous=solution.ambiguous,
            exchanged=_exchanged(solution, pairs, max(seuw, 1.0)),
        ),
    )


def _exchanged(solution: _Solution, pairs: Pairs, unit_weight: float) -> list[tuple[int, int]]:
    """Return rows of two points each that do not fit, and do when they are exchanged in one photo."""
    wrong = np.flatnonzero(solution.weight_factor < 1.0)
    if len(wrong) < 2:
        return []
    in_left, in_right = np.meshgrid(wrong, wrong, indexing="ij")
    mixed = Pairs(pairs.left[in_left.ravel()], pairs.right[in_right.ravel()], pairs.error[in_left.ravel()])
    sizes = np.abs(parallaxes(cross_matrix(solution.photos.base) @ solution.photos.rotation, mixed))
    fits = (sizes < _FITS * unit_weight * mixed.error).reshape(in_left.shape)
    first, second = np.nonzero(np.triu(fits & fits.T, k=1))
    return list(zip(wrong[first].tolist(), wrong[second].tolist(), strict=True))


def _base_deviations(base: FloatArray, cofactor: FloatArray) -> FloatArray:
    """Return the root cofactors of the base whose largest component is held."""
    largest = int(np.abs(base).argmax())
    partials = np.eye(3)
    partials[:, largest] -= base / base[largest]
    return np.sqrt(np.maximum(np.diag(partials @ cofactor @ partials.T), 0.0))


def _angle_deviations(angles: FloatArray, cofactor: FloatArray) -> FloatArray:
    partials = angle_rates_from_axes_rotation(angles)
    return np.sqrt(np.maximum(np.diag(partials @ cofactor @ partials.T), 0.0))


def _intersection_deviations(base: FloatArray, length: float, solution: _Solution, pairs: Pairs) -> FloatArray:
    """Return a-priori standard deviations (q, 3) of the intersections of both rays, held orientation."""
    usable = solution.usable
    coordinates = length * solution.meeting.coordinates[usable]
    error = pairs.error[usable] / math.sqrt(2.0)
    if is_compiled():
        deviations = np.empty_like(coordinates)
        seen = Pairs(pairs.left[usable], pairs.right[usable], error)
        kernels.deviations(*seen.arrays, base, np.ascontiguousarray(solution.photos.rotation), coordinates, deviations)
        return deviations
    normals = np.zeros((len(error), 3, 3))
    for centre, rotation, vectors in (
        (np.zeros(3), np.eye(3), pairs.left[usable]),
        (base, solution.photos.rotation, pairs.right[usable]),
    ):
        rotations = np.broadcast_to(rotation, (len(error), 3, 3))
        by_point = perspective_with_partials(coordinates - centre, rotations, -vectors[:, 2]).by_point
        normals += np.swapaxes(by_point, 1, 2) @ by_point
    largest = np.trace(normals, axis1=1, axis2=2)[:, None, None]
    inverse = np.linalg.inv(normals + 1e-15 * largest * np.eye(3))
    return np.asarray(error[:, None] * np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)))
