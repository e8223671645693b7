"""What is computed of a sub-block, by whoever has it: residuals, normal equations, precision of its points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.adjustment.equations import BlockNormals, BlockPrecision, Layout
from orip.adjustment.factorisation.dissection.matrix import adjusted_front, triangle_of
from orip.adjustment.factorisation.inner_constraints import Amounts, MovementSums, PointMovements
from orip.arrays import BoolArray, FloatArray
from orip.bundle.blocking.sub_block import SubBlockSource
from orip.bundle.compiled.photo_loop import Contributions, StreamedCoupling
from orip.bundle.state import BlockState


class NodeEquations(NamedTuple):
    """What an iteration gives of a sub-block.

    Attributes
    ----------
    weights, residual : arrays (2 n,)
        See `DesignMatrix.eliminated`.
    others : Contributions
        Of observations other than photo points, in the places of the node's front.
    fixed : array (q, 3) of bool
        Coordinates that are no unknowns.
    """

    weights: FloatArray
    residual: FloatArray
    others: Contributions
    fixed: BoolArray


class NodePoints(NamedTuple):
    """The eliminated points of a sub-block, and what their elimination leaves for the vectors of its front (f,)."""

    right: FloatArray
    diagonal: FloatArray
    half: FloatArray
    pivots: FloatArray
    removed: BoolArray
    block_right: FloatArray


class NodeCoupling(NamedTuple):
    """What the coupling of a sub-block's points is computed from; see `StreamedCoupling`."""

    state: BlockState
    factor: FloatArray
    half: FloatArray


class NodeNormals(NamedTuple):
    """Normal equations of a front, a triangle (f (f + 1) / 2,), with the eliminated points and their coupling."""

    matrix: FloatArray
    points: NodePoints
    coupling: NodeCoupling


class Accuracy(NamedTuple):
    """Digits that an unknown may lose, and the damping of the diagonal."""

    max_lost_digits: float
    damping: float


def residuals(source: SubBlockSource, state: BlockState) -> tuple[FloatArray, BoolArray]:
    """Return residuals (2 n,) and which of them can be computed (2 n,)."""
    return source.loop().residuals(state)


def points_alone(
    source: SubBlockSource, state: BlockState, root_weights: FloatArray, misclosure: FloatArray, others: BlockNormals
) -> BlockNormals:
    """Return the normal equations of the points with everything else held."""
    loop = source.loop()
    size = loop.points.unknowns.layout.reduced
    layout = Layout(size, len(others.matrices), np.zeros(size + others.right.size, dtype=bool))
    return loop.block_normals(state, root_weights, misclosure, others, layout)


def eliminate(source: SubBlockSource, state: BlockState, given: NodeEquations, accuracy: Accuracy) -> NodeNormals:
    """Return the normal equations of a sub-block with its points eliminated."""
    loop = source.loop()
    size = loop.points.unknowns.layout.reduced
    fixed = np.concatenate([np.zeros(size, dtype=bool), given.fixed.ravel()])
    # the loop changes what it is given, and a task may be repeated
    others = given.others._replace(blocks=given.others.blocks.copy(), block_right=given.others.block_right.copy())
    found = loop.eliminate(
        state, given.weights, given.residual, others, Layout(size, len(given.fixed), fixed), *accuracy
    )
    assert isinstance(found.matrix, np.ndarray), "the layout has no arrangement"
    assert isinstance(found.coupling, StreamedCoupling), "the loop has no other"
    blocks = found.blocks
    points = NodePoints(found.right, found.diagonal, blocks.half, blocks.pivots, blocks.removed, found.block_right)
    return NodeNormals(triangle_of(found.matrix), points, NodeCoupling(state, found.coupling.factor, blocks.half))


def matrix_of(normals: NodeNormals) -> FloatArray:
    """Return the normal equations."""
    return normals.matrix


def points_of(normals: NodeNormals) -> NodePoints:
    """Return the points."""
    return normals.points


def coupling_of(normals: NodeNormals) -> NodeCoupling:
    """Return the coupling."""
    return normals.coupling


def forward(source: SubBlockSource, coupling: NodeCoupling, points: FloatArray) -> FloatArray:
    """Return (H N_pr)^T points (f, k) for vectors (3 q, k)."""
    return _coupling(source, coupling).transposed_times(points)


def movement_sums(source: SubBlockSource, coupling: NodeCoupling, points: PointMovements) -> MovementSums:
    """Return what the points contribute to the amounts of movements, for the unknowns of the front (f, d)."""
    return _coupling(source, coupling).movement_sums(points)


def backward(source: SubBlockSource, coupling: NodeCoupling, reduced: FloatArray) -> FloatArray:
    """Return H N_pr reduced (3 q, k) for vectors (f, k)."""
    return _coupling(source, coupling).times(reduced)


def precision(
    source: SubBlockSource,
    coupling: NodeCoupling,
    inverse: FloatArray,
    factors: FloatArray,
    left: FloatArray,
    right: FloatArray,
    amounts: Amounts | None,
) -> BlockPrecision:
    """Return cofactors (q, 3, 3) of the points and leverages (2 n,); `factors`... see `adjusted_front`."""
    streamed = _coupling(source, coupling)
    return streamed.loop.precision(streamed, adjusted_front(inverse, factors, left, right), amounts)


def _coupling(source: SubBlockSource, coupling: NodeCoupling) -> StreamedCoupling:
    loop = source.loop()
    return StreamedCoupling(loop, *coupling, loop.points.unknowns.layout.reduced)
