"""The normal equations of photos and points that are refined together: points eliminated, photos in a band.

Two solvers do the same: one in the compiled loop, one with arrays where that could not be built.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.geometry.perspective import Perspective, perspective_with_partials
from orip.geometry.rotation import rotation_about_axes
from orip.prelim.compiled import kernels
from orip.prelim.intersection import group_sums

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_MEDIAN = np.sqrt(2.0 * np.log(2.0))
"""Median length of a residual with two normal components of standard deviation 1."""

_DENSE = 0.1
"""Part of the couplings between photos and points above which a product of full matrices is faster."""


@dataclass(frozen=True, slots=True)
class State:
    """Rotations (p, 3, 3) and centres (p, 3) of photos, and points (q, 3)."""

    rotations: FloatArray
    centres: FloatArray
    points: FloatArray


class Residuals(NamedTuple):
    """Of m rays: residuals (m, 2) over their a-priori errors, and whether the point is in front (m,)."""

    residual: FloatArray
    in_front: BoolArray

    @property
    def length(self) -> FloatArray:
        """Return the lengths (m,) of the residuals; infinite behind the photo."""
        return np.where(self.in_front, np.linalg.norm(self.residual, axis=1), np.inf)


@dataclass(frozen=True, slots=True)
class Network:
    """Which of the rays take part, point by point, and which photos and points are unknown.

    Parameters
    ----------
    photo, point : arrays (m,) of int
    vectors : array (m, 3)
    error : array (m,)
    photo_free, point_free : arrays (p,), (q,) of bool
    """

    photo: IntArray
    point: IntArray
    vectors: FloatArray
    error: FloatArray
    photo_free: BoolArray
    point_free: BoolArray

    @property
    def redundancy(self) -> int:
        """Return twice the number of rays minus that of the unknowns."""
        return 2 * len(self.photo) - 6 * int(self.photo_free.sum()) - 3 * int(self.point_free.sum())

    def perspective(self, state: State) -> Perspective:
        """Return images of all rays' points, with partials."""
        offset = state.points[self.point] - state.centres[self.photo]
        return perspective_with_partials(offset, state.rotations[self.photo], -self.vectors[:, 2])

    def scale(self, length: FloatArray) -> float:
        """Return the robust scale of the residuals, from their median; 0 without redundancy."""
        share = self.redundancy / (2 * len(self.photo)) if len(self.photo) else 0.0
        return float(np.median(length)) / _MEDIAN / np.sqrt(share) if share > 0.0 else 0.0


class _Arrangement:
    """The order of the photos of a network that keeps the band of their normal equations narrow.

    Attributes
    ----------
    order : array (f,)
        Free photos.
    place : array (p,)
        Of each photo in this order, -1 of one that is held.
    """

    def __init__(self, network: Network) -> None:
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import reverse_cuthill_mckee

        free = network.photo_free[network.photo]
        photos, points = len(network.photo_free), len(network.point_free)
        ones = np.ones(np.count_nonzero(free))
        sees = csr_array((ones, (network.point[free], network.photo[free])), shape=(points, photos))
        sees = sees[network.point_free]
        order = reverse_cuthill_mckee((sees.T @ sees).tocsr(), symmetric_mode=True)
        self.order = order[network.photo_free[order]]
        self.place = np.full(photos, -1)
        self.place[self.order] = np.arange(len(self.order))


class CompiledSolver:
    """Normal equations of a network in the compiled loop: points eliminated, photos in a band.

    Parameters
    ----------
    network : Network
    """

    def __init__(self, network: Network) -> None:
        self._network = network
        self._arranged = _Arrangement(network)
        points, rays = len(network.point_free), len(network.photo)
        self._start = np.concatenate([[0], np.cumsum(np.bincount(network.point, minlength=points))])
        self._coupling = np.empty((rays, 6, 3))
        self._width = self._band_width()

    def _band_width(self) -> int:
        """Return 6 times the largest number of places that photos of one point are apart, and the photo itself."""
        place = self._arranged.place[self._network.photo]
        taking = (place >= 0) & self._network.point_free[self._network.point]
        first = np.full(len(self._network.point_free), len(place) + 1)
        last = np.full(len(first), -1)
        np.minimum.at(first, self._network.point[taking], place[taking])
        np.maximum.at(last, self._network.point[taking], place[taking])
        return 6 * (int((last - first).max(initial=0, where=last >= 0)) + 1)

    def _arrays(self, state: State) -> tuple[NDArray[np.generic], ...]:
        network = self._network
        each = network.photo, self._start, network.vectors, network.error, state.rotations, state.centres, state.points
        return tuple(map(np.ascontiguousarray, each))

    def residuals(self, state: State) -> Residuals:
        """Return the residuals of all rays."""
        residual, in_front = np.empty((len(self._network.photo), 2)), np.empty(len(self._network.photo), dtype=np.uint8)
        kernels.residuals(*self._arrays(state), residual, in_front)
        return Residuals(residual, in_front.astype(bool))

    def moved(self, state: State, at: Residuals, factors: FloatArray, damping: float) -> State:
        """Return the state after one step; the residuals are those of the state."""
        network, order, place = self._network, self._arranged.order, self._arranged.place
        points, size = len(network.point_free), 6 * len(order)
        weights = np.where(at.in_front, factors, 0.0)
        inverse, point_right, right = np.empty((points, 3, 3)), np.empty((points, 3)), np.zeros(size)
        band = np.zeros((size, self._width))
        kernels.normals(
            *self._arrays(state), place, network.point_free, weights,
            np.zeros((len(order), 6, 6)), self._coupling, inverse, point_right, band, right, damping,
        )  # fmt: skip
        solution = _solved(band.T, right)
        by_points = np.empty((points, 3))
        kernels.corrections(
            network.photo, self._start, place, self._coupling, inverse, point_right, solution, by_points
        )
        by_photos = np.zeros((len(place), 6))
        by_photos[order] = -solution.reshape(-1, 6)
        return _step(state, by_photos, by_points)


class ArraySolver:
    """The same without a compiled loop.

    Parameters
    ----------
    network : Network
    """

    def __init__(self, network: Network) -> None:
        self._network = network
        self._arranged = _Arrangement(network)

    def residuals(self, state: State) -> Residuals:
        """Return the residuals of all rays."""
        network = self._network
        image = network.perspective(state)
        return Residuals((image.xy - network.vectors[:, :2]) / network.error[:, None], image.in_front)

    def moved(self, state: State, at: Residuals, factors: FloatArray, damping: float) -> State:
        """Return the state after one step; the residuals are those of the state."""
        network, order = self._network, self._arranged.order
        image = network.perspective(state)
        root = (np.sqrt(np.where(at.in_front, factors, 0.0)))[:, None]
        scaled = (root / network.error[:, None])[:, :, None]
        by_point = image.by_point * scaled * network.point_free[network.point, None, None]
        by_photo = np.concatenate([image.by_rotation, -image.by_point], axis=2) * scaled
        by_photo *= network.photo_free[network.photo, None, None]
        misclosure = (at.residual * root)[:, :, None]
        photo_transposed, point_transposed = np.swapaxes(by_photo, 1, 2), np.swapaxes(by_point, 1, 2)
        photos, points = len(network.photo_free), len(network.point_free)
        photo_normals = _damped(group_sums(network.photo, photo_transposed @ by_photo, photos), damping)
        point_normals = _damped(group_sums(network.point, point_transposed @ by_point, points), damping)
        photo_right = group_sums(network.photo, (photo_transposed @ misclosure)[:, :, 0], photos)
        point_right = group_sums(network.point, (point_transposed @ misclosure)[:, :, 0], points)

        inverse = np.linalg.inv(point_normals)
        half = np.swapaxes(np.linalg.cholesky(inverse), 1, 2)
        coupling = half[network.point] @ (point_transposed @ by_photo)
        block_right = (half @ point_right[:, :, None])[:, :, 0]
        sparse = self._sparse(coupling)
        right = photo_right[order].ravel() - sparse.T @ block_right.ravel()
        solution = _solve_band(photo_normals[order], sparse, right)
        block = (block_right.ravel() - sparse @ solution).reshape(points, 1, 3)
        by_photos = np.zeros((photos, 6))
        by_photos[order] = -solution.reshape(-1, 6)
        return _step(state, by_photos, -(block @ half)[:, 0])

    def _sparse(self, coupling: FloatArray) -> csr_array:
        """Return couplings (m, 3, 6) of points and photos as a sparse array (3 q, 6 free photos)."""
        from scipy.sparse import bsr_array, csr_array

        network, place = self._network, self._arranged.place
        rows = np.flatnonzero(network.photo_free[network.photo] & network.point_free[network.point])
        rows = rows[np.lexsort((place[network.photo[rows]], network.point[rows]))]
        counts = np.bincount(network.point[rows], minlength=len(network.point_free))
        pointer = np.concatenate([[0], np.cumsum(counts)])
        shape = (3 * len(network.point_free), 6 * len(self._arranged.order))
        return csr_array(bsr_array((coupling[rows], place[network.photo[rows]], pointer), shape=shape))


def _damped(normals: FloatArray, damping: float) -> FloatArray:
    """Return normal matrices (k, m, m) with a larger diagonal; what has no equations at all becomes regular."""
    diagonal = np.einsum("kii->ki", normals)
    floor = 1e-12 * diagonal.max(axis=1, keepdims=True)
    floor = np.where(floor > 0.0, floor, 1.0)
    return np.asarray(normals + (damping * diagonal + floor)[:, :, None] * np.eye(normals.shape[1]))


def _solve_band(blocks: FloatArray, coupling: csr_array, right: FloatArray) -> FloatArray:
    """Solve (diagonal blocks (k, 6, 6) - coupling^T coupling) x = right as a band matrix."""
    size = len(right)
    if not size:
        return right
    if coupling.nnz > _DENSE * coupling.shape[0] * coupling.shape[1]:
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
    width = int(below.max()) + 1
    band = np.bincount(below * size + columns[lower], values[lower], width * size).reshape(width, size)
    return _solved(np.asarray(band, dtype=np.float64), right)


def _solved(band: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a band matrix, the diagonals (width, size) of its lower half; it is used up if its columns are contiguous.

    Raises
    ------
    LinAlgError
        If it is not positive definite.
    """
    from scipy.linalg.lapack import dpbsv

    if not len(right):
        return right
    _, solution, leading = dpbsv(band, right, lower=True, overwrite_ab=True)
    if leading:
        message = f"the normal equations are not positive definite at row {leading}"
        raise np.linalg.LinAlgError(message)
    return np.asarray(solution)


def _step(state: State, by_photos: FloatArray, by_points: FloatArray) -> State:
    # half a radian keeps a turn where the linearisation means something
    largest = float(np.linalg.norm(by_photos[:, :3], axis=1).max())
    factor = min(1.0, 0.5 / max(largest, 1e-300))
    return State(
        rotation_about_axes(factor * by_photos[:, :3]) @ state.rotations,
        state.centres + factor * by_photos[:, 3:],
        state.points + factor * by_points,
    )
