"""The compiled loop over all photo points of a block: one pass gives the normal equations, and no matrix is stored.

Points are eliminated one after the other, those that the same photos show together. Where the extension could not be
built the stored matrix of `orip.adjustment.sparse_rows` does the same, slower.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.band import Arrangement, BandMatrix, Symmetric, band_of
from orip.adjustment.elimination import BlockFactors, EliminatedNormals
from orip.adjustment.equations import BlockNormals, BlockPrecision, Layout
from orip.bundle.photo_point import PhotoPointObservations
from orip.bundle.state import State
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.interior.additional_parameters import PARAMETER_SETS

try:
    from orip.bundle import _observation_loop as compiled
except ImportError:  # the extension is built where there is a compiler
    _IS_COMPILED = False
else:
    _IS_COMPILED = True

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
BoolArray = NDArray[np.bool_]

_CAMERA_PARAMETERS, _FIRST_ADDITIONAL = 11, 20
_MOST_ADDITIONAL, _POLYNOMIALS = 44, 5


class Contributions(NamedTuple):
    """What other observations add to the normal equations before the points are eliminated.

    Attributes
    ----------
    matrix : sparse array (m, m)
    right : array (m,)
    blocks : array (b, 3, 3)
    block_right : array (3 b,)
    """

    matrix: csr_array
    right: FloatArray
    blocks: FloatArray
    block_right: FloatArray


@dataclass(frozen=True, slots=True)
class Cameras:
    """What does not change of c cameras.

    Parameters
    ----------
    kind : array (c,) of int
        0: the polynomial is at ideal coordinates, 1: at measured ones; each camera with a set is a kind of its own.
    products : array (c, 2, 44) of int
        Of the parameters of a camera's set in dx and dy: number of B_i(y) times 5, plus that of A_j(x).
    polynomials : array (c, 5, 5)
        A_j by powers of its argument.
    factors : array (c, 2, 44)
    at_measured : array (c,) of bool
    unknowns : array (c,) of int
        Their number.
    elements, columns : arrays (c, 55) of int
        For each unknown its number among the partials, and its column.
    """

    kind: IntArray
    products: IntArray
    polynomials: FloatArray
    factors: FloatArray
    at_measured: BoolArray
    unknowns: IntArray
    elements: IntArray
    columns: IntArray


@dataclass(frozen=True, slots=True)
class Pattern:
    """How the photo points of eliminated points go into the normal equations, group by group.

    A group is the points that the same photos show; a run is a camera, or, c added to its number, a photo.

    Parameters
    ----------
    order, start : arrays (k,), (b + 1,)
        Rows of the photo points of point after point, and where each point's begin.
    block : array (b,)
        Number of each of these points among the eliminated ones.
    group_start : array (g + 1,)
        Where each group's points begin.
    runs_start, runs : arrays (g + 1,), (l,)
        Runs that the points of a group are coupled with.
    """

    order: IntArray
    start: IntArray
    block: IntArray
    group_start: IntArray
    runs_start: IntArray
    runs: IntArray


@dataclass(frozen=True, slots=True)
class PhotoLoop:
    """The photo points of a block with the pattern of their normal equations.

    Parameters
    ----------
    points : PhotoPointObservations
    photo, point : arrays (n,) of int
        Those of `points`, in half the room.
    cameras : Cameras
    camera_of_photo : array (p,) of int
    photo_columns : array (p, 6) of int
        `CONSTANT` where there is no unknown.
    pattern : Pattern
    eliminated : array (n,) of bool
        Photo points of points that are eliminated; the others are for somebody else to add.
    """

    points: PhotoPointObservations
    photo: IntArray
    point: IntArray
    cameras: Cameras
    camera_of_photo: IntArray
    photo_columns: IntArray
    pattern: Pattern
    eliminated: BoolArray

    def residuals(self, state: State) -> tuple[FloatArray, BoolArray]:
        """Return residuals (2 n,) divided by their a-priori errors, and which can be computed (2 n,)."""
        residual = np.empty(self.points.xy.size)
        in_front = np.empty(len(self.points.xy), dtype=np.uint8)
        compiled.residuals(*self._observations(state), residual, in_front)
        return residual, np.repeat(in_front.astype(bool), 2)

    def block_normals(
        self, state: State, root_weights: FloatArray, misclosure: FloatArray, others: BlockNormals, layout: Layout
    ) -> BlockNormals:
        """Return the normal equations of the points alone; see `Rows.block_normals`. What is in `others` is used up."""
        found = BlockNormals(*(np.ascontiguousarray(each) for each in others))
        factor = root_weights / self.points.rows.error
        pattern = self._pattern(_whole(layout.reduced))
        compiled.points(*self._observations(state), *pattern, factor, misclosure, *found)
        return found

    def eliminate(
        self,
        state: State,
        root_weights: FloatArray,
        misclosure: FloatArray,
        others: Contributions,
        layout: Layout,
        max_lost_digits: float,
        damping: float,
    ) -> EliminatedNormals:
        """Return the normal equations of photo points and `others`, points eliminated.

        Parameters
        ----------
        state : State
        root_weights, misclosure : arrays (2 n,)
            Root of the weight factors, and weighted residuals with opposite sign; see `Rows.eliminated`.
        others : Contributions
            Its right-hand side of the blocks is used up.
        layout : Layout
        max_lost_digits, damping : float
        """
        m, b = layout.reduced, layout.blocks
        arrangement = layout.arrangement or _whole(m)
        matrix = others.matrix.toarray() if layout.arrangement is None else band_of(others.matrix, arrangement)
        columns = arrangement.columns
        diagonal, right = others.matrix.diagonal()[columns], others.right[columns]
        half, pivots = np.empty((b, 3, 3)), np.empty((b, 3))
        removed = np.empty((b, 3), dtype=np.uint8)
        factor = root_weights / self.points.rows.error
        compiled.eliminate(
            *self._observations(state), *self._pattern(arrangement), factor, misclosure,
            np.ascontiguousarray(layout.fixed[m:]), others.blocks, others.block_right, diagonal, right,
            half, pivots, removed, *_stored(matrix), 10.0**-max_lost_digits, 1.0 + damping,
            *_measures(matrix),
        )  # fmt: skip
        return EliminatedNormals(
            matrix,
            right[arrangement.places],
            diagonal[arrangement.places],
            BlockFactors(half, pivots, removed.astype(bool)),
            StreamedCoupling(self, state, factor, half, m),
            others.block_right,
        )

    def precision(self, coupling: StreamedCoupling, inverse: Symmetric) -> BlockPrecision:
        """Return cofactors (b, 3, 3) of the points and leverages (2 n,), zero where `eliminated` is not."""
        blocks, leverage = np.empty_like(coupling.half), np.zeros(self.points.xy.size)
        arrangement = inverse.arrangement if isinstance(inverse, BandMatrix) else _whole(len(inverse))
        compiled.precision(
            *self._observations(coupling.state), *self._pattern(arrangement), coupling.factor,
            1.0 / self.points.rows.error, coupling.half, *_stored(inverse), blocks, leverage, *_measures(inverse),
        )  # fmt: skip
        return BlockPrecision(blocks, leverage)

    def forward(self, coupling: StreamedCoupling, points: FloatArray) -> FloatArray:
        """Return (H N_pr)^T points (m,) for a vector (3 b,)."""
        found = np.zeros(coupling.size)
        compiled.forward(*self._coupling(coupling), found, np.array(points))
        return found

    def backward(self, coupling: StreamedCoupling, reduced: FloatArray) -> FloatArray:
        """Return H N_pr reduced (3 b,) for a vector (m,)."""
        found = np.empty(3 * len(coupling.half))
        compiled.backward(*self._coupling(coupling), np.array(reduced), found)
        return found

    def staying(self) -> NDArray[np.int64]:
        """Return the rows (of 2 n) of photo points of points that are not eliminated."""
        all_go = self.eliminated.all()
        return np.empty(0, dtype=np.int64) if all_go else np.flatnonzero(np.repeat(~self.eliminated, 2))

    def touched(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return pairs of a group and the first unknown of a camera or photo that it is coupled with."""
        columns = [np.where(each == CONSTANT, np.iinfo(np.int32).max, each).min(axis=1, initial=np.iinfo(np.int32).max)
                   for each in (self.cameras.columns, self.photo_columns)]  # fmt: skip
        first = np.concatenate(columns)[self.pattern.runs]
        group = np.repeat(np.arange(len(self.pattern.runs_start) - 1), np.diff(self.pattern.runs_start))
        is_unknown = first < np.iinfo(np.int32).max
        return group[is_unknown], first[is_unknown].astype(np.int64)

    def _observations(self, state: State) -> tuple[NDArray[np.generic], ...]:
        points, cameras = self.points, self.cameras
        turned = state.turned_by_angles.any()
        arrays = (
            state.cameras, state.additional, state.centres, state.rotations,
            state.rotation_basis() if turned else np.empty(0), state.points, cameras.kind, cameras.products,
            cameras.polynomials, cameras.factors, cameras.at_measured, self.camera_of_photo, self.photo, self.point,
            points.xy, points.rows.error,
        )  # fmt: skip
        return tuple(np.ascontiguousarray(each) for each in arrays)

    def _pattern(self, arrangement: Arrangement) -> tuple[IntArray, ...]:
        p = self.pattern
        # a column that is constant, the last one of these, has no place
        places = np.append(arrangement.places, CONSTANT).astype(np.int32)
        return (
            p.order, p.start, p.block, p.group_start, p.runs_start, p.runs, self.cameras.unknowns,
            self.cameras.elements, places[self.cameras.columns], places[self.photo_columns],
        )  # fmt: skip

    def _coupling(self, coupling: StreamedCoupling) -> tuple[NDArray[np.generic], ...]:
        return (*self._observations(coupling.state), *self._pattern(_whole(coupling.size)), coupling.factor,
                coupling.half)  # fmt: skip


@dataclass(frozen=True, slots=True)
class StreamedCoupling:
    """H N_pr of eliminated points, which is computed where it is needed, and never stored.

    Parameters
    ----------
    loop : PhotoLoop
    state : State
    factor : array (2 n,)
        Roots of the weight factors over the a-priori errors.
    half : array (b, 3, 3)
    size : int
        Number m of reduced unknowns.
    """

    loop: PhotoLoop
    state: State
    factor: FloatArray
    half: FloatArray
    size: int

    def times(self, reduced: FloatArray) -> FloatArray:
        """Return H N_pr times vectors (m,) or (m, k)."""
        return np.apply_along_axis(lambda each: self.loop.backward(self, each), 0, reduced)

    def transposed_times(self, points: FloatArray) -> FloatArray:
        """Return (H N_pr)^T times vectors (3 b,) or (3 b, k)."""
        return np.apply_along_axis(lambda each: self.loop.forward(self, each), 0, points)


def _whole(size: int) -> Arrangement:
    """Return the arrangement of a full matrix."""
    return Arrangement(np.arange(size), size, size)


def _stored(matrix: Symmetric) -> tuple[FloatArray, FloatArray]:
    """Return band and border of a matrix; a full one is a band alone."""
    found = (matrix.band, matrix.border) if isinstance(matrix, BandMatrix) else (matrix, np.empty(0))
    return np.ascontiguousarray(found[0]), np.ascontiguousarray(found[1])


def _measures(matrix: Symmetric) -> tuple[int, int, int]:
    """Return how far columns are apart, and the number of banded places and of all."""
    size = len(matrix)
    if isinstance(matrix, BandMatrix):
        return matrix.arrangement.width, matrix.arrangement.banded, size
    return size, size, size


def is_compiled() -> bool:
    """Whether the compiled loop is there."""
    return _IS_COMPILED


def photo_loop(points: PhotoPointObservations, unknowns: Unknowns) -> PhotoLoop:
    """Return the loop over the photo points of a block.

    Parameters
    ----------
    points : PhotoPointObservations
    unknowns : Unknowns
    """
    block = _blocks_of_points(unknowns)[points.point]
    camera_of_photo = np.zeros(len(unknowns.photos), dtype=np.int32)
    camera_of_photo[points.photo] = points.camera
    return PhotoLoop(
        points,
        points.photo.astype(np.int32),
        points.point.astype(np.int32),
        _cameras(points, unknowns),
        camera_of_photo,
        np.ascontiguousarray(unknowns.photos, dtype=np.int32),
        _pattern(points.photo, block, unknowns.layout.blocks, camera_of_photo, len(unknowns.cameras)),
        block >= 0,
    )


def _pattern(
    photo: NDArray[np.int64], block: NDArray[np.int64], blocks: int, camera_of_photo: IntArray, cameras: int
) -> Pattern:
    """Return the pattern of photo points in photos (n,) of points of block numbers (n,), negative: not eliminated."""
    order = np.flatnonzero(block >= 0)
    order = order[np.lexsort((photo[order], block[order]))].astype(np.int32)
    start = np.searchsorted(block[order], np.arange(blocks + 1))
    shown = photo[order].astype(np.int32)
    numbers: dict[bytes, int] = {}
    group = np.array(
        [numbers.setdefault(shown[first:last].tobytes(), len(numbers)) for first, last in pairwise(start.tolist())],
        dtype=np.int64,
    )
    by_group = np.argsort(group, kind="stable")
    counts = np.diff(start)[by_group]
    ends = np.cumsum(counts)
    order = order[np.arange(len(order)) + np.repeat(start[by_group] - ends + counts, counts)]
    group_start = np.searchsorted(group[by_group], np.arange(len(numbers) + 1))

    # all points of a group have the runs of its first one
    first = np.zeros(blocks, dtype=bool)
    first[group_start[:-1]] = True
    shown = photo[order][np.repeat(first, counts)]
    of_group = np.repeat(np.arange(len(numbers)), counts[first])
    every = cameras + len(camera_of_photo)
    keys = np.unique(np.concatenate([every * of_group + camera_of_photo[shown], every * of_group + cameras + shown]))
    runs_start = np.searchsorted(keys // every, np.arange(len(numbers) + 1))
    small = (order, np.append(0, ends), by_group, group_start, runs_start, keys % every)
    return Pattern(*(each.astype(np.int32) for each in small))


def _blocks_of_points(unknowns: Unknowns) -> NDArray[np.int64]:
    """Return the number of each point's eliminated block, -1 for points that stay in the reduced system."""
    first = unknowns.points.max(axis=1, initial=CONSTANT) - unknowns.layout.reduced
    block = np.where(first >= 0, first // 3, -1)
    # a point that is constant altogether has no column that tells its block; any block without unknowns will do
    constant = np.flatnonzero((unknowns.points == CONSTANT).all(axis=1))
    free = np.setdiff1d(np.arange(unknowns.layout.blocks), block[block >= 0])
    block[constant[: len(free)]] = free
    return np.asarray(block)


def _cameras(points: PhotoPointObservations, unknowns: Unknowns) -> Cameras:
    count, additional = unknowns.additional.shape
    at_measured = np.zeros(count, dtype=bool)
    at_measured[points.camera] = points.at_measured
    kind = at_measured.astype(np.int32)
    products = np.zeros((count, 2, _MOST_ADDITIONAL), dtype=np.int32)
    factors = np.zeros((count, 2, _MOST_ADDITIONAL))
    polynomials = np.zeros((count, _POLYNOMIALS, _POLYNOMIALS))
    for camera, name, base in points.sets:
        kind[camera] = 2 + camera
        table = PARAMETER_SETS[name].factors
        degree, parameters = table.shape[-1], table.shape[1]
        # each parameter has one product at most in dx, and in dy
        products_of_set = np.abs(table).reshape(2, parameters, -1).argmax(axis=2)
        products[camera, :, :parameters] = products_of_set // degree * _POLYNOMIALS + products_of_set % degree
        factors[camera, :, :parameters] = table.sum(axis=(2, 3))
        at = np.linspace(-1.0, 1.0, degree)
        values = PARAMETER_SETS[name].basis(base * at, np.full(degree, base)).value
        by_powers = np.linalg.solve(np.vander(at, increasing=True), values) / base ** np.arange(degree)[:, None]
        polynomials[camera, :degree, :degree] = by_powers.T
    columns = np.hstack([unknowns.cameras, unknowns.additional])
    numbers = np.append(np.arange(_CAMERA_PARAMETERS), _FIRST_ADDITIONAL + np.arange(additional))
    is_unknown = columns != CONSTANT
    first = np.argsort(~is_unknown, axis=1, kind="stable")
    room = (count, _CAMERA_PARAMETERS + _MOST_ADDITIONAL)
    elements, placed = np.zeros(room, dtype=np.int32), np.full(room, CONSTANT, dtype=np.int32)
    elements[:, : columns.shape[1]] = numbers[first]
    placed[:, : columns.shape[1]] = np.take_along_axis(columns, first, axis=1)
    number = is_unknown.sum(axis=1).astype(np.int32)
    return Cameras(kind, products, polynomials, factors, at_measured, number, elements, placed)
