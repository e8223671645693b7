"""Steps of a refinement with arrays, where the compiled loop was not built: points eliminated, photos in a band."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS, danish_weights
from orip.arrays import FloatArray, IntArray
from orip.geometry.perspective import Perspective, perspective_with_partials
from orip.prelim.least_squares import enlarged_diagonal, group_sums, largest_elements
from orip.prelim.rays import CAMERA_CORRECTIONS
from orip.prelim.refinement.problem import (
    EXPECTED,
    SQUARE_BEHIND,
    RayResiduals,
    RefinementProblem,
    RefinementState,
    by_corrections,
    camera_of,
    corrected,
)
from orip.prelim.sampling import median

if TYPE_CHECKING:
    from scipy.sparse import csr_array


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
