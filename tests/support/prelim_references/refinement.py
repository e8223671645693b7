"""A refinement of photos and points with arrays: points eliminated, photos in a band."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from msgspec import Struct
from support.prelim_references.iterations import (
    E,
    PrelimProblem,
    enlarged_diagonal,
    group_sums,
    largest_elements,
    least_squares,
)

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS, danish_weights
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.perspective import Perspective, perspective_with_partials
from orip.geometry.rotation import rotation_about_axes
from orip.prelim import refinement
from orip.prelim.compiled import LARGEST_TURN
from orip.prelim.rays import CAMERA_CORRECTIONS, ImageRays
from orip.prelim.refinement import (
    _ENOUGH,
    _FIRST_DAMPING,
    _LEAST_DAMPING,
    _UPHILL,
    _UPHILL_STEPS,
    EXPECTED,
    MEDIAN_LENGTH,
    Refined,
    camera_of,
    corrected,
)
from orip.prelim.sampling import median

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def by_corrections(rays: ImageRays) -> FloatArray:
    """Return the partials (n, 2, `CAMERA_CORRECTIONS`) of residuals, computed minus measured, by corrections.

    Those by the first are the computed coordinates themselves; the factor 1 is returned for them. 0 for corrections
    that are known; an empty array where all cameras are known.
    """
    camera = camera_of(rays)
    partials = np.zeros((len(camera), 2, CAMERA_CORRECTIONS))
    if len(camera):
        x, y, z = rays.vectors.T
        radial = (x * x + y * y) / (z * z)
        partials[:, :, 0] = 1.0
        partials[:, 0, 1] = partials[:, 1, 2] = z
        partials[:, 0, 3], partials[:, 1, 3] = -radial * x, -radial * y
        # the last row is that of known cameras
        unknown = np.vstack([rays.cameras.unknown, np.zeros(CAMERA_CORRECTIONS, dtype=bool)])
        partials *= unknown[camera, None, :]
    return partials


SQUARE_BEHIND = 1e6
"""Squared standard residual that a ray has whose point lies behind the photo."""


class RefinementState(Struct, frozen=True):
    """Rotations (p, 3, 3) and centres (p, 3) of photos, points (q, 3), and corrections of k cameras (k, 4)."""

    rotations: FloatArray
    centres: FloatArray
    points: FloatArray
    corrections: FloatArray

    @property
    def of_cameras(self) -> float:
        """Return the square sum of the cameras' corrections over their a-priori standard deviations."""
        return float(((self.corrections / EXPECTED) ** 2).sum())

    def moved(self, by_photos: FloatArray, by_points: FloatArray, by_cameras: FloatArray) -> RefinementState:
        """Return the state after turns and shifts (p, 6) of photos, shifts of points, and changes of corrections."""
        largest = float(np.linalg.norm(by_photos[:, :3], axis=1).max(initial=0.0))
        factor = min(1.0, LARGEST_TURN / max(largest, 1e-300))
        return RefinementState(
            rotation_about_axes(factor * by_photos[:, :3]) @ self.rotations,
            self.centres + factor * by_photos[:, 3:],
            self.points + factor * by_points,
            self.corrections + factor * by_cameras,
        )


class RayResiduals(NamedTuple):
    """Squares (m,) and lengths (m,) of the residuals of m rays over their a-priori errors.

    Of points behind the photo the squares are `SQUARE_BEHIND`, and the lengths infinite. `of_cameras` is what the
    corrections of the cameras add to the square sum.
    """

    squares: FloatArray
    lengths: FloatArray
    of_cameras: float


class RefinementProblem(Struct, frozen=True, dict=True):
    """Which rays take part, point by point, and which photos and points are unknown.

    Parameters
    ----------
    rays : ImageRays
        m of them.
    photo_free, point_free : arrays (p,), (q,) of bool
    """

    rays: ImageRays
    photo_free: BoolArray
    point_free: BoolArray

    @cached_property
    def redundancy(self) -> int:
        """Return twice the number of rays minus the number of unknowns."""
        return 2 * len(self.rays.photo) - 6 * int(self.photo_free.sum()) - 3 * int(self.point_free.sum())

    @cached_property
    def median_length(self) -> float:
        """Return the median of the lengths of residuals that are as large as expected; 0 without redundancy."""
        share = self.redundancy / (2 * len(self.rays.photo)) if len(self.rays.photo) else 0.0
        return MEDIAN_LENGTH * math.sqrt(share) if share > 0.0 else 0.0


class ReducedEquations(NamedTuple):
    """n equations of photos and c of cameras.

    Attributes
    ----------
    band : array (width, n)
        Diagonals of the lower half of the photos' matrix; overwritten if its columns are contiguous.
    right : array (n,)
    border : array (n, c)
    own : array (c, c)
        Of the cameras.
    own_right : array (c,)
    """

    band: FloatArray
    right: FloatArray
    border: FloatArray
    own: FloatArray
    own_right: FloatArray

    def solved(self, corrections: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the solution for photos (n,) and cameras (c,).

        Parameters
        ----------
        corrections : array (cameras, 4)
            Of the cameras so far; they are observed to be 0 with the standard deviations `EXPECTED`.

        Raises
        ------
        LinAlgError
            If the photos' matrix is not positive definite.
        """
        if not corrections.size:
            return _solved(self.band, self.right), np.empty(0)
        solved = _solved(self.band, np.asfortranarray(np.column_stack([self.right, self.border])))
        weights = np.broadcast_to(EXPECTED**-2.0, corrections.shape).ravel()
        own = self.own + np.diag(weights) - self.border.T @ solved[:, 1:]
        right = self.own_right + weights * corrections.ravel() - self.border.T @ solved[:, 0]
        of_cameras = np.asarray(np.linalg.solve(own, right), dtype=np.float64)
        return solved[:, 0] - solved[:, 1:] @ of_cameras, of_cameras


def _solved(band: FloatArray, right: FloatArray) -> FloatArray:
    from scipy.linalg.lapack import dpbsv

    if not len(right):
        return right
    _, solution, leading = dpbsv(band, right, lower=True, overwrite_ab=True)
    if leading:
        message = f"the normal equations are not positive definite at row {leading}"
        raise np.linalg.LinAlgError(message)
    return np.asarray(solution)


class BandOrder(NamedTuple):
    """The order of the photos.

    Attributes
    ----------
    order : array (f,)
        Free photos.
    place : array (p,)
        Place of each photo in this order; -1 for a photo that is held.
    places : int
        Largest number of places, both counted, from the first to the last photo of a free point.
    """

    order: IntArray
    place: IntArray
    places: int


def band_order(problem: RefinementProblem) -> BandOrder:
    """Order the free photos of a refinement by the reverse method of Cuthill and McKee (1969; George 1971).

    Photos that see a common free point are neighbours. Each part of the block begins with a photo that has fewest
    neighbours; neighbours follow by their numbers of neighbours, equal ones by their indices.
    """
    neighbours = _neighbours(problem)
    waiting = sorted(np.flatnonzero(problem.photo_free).tolist(), key=lambda photo: len(neighbours[photo]))
    found: dict[int, None] = {}
    for first in waiting:
        level = [first] if first not in found else []
        while level:
            found.update(dict.fromkeys(level))
            following: dict[int, None] = {}
            for photo in level:
                unfound = (other for other in neighbours[photo] if other not in found)
                following.update(dict.fromkeys(sorted(unfound, key=lambda other: (len(neighbours[other]), other))))
            level = list(following)
    order = np.array([*found][::-1], dtype=np.int64)
    place = np.full(len(problem.photo_free), -1)
    place[order] = np.arange(len(order))
    return BandOrder(order, place, _places(problem, place))


def _neighbours(problem: RefinementProblem) -> list[list[int]]:
    """Return for each photo the other free ones that see a free point that it sees, ascending; none of a held photo."""
    from scipy.sparse import csr_array

    rays = problem.rays
    taking = problem.photo_free[rays.photo] & problem.point_free[rays.point]
    shape = (len(problem.point_free), len(problem.photo_free))
    sees = csr_array((np.ones(np.count_nonzero(taking)), (rays.point[taking], rays.photo[taking])), shape=shape)
    photo, other = (sees.T @ sees).nonzero()
    pairs = sorted(zip(photo.tolist(), other.tolist(), strict=True))
    neighbours: list[list[int]] = [[] for _ in problem.photo_free]
    for one, two in pairs:
        if one != two:
            neighbours[one].append(two)
    return neighbours


def _places(problem: RefinementProblem, place: IntArray) -> int:
    of_rays, point = place[problem.rays.photo], problem.rays.point
    taking = (of_rays >= 0) & problem.point_free[point]
    first = np.full(len(problem.point_free), len(place) + 1)
    last = np.full(len(first), -1)
    np.minimum.at(first, point[taking], of_rays[taking])
    np.maximum.at(last, point[taking], of_rays[taking])
    return int((last - first).max(initial=-1, where=last >= 0)) + 1


_DENSE = 0.1
"""Part of the couplings between photos and points above which a product of full matrices is faster."""


_FLOOR = 1e-12
"""Part of the largest diagonal element that is added to make normal equations without observations regular."""


class _Rows(NamedTuple):
    """Linearised equations of m rays, weighted: partials (m, 2, k) and misclosures (m, 2, 1)."""

    by_photo: FloatArray
    by_point: FloatArray
    by_camera: FloatArray
    misclosure: FloatArray


class ArraySolver:
    """Normal equations of a refinement: points eliminated, photos in a band.

    Parameters
    ----------
    problem : RefinementProblem
    """

    def __init__(self, problem: RefinementProblem) -> None:
        self._problem = problem
        self._band_order = band_order(problem)

    def residuals(self, state: RefinementState) -> RayResiduals:
        """Return the residuals of all rays."""
        image = self._perspective(state)
        squares = np.where(image.in_front, (self._misclosures(state, image) ** 2).sum(axis=1), SQUARE_BEHIND)
        return RayResiduals(squares, np.where(image.in_front, np.sqrt(squares), np.inf), state.of_cameras)

    def weights(self, lengths: FloatArray) -> tuple[FloatArray, float]:
        """Return the Danish weights (m,) of residuals by their lengths, and their robust scale."""
        unit = self._problem.median_length
        scale = median(lengths) / unit if unit else 0.0
        with np.errstate(invalid="ignore"):  # with coordinates in another unit residuals may overflow
            return danish_weights(lengths / max(scale, 1.0), LIMIT_OF_TWO_COMPONENTS), scale

    def moved(self, state: RefinementState, factors: FloatArray, damping: float) -> RefinementState:
        """Return the state after one step with weight factors (m,) of the rays."""
        order, photos, points = self._band_order.order, len(state.centres), len(state.points)
        rows = self._rows(state, factors)
        inverse = np.linalg.inv(_damped(self._by_points(rows.by_point, rows.by_point), damping))
        half = np.swapaxes(np.linalg.cholesky(inverse), 1, 2)
        # eliminating the points subtracts the product of these with themselves
        coupling = self._sparse(half[self._problem.rays.point] @ (np.swapaxes(rows.by_point, 1, 2) @ rows.by_photo))
        point_right = (half @ self._by_points(rows.by_point, rows.misclosure)).ravel()
        point_border = (half @ self._by_points(rows.by_point, rows.by_camera)).reshape(
            3 * points, state.corrections.size
        )
        blocks = _damped(self._by_photos(rows.by_photo, rows.by_photo), damping)
        equations = ReducedEquations(
            _band(blocks[order], coupling),
            self._by_photos(rows.by_photo, rows.misclosure)[order].ravel() - coupling.T @ point_right,
            self._by_photos(rows.by_photo, rows.by_camera)[order].reshape(6 * len(order), state.corrections.size)
            - coupling.T @ point_border,
            np.einsum("nki,nkj->ij", rows.by_camera, rows.by_camera) - point_border.T @ point_border,
            np.einsum("nki,nkj->i", rows.by_camera, rows.misclosure) - point_border.T @ point_right,
        )
        solution, of_cameras = equations.solved(state.corrections)
        left = (point_right - coupling @ solution - point_border @ of_cameras).reshape(points, 1, 3)
        by_photos = np.zeros((photos, 6))
        by_photos[order] = -solution.reshape(-1, 6)
        return state.moved(by_photos, -(left @ half)[:, 0], -of_cameras.reshape(-1, CAMERA_CORRECTIONS))

    def _rows(self, state: RefinementState, factors: FloatArray) -> _Rows:
        problem, rays = self._problem, self._problem.rays
        image = self._perspective(state)
        root = (np.sqrt(np.where(image.in_front, factors, 0.0)))[:, None]
        scaled = (root / rays.error[:, None])[:, :, None]
        by_photo = np.concatenate([image.by_rotation, -image.by_point], axis=2) * scaled
        return _Rows(
            by_photo * problem.photo_free[rays.photo, None, None],
            image.by_point * scaled * problem.point_free[rays.point, None, None],
            self._by_camera(image.xy, state.corrections.size) * scaled,
            (self._misclosures(state, image) * root)[:, :, None],
        )

    def _by_photos(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return the sums of left^T right over the rays of each photo."""
        return group_sums(self._problem.rays.photo, np.swapaxes(left, 1, 2) @ right, len(self._problem.photo_free))

    def _by_points(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return the sums of left^T right over the rays of each point."""
        return group_sums(self._problem.rays.point, np.swapaxes(left, 1, 2) @ right, len(self._problem.point_free))

    def _misclosures(self, state: RefinementState, image: Perspective) -> FloatArray:
        """Return computed minus measured coordinates (m, 2) over their a-priori errors."""
        rays = corrected(self._problem.rays, state.corrections)
        return np.asarray((image.xy - rays.vectors[:, :2]) / rays.error[:, None])

    def _perspective(self, state: RefinementState) -> Perspective:
        """Return images of all rays' points, with partials."""
        rays = corrected(self._problem.rays, state.corrections)
        offset = state.points[rays.point] - state.centres[rays.photo]
        return perspective_with_partials(offset, state.rotations[rays.photo], -rays.vectors[:, 2])

    def _by_camera(self, image: FloatArray, columns: int) -> FloatArray:
        """Return the partials (m, 2, all cameras' corrections) of the residuals in mm."""
        rays = self._problem.rays
        camera, count = camera_of(rays), len(rays.photo)
        partials = np.zeros((count, 2, columns // CAMERA_CORRECTIONS, CAMERA_CORRECTIONS))
        rows = np.flatnonzero(camera >= 0)
        partials[rows, :, camera[rows]] = by_corrections(rays)[rows]
        partials[:, :, :, 0] *= image[:, :, None]
        return partials.reshape(count, 2, columns)

    def _sparse(self, coupling: FloatArray) -> csr_array:
        """Return couplings (m, 3, 6) of points and photos as a sparse array (3 q, 6 free photos)."""
        from scipy.sparse import bsr_array, csr_array

        problem, place = self._problem, self._band_order.place
        rows = np.flatnonzero(problem.photo_free[problem.rays.photo] & problem.point_free[problem.rays.point])
        rows = rows[np.lexsort((place[problem.rays.photo[rows]], problem.rays.point[rows]))]
        counts = np.bincount(problem.rays.point[rows], minlength=len(problem.point_free))
        pointer = np.concatenate([[0], np.cumsum(counts)])
        shape = (3 * len(problem.point_free), 6 * len(self._band_order.order))
        return csr_array(bsr_array((coupling[rows], place[problem.rays.photo[rows]], pointer), shape=shape))


def _damped(normals: FloatArray, damping: float) -> FloatArray:
    return enlarged_diagonal(normals, damping, _FLOOR * largest_elements(normals))


def _band(blocks: FloatArray, coupling: csr_array) -> FloatArray:
    """Return the lower half of diagonal blocks (k, 6, 6) - coupling^T coupling, its diagonals (width, size)."""
    size = coupling.shape[1]
    if coupling.nnz > _DENSE * coupling.shape[0] * size:
        full = coupling.toarray()
        product = full.T @ full
        rows, columns = np.nonzero(product)
        values = product[rows, columns]
    else:
        sparse = (coupling.T @ coupling).tocoo()
        rows, columns, values = sparse.row.astype(np.int64), sparse.col.astype(np.int64), sparse.data
    start = np.repeat(6 * np.arange(len(blocks)), 36)
    within = np.tile(np.arange(36), len(blocks))
    rows = np.concatenate([start + within // 6, rows])
    columns = np.concatenate([start + within % 6, columns])
    values = np.concatenate([blocks.ravel(), -values])
    lower = rows >= columns
    below = (rows - columns)[lower]
    width = int(below.max(initial=0)) + 1
    band = np.bincount(below * size + columns[lower], values[lower], width * size).reshape(width, size)
    return np.asarray(band, dtype=np.float64)


def refined(
    rays: ImageRays, block: tuple[FloatArray, ...], oriented: BoolArray, held_points: BoolArray, enough: float
) -> Refined:
    rotations, centres, coordinates, corrections = block
    problem, used = _problem(rays, oriented, coordinates, held_points)
    weight_factors = np.zeros(len(rays.photo))
    if not len(problem.rays.photo):
        return Refined(rotations, centres, coordinates, corrections, weight_factors, 0.0, 0)
    # a system of the block's own size: damping treats angles and lengths alike
    base = centres[oriented].mean(axis=0)
    size = float(np.linalg.norm(coordinates[problem.rays.point] - centres[problem.rays.photo], axis=1).mean())
    start = RefinementState(rotations, (centres - base) / size, (coordinates - base) / size, corrections)
    robust = _RobustRefinement(problem, enough)
    found = least_squares(robust, robust.start(start), _UphillSteps(), refinement._MOST_STEPS)
    state, s0, iterations = found.best.state, found.best.s0, found.iterations
    weight_factors[used] = found.best.weights
    moved_photos = np.zeros(len(rays.photos), dtype=bool)
    moved_photos[problem.rays.photo] = problem.photo_free[problem.rays.photo]
    moved_points = np.zeros(len(rays.points), dtype=bool)
    moved_points[problem.rays.point] = problem.point_free[problem.rays.point]
    return Refined(
        np.where(moved_photos[:, None, None], state.rotations, rotations),
        np.where(moved_photos[:, None], base + size * state.centres, centres),
        np.where(moved_points[:, None], base + size * state.points, coordinates),
        state.corrections,
        weight_factors,
        s0,
        iterations,
    )


def _problem(
    rays: ImageRays, oriented: BoolArray, coordinates: FloatArray, held_points: BoolArray
) -> tuple[RefinementProblem, IntArray]:
    """Return the problem, and the rays that take part: those of points that two photos see, or that are known."""
    known = np.asarray(np.isfinite(coordinates).all(axis=1), dtype=bool)
    used = oriented[rays.photo] & known[rays.point]
    number = np.bincount(rays.point[used], minlength=len(rays.points))
    used &= (number >= 2)[rays.point] | held_points[rays.point]
    rows = np.flatnonzero(used)
    rows = rows[np.argsort(rays.point[rows], kind="stable")]
    seen = np.zeros(len(rays.points), dtype=bool)
    seen[rays.point[rows]] = True
    taking = np.zeros(len(rays.photos), dtype=bool)
    taking[rays.photo[rows]] = True
    problem = RefinementProblem(rays.of(rows), taking, seen & ~held_points)
    return problem, rows


class _Estimate(NamedTuple):
    """Where the iterations stand: residuals, their robust scale, and weight factors (m,)."""

    state: RefinementState
    residuals: RayResiduals
    s0: float
    weights: FloatArray


class _RobustRefinement:
    """The least squares problem of a refinement, with weights of the Danish method."""

    def __init__(self, problem: RefinementProblem, enough: float) -> None:
        self._problem, self._enough = problem, enough
        self._solver = ArraySolver(problem)

    def start(self, state: RefinementState) -> _Estimate:
        return self.reweighted(_Estimate(state, self._solver.residuals(state), 0.0, np.empty(0)))

    def stepped(self, here: _Estimate, damping: FloatArray) -> _Estimate:
        state = self._solver.moved(here.state, here.weights, float(damping[0]))
        return here._replace(state=state, residuals=self._solver.residuals(state))

    def reweighted(self, here: _Estimate) -> _Estimate:
        weights, s0 = self._solver.weights(here.residuals.lengths)
        return here._replace(s0=s0, weights=weights)

    def costs(self, here: _Estimate, weights: FloatArray) -> FloatArray:
        """Return the weighted square sum (1,) of residuals and of the cameras' corrections.

        A ray that has come to lie behind its photo counts as a large residual.
        """
        return np.array([weights @ here.residuals.squares + here.residuals.of_cameras])

    def converged(self, before: _Estimate, after: _Estimate) -> bool:
        """Return whether the gain is small, both with the weights before the step and with the new ones."""
        cost, improved, reweighted = (
            float(self.costs(at, weights)[0])
            for at, weights in ((before, before.weights), (after, before.weights), (after, after.weights))
        )
        gain = min(cost - improved, abs(cost - reweighted))
        return gain <= (self._enough * cost or _ENOUGH * max(before.s0, 1.0) ** 2)


class _UphillSteps:
    """Marquardt's damping that allows for steps uphill.

    Along a curved valley a full step often leads uphill and the next one far down: two such steps are taken. If they do
    not help, the iterations go back to the best estimate with more damping, and no further uphill steps are taken.
    """

    exhausted = False

    def __init__(self) -> None:
        self.damping = np.array([_FIRST_DAMPING])
        self.on_trust = False
        self._steps_left, self._refused = _UPHILL_STEPS, False

    def accepts(self, problem: PrelimProblem[E], best: E, tried: E) -> BoolArray:
        """Return whether the square sum is no larger; otherwise decide whether to go on from there nevertheless."""
        before, after = problem.costs(best, best.weights)[0], problem.costs(tried, best.weights)[0]
        was_on_trust, self.on_trust = self.on_trust, False
        if after <= before:
            self.damping = np.maximum(self.damping * (1.0 if self._refused else 0.1), _LEAST_DAMPING)
            self._refused = False
            if self._steps_left >= 0:
                self._steps_left = _UPHILL_STEPS
            return np.array([True])
        if self._steps_left > 0 and after <= _UPHILL * before:
            self.on_trust = True
            self._steps_left -= 1
            return np.array([False])
        if was_on_trust:
            self._steps_left = _NEVER_AGAIN
        self.singular()
        self._refused = True
        return np.array([False])

    def singular(self) -> None:
        """Damp the next step more: the damping so far was less than rounding in nearly singular equations."""
        self.damping, self.on_trust = self.damping * 10.0, False


_NEVER_AGAIN = -1
