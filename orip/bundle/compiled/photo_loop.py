"""The compiled loop over all photo points of a block: one pass gives the normal equations, and no matrix is stored.

Points are eliminated one after the other, those measured in the same photos in one go. Where the extension could not be
built, the stored matrix of `orip.adjustment.sparse_rows` does the same more slowly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.equations import BlockNormals, BlockPrecision, Layout
from orip.adjustment.factorisation.band import Arrangement, BandMatrix, band_of
from orip.adjustment.factorisation.cholesky import Symmetric
from orip.adjustment.factorisation.elimination import BlockFactors, Coupling, EliminatedNormals
from orip.adjustment.factorisation.fronts import DissectedMatrix
from orip.adjustment.factorisation.null_space import Amounts, MovementSums, PointMovements
from orip.arrays import BoolArray, FloatArray
from orip.bundle.compiled.loop_arguments import MOVEMENTS, amounts_of, measures, movements, stored, whole
from orip.bundle.compiled.loop_pattern import Cameras, Pattern, blocks_of_points, cameras_of_loop, pattern_of_loop
from orip.bundle.kinds.photo_point import POINT_PARTIALS, PhotoPointObservations
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.records.camera import READOUT
from orip.threads import at_once, available_threads

try:
    from orip.bundle.compiled import _observation_loop as compiled
except ImportError:  # the extension is built where there is a compiler
    _IS_COMPILED = False
else:
    _IS_COMPILED = True

IntArray = NDArray[np.int32]

_PHOTO_ORDER = (0, 1, 2, 5, 3, 4)

_VECTORS = 8
"""As MOST_VECTORS of substitution.h."""

_RAYS_OF_A_THREAD = 5000
"""Photo points for which a thread pays: a loop goes through them in one to two milliseconds."""


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


class PhotoPointLoop(Struct, frozen=True):
    """The photo points of a block with the pattern of their normal equations.

    Parameters
    ----------
    points : PhotoPointObservations
    cameras : Cameras
    camera_of_photo : array (p,) of int
    photo_columns : array (p, 6), (p, 9) or (p, 12) of int
        X0, Y0, Z0, KAPPA, OMEGA, PHI, in the order of the columns, then velocities and angular rates where they are
        unknowns of any photo; `CONSTANT` where there is no unknown.
    pattern : Pattern
    block : array (n,) of int
        Which eliminated point each photo point is of, -1 for those of points that are not; the caller adds these.
    layout : object
        The extension's own copy of all index arrays, checked when it was made; None where there is no extension.
    """

    points: PhotoPointObservations
    cameras: Cameras
    camera_of_photo: IntArray
    photo_columns: IntArray
    pattern: Pattern
    block: NDArray[np.int32]
    layout: object

    @property
    def eliminated(self) -> BoolArray:
        """Return which photo points (n,) are of points that are eliminated."""
        return np.asarray(self.block >= 0)

    def residuals(self, state: BlockState, others: int = 0) -> tuple[FloatArray, BoolArray]:
        """Return residuals divided by their a-priori errors, and which can be computed; see `PointLoop.residuals`."""
        rows = self.points.xy.size
        residual, in_front = np.empty(rows + others), np.empty(rows + others, dtype=bool)
        self._compute(compiled.residuals, *self._observations(state), residual[:rows], in_front[:rows].view(np.uint8))
        return residual, in_front

    def block_normals(
        self, state: BlockState, root_weights: FloatArray, misclosure: FloatArray, others: BlockNormals, layout: Layout
    ) -> BlockNormals:
        """Return the normal equations of the points; see `DesignMatrix.block_normals`. `others` is overwritten."""
        found = BlockNormals(*(np.ascontiguousarray(array) for array in others))
        factor = root_weights / self.points.rows.error
        places = self._places(whole(layout.reduced))
        self._compute(compiled.points, *self._observations(state), *places, factor, misclosure, *found)
        return found

    def eliminate(
        self,
        state: BlockState,
        weights: FloatArray,
        residual: FloatArray,
        others: Contributions,
        layout: Layout,
        max_lost_digits: float,
        damping: float,
    ) -> EliminatedNormals:
        """Return the normal equations of photo points and `others`, points eliminated.

        Parameters
        ----------
        state : BlockState
        weights, residual : arrays (2 n,)
            See `DesignMatrix.eliminated`.
        others : Contributions
            Its `block_right` is overwritten.
        layout : Layout
        max_lost_digits, damping : float
        """
        m, b = layout.reduced, layout.blocks
        arrangement = layout.arrangement or whole(m)
        matrix = others.matrix.toarray() if layout.arrangement is None else band_of(others.matrix, arrangement)
        columns = arrangement.columns
        diagonal, right = others.matrix.diagonal()[columns], others.right[columns]
        half, pivots = np.empty((b, 3, 3)), np.empty((b, 3))
        removed = np.empty((b, 3), dtype=np.uint8)
        factor = np.empty(len(weights))
        self._compute(
            compiled.eliminate, *self._observations(state), *self._places(arrangement), weights, residual,
            np.ascontiguousarray(layout.fixed[m:]), others.blocks, factor, others.block_right, diagonal, right,
            half, pivots, removed, *stored(matrix), 10.0**-max_lost_digits, 1.0 + damping,
            *measures(matrix),
        )  # fmt: skip
        return EliminatedNormals(
            matrix,
            right[arrangement.places],
            diagonal[arrangement.places],
            BlockFactors(half, pivots, removed.astype(bool)),
            StreamedCoupling(self, state, factor, half, m),
            others.block_right,
        )

    def right_side(
        self, state: BlockState, root_weights: FloatArray, misclosure: FloatArray, others: FloatArray, layout: Layout
    ) -> FloatArray:
        """Return the right-hand side (m + 3 b,), points not eliminated; see `DesignMatrix.right_side`."""
        found, m = others.copy(), layout.reduced
        factor = root_weights / self.points.rows.error
        places = self._places(whole(m))
        self._compute(compiled.right, *self._observations(state), *places, factor, misclosure, found[:m], found[m:])
        return found

    def precision(self, coupling: Coupling, inverse: Symmetric, amounts: Amounts | None) -> BlockPrecision:
        """Return cofactors (b, 3, 3) of the points and leverages (2 n,), zero where `eliminated` is not."""
        assert isinstance(coupling, StreamedCoupling), "the normal equations are those of this loop"
        assert not isinstance(inverse, DissectedMatrix), "and so is their inverse"
        blocks, leverage = np.empty_like(coupling.half), np.zeros(self.points.xy.size)
        arrangement = inverse.arrangement if isinstance(inverse, BandMatrix) else whole(len(inverse))
        self._compute(
            compiled.precision, *self._observations(coupling.state), *self._places(arrangement), coupling.factor,
            1.0 / self.points.rows.error, coupling.half, *stored(inverse), *amounts_of(amounts, arrangement), blocks,
            leverage, *measures(inverse),
        )  # fmt: skip
        return BlockPrecision(blocks, leverage)

    def movement_sums(self, coupling: StreamedCoupling, points: PointMovements) -> MovementSums:
        """Return what eliminated points contribute to the amounts of movements."""
        d = points.coefficients.shape[1]
        reduced, own = np.zeros((coupling.size, MOVEMENTS)), np.zeros((MOVEMENTS, MOVEMENTS))
        self._compute(compiled.movements, *self._coupling(coupling), *movements(points), reduced, own)
        return MovementSums(reduced[:, :d], own[:d, :d])

    def forward(self, coupling: StreamedCoupling, points: FloatArray) -> FloatArray:
        """Return (H N_pr)^T points (k, m) for vectors (k, 3 b)."""
        found = np.zeros((len(points), coupling.size))
        for part in _parts(len(points)):
            self._compute(
                compiled.forward, *self._coupling(coupling), found[part], np.array(points[part], order="C"),
                float(len(found[part])),
            )  # fmt: skip
        return found

    def backward(self, coupling: StreamedCoupling, reduced: FloatArray) -> FloatArray:
        """Return H N_pr reduced (k, 3 b) for vectors (k, m)."""
        found = np.empty((len(reduced), 3 * len(coupling.half)))
        for part in _parts(len(reduced)):
            self._compute(
                compiled.backward, *self._coupling(coupling), np.array(reduced[part], order="C"), found[part],
                float(len(found[part])),
            )  # fmt: skip
        return found

    def staying(self) -> NDArray[np.int64]:
        """Return the rows (of 2 n) of photo points of points that are not eliminated."""
        all_go = self.eliminated.all()
        return np.empty(0, dtype=np.int64) if all_go else np.flatnonzero(np.repeat(~self.eliminated, 2))

    def touched(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return pairs of a set of photos that show a point, and the first unknown of one of them or of its camera."""
        largest = np.iinfo(np.int32).max
        columns = [
            np.where(table == CONSTANT, largest, table).min(axis=1, initial=largest)
            for table in (self.cameras.columns, self.photo_columns)
        ]
        first = np.concatenate(columns)[self.pattern.coupled]
        number = np.repeat(np.arange(len(self.pattern.coupled_start) - 1), np.diff(self.pattern.coupled_start))
        is_unknown = first < largest
        return number[is_unknown], first[is_unknown].astype(np.int64)

    def _compute(self, loop: Callable[..., None], *arguments: object) -> None:
        """Let a loop go through the block, with as many threads as that pays for."""
        most = len(self.block) // _RAYS_OF_A_THREAD
        threads = min(available_threads(), most) if most > 1 else 1
        call = partial(loop, self.layout, compiled.turns(float(threads)), *arguments)
        at_once([call] * threads)

    def _observations(self, state: BlockState) -> tuple[object, ...]:
        points, cameras = self.points, self.cameras
        turned, nothing = state.turned_by_angles.any(), np.empty(0)
        moving = (nothing,) * 3 if points.readout_a_mm is None else self._motions(state, points.readout_a_mm)
        arrays = (
            state.cameras, cameras.deformation(state.additional), state.centres, state.rotations,
            state.rotation_basis() if turned else nothing, state.points, cameras.by_powers, cameras.term_factors,
            points.xy, points.rows.error, *moving,
        )  # fmt: skip
        return tuple(np.ascontiguousarray(array) for array in arrays)

    def _motions(self, state: BlockState, a_mm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return motions of photos a second, if a readout is unknown, those during it, and the readout in a mm."""
        during = state.cameras[self.camera_of_photo, READOUT, None] * state.motions + state.motion_corrections
        is_unknown = (self.points.unknowns.cameras[:, READOUT] != CONSTANT).any()
        return state.motions if is_unknown else np.empty(0), during, a_mm

    def _places(self, arrangement: Arrangement) -> tuple[IntArray, IntArray]:
        places = np.append(arrangement.places, CONSTANT).astype(np.int32)  # CONSTANT is -1, the last index
        return places[self.cameras.columns], places[self.photo_columns]

    def _coupling(self, coupling: StreamedCoupling) -> tuple[object, ...]:
        return (*self._observations(coupling.state), *self._places(whole(coupling.size)), coupling.factor,
                coupling.half)  # fmt: skip


class StreamedCoupling(Struct, frozen=True):
    """H N_pr of eliminated points, which is computed where it is needed, and never stored.

    Parameters
    ----------
    loop : PhotoPointLoop
    state : BlockState
    factor : array (2 n,)
        Roots of the weights over the a-priori errors, of photo points of eliminated points.
    half : array (b, 3, 3)
    size : int
        Number m of reduced unknowns.
    """

    loop: PhotoPointLoop
    state: BlockState
    factor: FloatArray
    half: FloatArray
    size: int

    def times(self, reduced: FloatArray) -> FloatArray:
        """Return H N_pr times vectors (m,) or (m, k)."""
        found = self.loop.backward(self, np.atleast_2d(reduced.T))
        return found[0] if reduced.ndim == 1 else found.T

    def transposed_times(self, points: FloatArray) -> FloatArray:
        """Return (H N_pr)^T times vectors (3 b,) or (3 b, k)."""
        found = self.loop.forward(self, np.atleast_2d(points.T))
        return found[0] if points.ndim == 1 else found.T

    def movement_sums(self, points: PointMovements) -> MovementSums:
        """Return what the points contribute to the amounts of movements."""
        return self.loop.movement_sums(self, points)

    def of_blocks(self, chosen: NDArray[np.int64]) -> csr_array:
        """Return the rows (3 c, m) of some blocks (c,), which are in ascending order."""
        loop = self.loop
        return rows_of_blocks(loop.points, loop.block, self.state, self.factor, self.half, self.size, chosen)


def rows_of_blocks(
    points: PhotoPointObservations,
    block: NDArray[np.int64] | NDArray[np.int32],
    state: BlockState,
    factor: FloatArray,
    half: FloatArray,
    size: int,
    chosen: NDArray[np.int64],
) -> csr_array:
    """Return the rows H N_pr (3 c, m) of some blocks (c,) in ascending order; see `StreamedCoupling`."""
    mine = np.isin(block, chosen)
    if not mine.any():
        return csr_array((3 * len(chosen), size))
    some = points.of(mine)
    values = some.linearise_with_partials(state)
    partials = values.partials * (factor[np.repeat(mine, 2)] * values.computable)[:, None]
    columns = np.asarray(some.columns(), dtype=np.int64)
    is_reduced = (columns != CONSTANT) & (columns < size)
    row = 3 * np.repeat(np.searchsorted(chosen, block[mine]), 2)
    by_point = np.einsum("nij,nj->ni", np.repeat(half[block[mine]], 2, axis=0), partials[:, POINT_PARTIALS])
    at, place = np.nonzero(is_reduced)
    entries = by_point[at] * partials[at, place][:, None]
    rows = (row[at][:, None] + np.arange(3)).ravel()
    shape = (3 * len(chosen), size)
    return csr_array((entries.ravel(), (rows, np.repeat(columns[at, place], 3))), shape=shape)


def _parts(count: int) -> Iterator[slice]:
    """Yield parts of so many vectors that a loop takes at once."""
    return (slice(start, start + _VECTORS) for start in range(0, count, _VECTORS))


def is_compiled() -> bool:
    """Return whether the compiled loop was built."""
    return _IS_COMPILED


def photo_loop(points: PhotoPointObservations, unknowns: Unknowns, coordinates: FloatArray) -> PhotoPointLoop:
    """Return the loop over the photo points of a block.

    Parameters
    ----------
    points : PhotoPointObservations
    unknowns : Unknowns
    coordinates : array (number of points, 3)
        From which neighbours are known; rough ones will do.
    """
    of_point = blocks_of_points(unknowns).astype(np.int32)  # a number for each of millions of rays follows from it
    block = of_point[points.point]
    of_block = np.zeros((unknowns.layout.blocks, 3))
    of_block[of_point[of_point >= 0]] = coordinates[of_point >= 0]
    camera_of_photo = np.zeros(len(unknowns.photos), dtype=np.int32)
    camera_of_photo[points.photo] = points.camera
    cameras = cameras_of_loop(points, unknowns)
    pattern = pattern_of_loop(points.photo, block, of_block, camera_of_photo, len(unknowns.cameras))
    is_unknown = (unknowns.motions != CONSTANT).any(axis=0)
    # velocities alone are half of a motion, and of the time that it takes
    motions = unknowns.motions[:, : 6 if is_unknown[3:].any() else 3 if is_unknown.any() else 0]
    of_photos = np.hstack([unknowns.photos[:, _PHOTO_ORDER], motions])
    return PhotoPointLoop(
        points,
        cameras,
        camera_of_photo,
        np.ascontiguousarray(of_photos, dtype=np.int32),
        pattern,
        block,
        _layout(points, cameras, camera_of_photo, pattern, of_photos.shape[1]) if _IS_COMPILED else None,
    )


def _layout(
    points: PhotoPointObservations, cameras: Cameras, camera_of_photo: IntArray, pattern: Pattern, of_a_photo: int
) -> object:
    return compiled.layout(
        cameras.kind, cameras.polynomials, cameras.form, camera_of_photo, points.photo.astype(np.int32),
        points.point.astype(np.int32), pattern.order, pattern.start, pattern.block, pattern.group_start,
        pattern.runs_start, pattern.runs, cameras.product_columns, cameras.own_columns, cameras.elements,
        cameras.unknowns, cameras.terms, float(of_a_photo),
    )  # fmt: skip
