"""A block as an adjustment problem whose photo points are divided into sub-blocks, one for each node of the tree."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct, field
from scipy.sparse import csr_array

from orip.adjustment.equations import BlockNormals, BlockPrecision, Layout
from orip.adjustment.factorisation.cholesky import Symmetric
from orip.adjustment.factorisation.dissection import (
    DissectionTree,
    Handles,
    InTurn,
    Passes,
    dissected,
    lowest_nodes,
)
from orip.adjustment.factorisation.elimination import BlockFactors, Coupling, EliminatedNormals
from orip.adjustment.factorisation.fronts import DissectedMatrix, dissected_matrix
from orip.adjustment.factorisation.null_space import Amounts, MovementSums, PointMovements
from orip.archive.blocking import sub_block as node_tasks
from orip.archive.blocking.sub_block import (
    Accuracy,
    HeldSubBlock,
    Members,
    NodeEquations,
    NodePoints,
    SubBlock,
    SubBlockSource,
    divided,
)
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.compiled.loop_pattern import blocks_of_points
from orip.bundle.compiled.photo_loop import Contributions, rows_of_blocks
from orip.bundle.compiled.streamed_rows import groups_of_unknowns, touched_groups
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.problem import BlockProblem, freed, posed
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.errors import NotSolvableError
from orip.records.block import Block
from orip.set_aside import set_aside
from orip.structs import replace


class _Sent(Struct):
    """The state whose parts the nodes have."""

    state: BlockState | None = None
    parts: Handles = ()


class DissectedLoop(Struct, frozen=True):
    """The photo points of a block, divided along a tree.

    Parameters
    ----------
    points : PhotoPointObservations
        Of the whole block.
    block : array (n,) of int
        Which eliminated point each photo point is of, -1 for those of points that are not.
    sources : handles of SubBlockSource
    """

    points: PhotoPointObservations
    block: IntArray
    tree: DissectionTree
    passes: Passes
    sources: Handles
    members: Sequence[Members]
    sent: _Sent = field(default_factory=_Sent)

    @property
    def eliminated(self) -> BoolArray:
        """Return which photo points (n,) are of points that are eliminated."""
        return np.asarray(self.block >= 0)

    def staying(self) -> IntArray:
        """Return the rows (of 2 n) of photo points of points that are not eliminated."""
        return np.flatnonzero(np.repeat(~self.eliminated, 2))

    def residuals(self, state: BlockState, others: int = 0) -> tuple[FloatArray, BoolArray]:
        """Return residuals divided by their a-priori errors, and which can be computed; see `PointLoop.residuals`."""
        size = self.points.xy.size + others
        residual, computable = np.empty(size), np.empty(size, dtype=bool)
        found = self.passes.gathered(self.passes.each(node_tasks.residuals, self.sources, self._state(state)))
        for of_node, (values, in_front) in zip(self.members, found, strict=True):
            residual[of_node.rows], computable[of_node.rows] = values, in_front
        if not self.eliminated.all():
            values = self.points.of(~self.eliminated).linearise_with_partials(state)
            rows = self.staying()
            residual[rows] = values.residual / self.points.rows.error[rows]
            computable[rows] = values.computable
        return residual, computable

    def block_normals(
        self, state: BlockState, root_weights: FloatArray, misclosure: FloatArray, others: BlockNormals, layout: Layout
    ) -> BlockNormals:
        """Return the normal equations of the points; see `DesignMatrix.block_normals`."""
        del layout
        handles = self.passes.each(
            node_tasks.points_alone, self.sources, self._state(state),
            self.of_nodes(lambda of_node: root_weights[of_node.rows]),
            self.of_nodes(lambda of_node: misclosure[of_node.rows]),
            self.of_nodes(
                lambda of_node: BlockNormals(
                    others.matrices[of_node.blocks], others.right[of_node.block_rows],
                    others.square_sums[of_node.blocks],
                )
            ),
        )  # fmt: skip
        matrices, right, square_sums = (array.copy() for array in others)
        for of_node, found in zip(self.members, self.passes.gathered(handles), strict=True):
            matrices[of_node.blocks] = found.matrices
            right[of_node.block_rows] = found.right
            square_sums[of_node.blocks] = found.square_sums
        return BlockNormals(matrices, right, square_sums)

    def right_side(
        self, state: BlockState, root_weights: FloatArray, misclosure: FloatArray, others: FloatArray, layout: Layout
    ) -> FloatArray:
        """Return the right-hand side (m + 3 b,), with nothing eliminated."""
        handles = self.passes.each(
            node_tasks.right_side, self.sources, self._state(state),
            self.of_nodes(lambda of_node: root_weights[of_node.rows]),
            self.of_nodes(lambda of_node: misclosure[of_node.rows]),
        )  # fmt: skip
        right = others.copy()
        for node, of_node, found in zip(self.tree.nodes, self.members, self.passes.gathered(handles), strict=True):
            columns = np.concatenate([node.front, layout.reduced + of_node.block_rows])
            right[columns] += found
        return right

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
        """Return the normal equations of photo points and `others`, points eliminated, by the fronts of the tree."""
        matrices, right, diagonal = self._contributions(others)
        fixed = layout.fixed[layout.reduced :].reshape(-1, 3)

        def given(number: int) -> NodeEquations:
            of_node, matrix = self.members[number], matrices[number]
            blocks, right = others.blocks[of_node.blocks], others.block_right[of_node.block_rows]
            return NodeEquations(
                weights[of_node.rows],
                residual[of_node.rows],
                Contributions(matrix, np.zeros(matrix.shape[0]), blocks, right),
                fixed[of_node.blocks],
            )

        accuracy = [Accuracy(max_lost_digits, damping)] * len(self.tree)
        normals = self.passes.each(
            node_tasks.eliminate, self.sources, self._state(state), OfNodes(len(self.tree), given), accuracy
        )
        parts = self.passes.each(node_tasks.matrix_of, normals)
        couplings = self.passes.each(node_tasks.coupling_of, normals)
        points: Iterator[NodePoints] = self.passes.gathered(self.passes.each(node_tasks.points_of, normals))
        b = layout.blocks
        factors = BlockFactors(np.empty((b, 3, 3)), np.empty((b, 3)), np.empty((b, 3), dtype=bool))
        block_right = np.empty(3 * b)
        for node, of_node, found in zip(self.tree.nodes, self.members, points, strict=True):
            right[node.front] += found.right
            diagonal[node.front] += found.diagonal
            factors.half[of_node.blocks] = found.half
            factors.pivots[of_node.blocks] = found.pivots
            factors.removed[of_node.blocks] = found.removed
            block_right[of_node.block_rows] = found.block_right
        factors = BlockFactors(set_aside(factors.half), set_aside(factors.pivots), set_aside(factors.removed))
        factor = set_aside(np.sqrt(weights) / self.points.rows.error)
        coupling = DissectedCoupling(self, couplings, state, factor, factors.half)
        matrix = dissected_matrix(self.tree, self.passes, parts)
        return EliminatedNormals(matrix, right, diagonal, factors, coupling, block_right)

    def precision(self, coupling: Coupling, inverse: Symmetric, amounts: Amounts | None) -> BlockPrecision:
        """Return cofactors (b, 3, 3) of the points and leverages (2 n,), zero where `eliminated` is not."""
        assert isinstance(coupling, DissectedCoupling), "the normal equations are those of this loop"
        assert isinstance(inverse, DissectedMatrix), "and so is their inverse"

        def amounts_of(number: int) -> Amounts | None:
            return amounts and amounts.of(self.tree.nodes[number].front, self.members[number].blocks)

        handles = self.passes.each(
            node_tasks.precision, self.sources, coupling.parts, inverse.parts,
            *(inverse.of_fronts(array) for array in (inverse.factors, inverse.left, inverse.right)),
            OfNodes(len(self.tree), amounts_of),
        )  # fmt: skip
        blocks, leverage = np.empty_like(coupling.half), np.zeros(self.points.xy.size)
        for of_node, found in zip(self.members, self.passes.gathered(handles), strict=True):
            blocks[of_node.blocks], leverage[of_node.rows] = found.blocks, found.leverage
        return BlockPrecision(set_aside(blocks), leverage)

    def _contributions(self, others: Contributions) -> tuple[list[csr_array], FloatArray, FloatArray]:
        """Return the matrix of other observations by nodes, their right-hand side, and a diagonal of zeros.

        Each element goes to the node that eliminates the first of its two unknowns.
        """
        elements = others.matrix.tocoo()
        node = np.minimum(self.tree.node_of[elements.row], self.tree.node_of[elements.col])
        order = np.argsort(node, kind="stable")
        ends = np.searchsorted(node[order], np.arange(len(self.tree) + 1))
        matrices = []
        for number, of_node in enumerate(self.tree.nodes):
            mine = order[ends[number] : ends[number + 1]]
            row, column = (self.tree.in_front(number, places[mine]) for places in (elements.row, elements.col))
            shape = (len(of_node.front),) * 2
            matrices.append(csr_array((elements.data[mine], (row, column)), shape=shape))
        return matrices, others.right.copy(), np.zeros(len(others.right))

    def _state(self, state: BlockState) -> Handles:
        """Return handles of the parts of a state; those of the last one are kept where they were sent to."""
        if self.sent.state is not state:
            self.sent.parts = self.passes.kept(self.of_nodes(lambda of_node: of_node.state(state)))
            self.sent.state = state
        return self.sent.parts

    def of_nodes(self, value: Callable[[Members], Any]) -> OfNodes:
        """Return a value for each node, from its members."""
        return OfNodes(len(self.members), lambda number: value(self.members[number]))


class OfNodes(Sequence[Any]):
    """Values of all nodes, each made when it is asked for: all at once would be as long as the block."""

    def __init__(self, count: int, value: Callable[[int], Any]) -> None:
        self._count, self._value = count, value

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, number: Any) -> Any:
        if not 0 <= number < self._count:
            raise IndexError(number)
        return self._value(number)


class DissectedCoupling(Struct, frozen=True):
    """H N_pr of the eliminated points, computed by the nodes.

    Parameters
    ----------
    parts : handles of NodeCoupling
    factor : array (2 n,)
        Roots of the weight factors over the a-priori errors.
    half : array (b, 3, 3)
    """

    loop: DissectedLoop
    parts: Handles
    state: BlockState
    factor: FloatArray
    half: FloatArray

    def times(self, reduced: FloatArray) -> FloatArray:
        """Return H N_pr times vectors (m,) or (m, k)."""
        loop = self.loop
        handles = loop.passes.each(
            node_tasks.backward, loop.sources, self.parts, [reduced[node.front] for node in loop.tree.nodes]
        )
        found = np.zeros((3 * len(self.half), *reduced.shape[1:]))
        for of_node, values in zip(loop.members, loop.passes.gathered(handles), strict=True):
            found[of_node.block_rows] = values
        return found

    def transposed_times(self, points: FloatArray) -> FloatArray:
        """Return its transpose times vectors (3 b,) or (3 b, k)."""
        loop = self.loop
        handles = loop.passes.each(
            node_tasks.forward, loop.sources, self.parts, loop.of_nodes(lambda of_node: points[of_node.block_rows])
        )
        found = np.zeros((len(loop.tree.place), *points.shape[1:]))
        for node, values in zip(loop.tree.nodes, loop.passes.gathered(handles), strict=True):
            found[node.front] += values
        return found

    def movement_sums(self, points: PointMovements) -> MovementSums:
        """Return what the points contribute to the amounts of movements."""
        loop, d = self.loop, points.coefficients.shape[1]
        handles = loop.passes.each(
            node_tasks.movement_sums, loop.sources, self.parts,
            loop.of_nodes(lambda of_node: points.of(of_node.blocks)),
        )  # fmt: skip
        found = MovementSums(np.zeros((len(loop.tree.place), d)), np.zeros((d, d)))
        for node, sums in zip(loop.tree.nodes, loop.passes.gathered(handles), strict=True):
            found.reduced[node.front] += sums.reduced
            found.own[:] += sums.own
        return found

    def of_blocks(self, chosen: IntArray) -> csr_array:
        """Return the rows (3 c, m) of some blocks (c,), which are in ascending order; they are computed here."""
        loop = self.loop
        return rows_of_blocks(loop.points, loop.block, self.state, self.factor, self.half, len(loop.tree.place), chosen)


LARGEST_PART = 60
"""Photos up to which a part of a block is not divided. Larger parts take more memory, smaller ones more messages."""


class Spread(NamedTuple):
    """What passes over the nodes of a tree, and from where these get their sub-blocks."""

    passes: Passes
    sources: Sequence[SubBlockSource]


def in_this_process(tree: DissectionTree, sub_blocks: Iterable[SubBlock]) -> Spread:
    """Return sub-blocks that are kept in memory, one computed after the other."""
    return Spread(InTurn(tree), [HeldSubBlock(sub_block) for sub_block in sub_blocks])


def pose_divided(
    block: Block,
    spread: Callable[[DissectionTree, Iterable[SubBlock]], Spread] = in_this_process,
    largest: int = LARGEST_PART,
) -> BlockProblem:
    """Return the problem of a block, divided by nested dissection.

    Parameters
    ----------
    spread : callable
        Returns where the nodes are computed; sub-blocks are made as it takes them, one after the other.
    largest : int
        Photos up to which a part is not divided.

    Raises
    ------
    NotSolvableError
        If the block has rigs, or an observation couples unknowns in a way that no front has.
    """
    whole = posed(block)
    problem, unknowns = whole.problem, whole.problem.unknowns
    if unknowns.rigs is not None:
        message = "a block with rigs is not divided: adjust it as a whole, without Dask"
        raise NotSolvableError(message)
    if whole.couples_points:
        message = "an observation connects an eliminated point with other unknowns: this block cannot be divided"
        raise NotSolvableError(message)
    of_point = blocks_of_points(unknowns)
    rays = set_aside(of_point[whole.photo_points.point])
    touching, touched = _touched(whole.photo_points, rays, unknowns)
    groups, pattern, central = touched_groups(
        unknowns, whole.others.columns(), touching, touched, unknowns.layout.blocks
    )
    tree = dissected(groups, pattern, central, _positions(block, unknowns, groups, pattern.shape[1]), largest)
    nodes = lowest_nodes(tree, groups, pattern)[: unknowns.layout.blocks]
    del touching, touched, pattern
    members: list[Members] = []

    def sub_blocks() -> Iterator[SubBlock]:
        for sub_block, of_node in divided(whole.photo_points, unknowns, block.point_start, tree, nodes):
            members.append(of_node)
            yield sub_block

    passes, sources = spread(tree, sub_blocks())
    loop = DissectedLoop(whole.photo_points, rays, tree, passes, sources, members)
    problem = replace(problem, streamed=(loop, whole.others))
    return freed(problem, block) if block.is_free_network else problem


def _touched(observed: PhotoPointObservations, rays: IntArray, unknowns: Unknowns) -> tuple[IntArray, IntArray]:
    """Return pairs of an eliminated point and an unknown: one of each group of a photo, or camera, that shows it."""
    is_eliminated = rays >= 0
    groups = groups_of_unknowns(unknowns)
    first = np.append(np.searchsorted(groups, groups), CONSTANT)
    cameras = np.hstack([unknowns.cameras, unknowns.additional])
    found = []
    for number, table in ((observed.photo, unknowns.photos), (observed.camera, cameras)):
        of_groups = np.sort(first[table], axis=1)
        of_groups[:, 1:][of_groups[:, 1:] == of_groups[:, :-1]] = CONSTANT
        pairs = np.unique(rays[is_eliminated] * len(table) + number[is_eliminated])
        point, row = np.divmod(pairs, len(table))
        at, place = np.nonzero(of_groups[row] != CONSTANT)
        found.append((point[at], of_groups[row[at], place]))
    points, columns = zip(*found, strict=True)
    return np.concatenate(points), np.concatenate(columns)


def _positions(block: Block, unknowns: Unknowns, groups: IntArray, count: int) -> FloatArray:
    """Return where the photos and tied points are, by groups of unknowns (g, 3); NaN for others."""
    found = np.full((count, 3), np.nan)
    for columns, places in ((unknowns.photos, block.photo_orientation[:, :3]), (unknowns.points, block.point_start)):
        first = np.where(columns == CONSTANT, len(groups), columns).min(axis=1)
        is_reduced = first < len(groups)
        found[groups[first[is_reduced]]] = places[is_reduced]
    return found
