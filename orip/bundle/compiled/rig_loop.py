"""The compiled loop over the photo points of a block with rigs.

The loop has the elements of rigs' photos as unknowns. The normal equations N that it forms become those of the block by
substitution, T^T N T with the partials T of the elements by exposures and mountings, and its inverse is T Q T^T: points
are eliminated before that, as they are with single photos.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.equations import BlockNormals, BlockPrecision, Layout
from orip.adjustment.factorisation.band import Arrangement, in_order
from orip.adjustment.factorisation.cholesky import Symmetric
from orip.adjustment.factorisation.elimination import Coupling, EliminatedNormals
from orip.adjustment.factorisation.null_space import Amounts, MovementSums, PointMovements
from orip.adjustment.factorisation.substitution import contracted, expanded
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.compiled.photo_loop import Contributions, PhotoPointLoop, photo_loop
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.rigs.starting import ELEMENTS, RigColumns
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.structs import replace


class Substitution(Struct, frozen=True):
    """From the reduced unknowns of a block to those of the loop: all but exposures and mountings, then elements.

    Parameters
    ----------
    kept : array (h,) of int
        Reduced unknowns of the block that are unknowns of the loop.
    rigs : RigColumns
    reduced : int
        Number m of reduced unknowns of the block.
    """

    kept: IntArray
    rigs: RigColumns
    reduced: int

    @property
    def size(self) -> int:
        """Return the number of reduced unknowns of the loop."""
        return len(self.kept) + ELEMENTS * len(self.rigs.photo)

    def matrix(self, state: BlockState) -> csr_array:
        """Return T (h + 6 k, m) at a state."""
        partials, columns = state.partials_of_rigs(), self.rigs.of_photos
        assert partials is not None, "the state of a block with rigs has them"
        photo, element, place = np.nonzero((partials != 0.0) & (columns != CONSTANT)[:, None, :])
        rows = np.concatenate([np.arange(len(self.kept)), len(self.kept) + ELEMENTS * photo + element])
        values = np.concatenate([np.ones(len(self.kept)), partials[photo, element, place]])
        places = np.concatenate([self.kept, columns[photo, place]])
        return csr_array((values, (rows, places)), shape=(self.size, self.reduced))

    def places(self, columns: IntArray) -> IntArray:
        """Return the unknowns of the loop for columns of a block, its eliminated points and elements included."""
        place = np.full(self.reduced + 1, CONSTANT)
        place[self.kept] = np.arange(len(self.kept))
        found = place[np.where((columns >= 0) & (columns < self.reduced), columns, self.reduced)]
        found = np.where(columns >= self.reduced, columns - self.reduced + self.size, found)
        return np.where(columns >= self.rigs.first, columns - self.rigs.first + len(self.kept), found)


class RigLoop(Struct, frozen=True):
    """The photo points of a block with rigs; see `PointLoop`.

    Parameters
    ----------
    points : PhotoPointObservations
    loop : PhotoPointLoop
        With the elements of rigs' photos as unknowns.
    substitution : Substitution
    arrangement : Arrangement or None
        That of the reduced system of the loop.
    """

    points: PhotoPointObservations
    loop: PhotoPointLoop
    substitution: Substitution
    arrangement: Arrangement | None = None

    def staying(self) -> NDArray[np.int64]:
        """Return the rows of photo points of points that are not eliminated."""
        return self.loop.staying()

    def residuals(self, state: BlockState, others: int = 0) -> tuple[FloatArray, BoolArray]:
        """Return residuals divided by their a-priori errors, and which can be computed."""
        return self.loop.residuals(state, others)

    def block_normals(
        self, state: BlockState, root_weights: FloatArray, misclosure: FloatArray, others: BlockNormals, layout: Layout
    ) -> BlockNormals:
        """Return the normal equations of the points."""
        return self.loop.block_normals(state, root_weights, misclosure, others, self._layout(layout))

    def right_side(
        self, state: BlockState, root_weights: FloatArray, misclosure: FloatArray, others: FloatArray, layout: Layout
    ) -> FloatArray:
        """Return the right-hand side (m + 3 b,), points not eliminated."""
        size, m = self.substitution.size, layout.reduced
        of_points = np.concatenate([np.zeros(size), others[m:]])
        found = self.loop.right_side(state, root_weights, misclosure, of_points, self._layout(layout))
        reduced = self.substitution.matrix(state).T @ found[:size]
        return np.concatenate([reduced + others[:m], found[size:]])

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
        """Return the normal equations of photo points and `others`, points eliminated."""
        size, by_unknowns = self.substitution.size, self.substitution.matrix(state)
        nothing = Contributions(csr_array((size, size)), np.zeros(size), others.blocks, others.block_right)
        found = self.loop.eliminate(state, weights, residual, nothing, self._layout(layout), max_lost_digits, damping)
        # of the complete matrix only the diagonal is known: this is what it is at most
        root = abs(by_unknowns).multiply(np.sqrt(found.diagonal)[:, None]).tocsr()
        return replace(
            found,
            matrix=contracted(found.matrix, by_unknowns, others.matrix, layout.arrangement),
            right=by_unknowns.T @ found.right + others.right,
            diagonal=self._largest_diagonal(root) + others.matrix.diagonal(),
            coupling=RigCoupling(found.coupling, by_unknowns),
        )

    def _largest_diagonal(self, root: csr_array) -> FloatArray:
        """Return the sums of squares (m,) of the sums over each photo of T's elements times roots of the diagonal."""
        kept = len(self.substitution.kept)
        elements = np.arange(root.shape[0] - kept)
        photos = csr_array((np.ones(len(elements)), (elements // ELEMENTS, elements)))
        of_photos = (photos @ root[kept:]).power(2).sum(axis=0)
        return np.asarray(root[:kept].power(2).sum(axis=0) + of_photos, dtype=np.float64)

    def precision(self, coupling: Coupling, inverse: Symmetric, amounts: Amounts | None) -> BlockPrecision:
        """Return cofactors (b, 3, 3) of the points and leverages (2 n,)."""
        assert isinstance(coupling, RigCoupling), "the normal equations are those of this loop"
        by_unknowns = coupling.by_unknowns
        if amounts is not None:
            amounts = replace(amounts, with_reduced=by_unknowns @ amounts.with_reduced)
        of_loop = expanded(inverse, by_unknowns, self.arrangement)
        return self.loop.precision(coupling.of_loop, of_loop, amounts)

    def _layout(self, layout: Layout) -> Layout:
        size = self.substitution.size
        fixed = np.concatenate([np.zeros(size, dtype=bool), layout.fixed[layout.reduced :]])
        return Layout(size, layout.blocks, fixed, self.arrangement)

    def touched(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return pairs of a set of photos that show a point, and an unknown of the block that it touches."""
        number, column = self.loop.touched()
        kept, rigs = self.substitution.kept, self.substitution.rigs
        own = column < len(kept)
        photo = (column[~own] - len(kept)) // ELEMENTS
        pairs = [(number[own], kept[column[own]])]
        for columns in (rigs.exposures[rigs.exposure], rigs.mountings[rigs.mounted]):
            first = np.where(columns == CONSTANT, np.iinfo(np.int64).max, columns).min(axis=1)[photo]
            known = first < np.iinfo(np.int64).max
            pairs.append((number[~own][known], first[known]))
        return np.concatenate([one for one, _ in pairs]), np.concatenate([other for _, other in pairs])

    def arranged_as(self, outer: Arrangement | None) -> RigLoop:
        """Return the loop with its reduced system in the order of that of the block, photos where exposures are."""
        if outer is None:
            return self
        kept, rigs = self.substitution.kept, self.substitution.rigs
        exposure = outer.places[rigs.exposures[rigs.exposure, 0]]
        place = np.concatenate([outer.places[kept], np.repeat(exposure, ELEMENTS)]).astype(np.float64)
        photos = np.repeat(np.arange(len(rigs.photo)), ELEMENTS)
        order = np.lexsort((np.concatenate([np.full(len(kept), -1), photos]), place))
        number, column = self.loop.touched()
        return replace(self, arrangement=in_order(order, place < outer.banded, number, column))


class RigCoupling(Struct, frozen=True):
    """H N_pr of a block with rigs: that of the loop times T."""

    of_loop: Coupling
    by_unknowns: csr_array

    def times(self, reduced: FloatArray) -> FloatArray:
        """Return H N_pr times vectors (m,) or (m, k)."""
        return self.of_loop.times(np.asarray(self.by_unknowns @ reduced))

    def transposed_times(self, points: FloatArray) -> FloatArray:
        """Return (H N_pr)^T times vectors (3 b,) or (3 b, k)."""
        return np.asarray(self.by_unknowns.T @ self.of_loop.transposed_times(points))

    def movement_sums(self, points: PointMovements) -> MovementSums:
        """Return what the points contribute to the amounts of movements."""
        found = self.of_loop.movement_sums(points)
        return MovementSums(np.asarray(self.by_unknowns.T @ found.reduced), found.own)

    def of_blocks(self, chosen: NDArray[np.int64]) -> csr_array:
        """Return the rows (3 c, m) of some blocks (c,), which are in ascending order."""
        return csr_array(self.of_loop.of_blocks(chosen) @ self.by_unknowns)


def rig_loop(points: PhotoPointObservations, unknowns: Unknowns, coordinates: FloatArray) -> RigLoop:
    """Return the loop over the photo points of a block with rigs; see `photo_loop`."""
    rigs, reduced = unknowns.rigs, unknowns.layout.reduced
    assert rigs is not None, "photos of rigs have columns"
    is_kept = np.ones(reduced, dtype=bool)
    for table in (rigs.exposures, rigs.mountings):
        is_kept[table[table != CONSTANT]] = False
    substitution = Substitution(np.flatnonzero(is_kept), rigs, reduced)
    places = substitution.places
    of_loop = replace(
        unknowns,
        cameras=places(unknowns.cameras),
        additional=places(unknowns.additional),
        photos=places(unknowns.elements),
        motions=places(unknowns.motions),
        points=places(unknowns.points),
        layout=Layout(
            substitution.size,
            unknowns.layout.blocks,
            np.concatenate([np.zeros(substitution.size, dtype=bool), unknowns.layout.fixed[reduced:]]),
        ),
        rigs=None,
    )
    return RigLoop(points, photo_loop(replace(points, unknowns=of_loop), of_loop, coordinates), substitution)
