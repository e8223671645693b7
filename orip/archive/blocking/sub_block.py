"""A sub-block: photo points of a node of the dissection, and what is computed of it, by whoever has it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
from msgspec import Struct

from orip.adjustment.equations import BlockNormals, BlockPrecision, Layout
from orip.adjustment.factorisation.dissection import DissectionTree
from orip.adjustment.factorisation.fronts import adjusted_front, triangle_of
from orip.adjustment.factorisation.null_space import Amounts, MovementSums, PointMovements
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.compiled.loop_pattern import blocks_of_points
from orip.bundle.compiled.photo_loop import Contributions, PhotoPointLoop, StreamedCoupling, photo_loop
from orip.bundle.kinds.observation import Rows
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.state import NO_FIGURES, BlockState
from orip.bundle.unknowns import CONSTANT, UnknownNames, Unknowns
from orip.records.camera import AdditionalSet
from orip.records.figures import FIGURE_PARAMETERS
from orip.records.observation_kinds import PHOTO_POINT
from orip.set_aside import set_aside


class SubBlock(NamedTuple):
    """n photo points of p photos, q points and c cameras; photos, points and cameras have numbers of their own.

    Attributes
    ----------
    photo, point, camera : arrays (n,) of int
    xy, error : arrays (n, 2)
        Measured photo coordinates and their a-priori errors, mm.
    at_measured, is_equidistant : arrays (n,) of bool
        See `PhotoPointObservations`.
    camera_columns : array (c, 13) of int
        Places of the unknowns in the front of the node, `CONSTANT` where there is none.
    additional_columns : array (c, k) of int
    photo_columns, motion_columns : arrays (p, 6) of int
    point_columns : array (q, 3) of int
        After the front, three for each point.
    coordinates : array (q, 3)
        Of the points, roughly.
    front : int
        Number of unknowns in the front.
    sets : tuple of (camera, set, base)
        Cameras with additional parameters.
    readout_a_mm : array (number of cameras, 2) or None
        See `PhotoPointObservations`.
    """

    photo: IntArray
    point: IntArray
    camera: IntArray
    xy: FloatArray
    error: FloatArray
    at_measured: BoolArray
    is_equidistant: BoolArray
    camera_columns: IntArray
    additional_columns: IntArray
    photo_columns: IntArray
    motion_columns: IntArray
    point_columns: IntArray
    coordinates: FloatArray
    front: int
    sets: tuple[tuple[int, AdditionalSet, float], ...]
    readout_a_mm: FloatArray | None = None


class SubBlockSource(Protocol):
    """Where a sub-block comes from: it may have to be read first."""

    def loop(self) -> PhotoPointLoop:
        """Return the compiled loop over its photo points."""


class HeldSubBlock(Struct):
    """A sub-block in memory."""

    sub_block: SubBlock
    made: PhotoPointLoop | None = None

    def loop(self) -> PhotoPointLoop:
        """Return the compiled loop over its photo points."""
        if self.made is None:
            self.made = loop_of(self.sub_block)
        return self.made


class Members(Struct, frozen=True):
    """What a sub-block consists of, in the numbers of the whole block.

    Parameters
    ----------
    rays : array (n,) of int
        Photo points.
    photos, cameras, points : arrays (p,), (c,), (q,) of int
    blocks : array (q,) of int
        The eliminated point, by its number among these, of each point of the sub-block by its number there.
    """

    rays: IntArray
    photos: IntArray
    cameras: IntArray
    points: IntArray
    blocks: IntArray

    @property
    def rows(self) -> IntArray:
        """Return the equations (2 n,) of its photo points."""
        return np.asarray((2 * self.rays[:, None] + np.arange(2)).ravel())

    @property
    def block_rows(self) -> IntArray:
        """Return the places (3 q,) of the coordinates of its eliminated points."""
        return np.asarray((3 * self.blocks[:, None] + np.arange(3)).ravel())

    def state(self, state: BlockState) -> BlockState:
        """Return the values of the sub-block."""
        nothing = np.zeros((0, 3))
        return BlockState(
            cameras=state.cameras[self.cameras],
            additional=state.additional[self.cameras],
            centres=state.centres[self.photos],
            rotations=state.rotations[self.photos],
            motions=state.motions[self.photos],
            motion_corrections=state.motion_corrections[self.photos],
            readouts=state.readouts[self.photos],
            points=state.points[self.points],
            antennas=nothing,
            shifts=nothing,
            drifts=nothing,
            theodolites=np.zeros(0),
            figures=NO_FIGURES,
            turned_by_angles=state.turned_by_angles[self.photos],
            left_out=state.left_out[self.points],
        )


def divided(
    observed: PhotoPointObservations, unknowns: Unknowns, coordinates: FloatArray, tree: DissectionTree, nodes: IntArray
) -> Iterator[tuple[SubBlock, Members]]:
    """Yield the sub-blocks of all nodes of a tree.

    Parameters
    ----------
    observed : PhotoPointObservations
        Of the whole block.
    coordinates : array (number of points, 3)
    nodes : array (b,) of int
        The node of each eliminated point.
    """
    of_point = blocks_of_points(unknowns)
    node_of_ray = np.where(of_point >= 0, nodes[of_point], -1)[observed.point]
    ends = np.cumsum(np.bincount(1 + node_of_ray, minlength=1 + len(tree)))
    by_node = set_aside(np.argsort(node_of_ray, kind="stable"))
    del node_of_ray
    node_of_point = np.where(of_point >= 0, nodes[of_point], -1)
    points_by_node = np.argsort(node_of_point, kind="stable")
    point_ends = np.searchsorted(node_of_point[points_by_node], np.arange(len(tree) + 1))
    for number in range(len(tree)):
        rays = by_node[ends[number] : ends[number + 1]]
        points = points_by_node[point_ends[number] : point_ends[number + 1]]
        yield _sub_block(observed, unknowns, coordinates, tree, number, rays, points, of_point)


def _sub_block(
    observed: PhotoPointObservations,
    unknowns: Unknowns,
    coordinates: FloatArray,
    tree: DissectionTree,
    number: int,
    rays: IntArray,
    points: IntArray,
    of_point: IntArray,
) -> tuple[SubBlock, Members]:
    photos, photo = np.unique(observed.photo[rays], return_inverse=True)
    cameras, camera = np.unique(observed.camera[rays], return_inverse=True)
    front = len(tree.nodes[number].front)

    def in_front(table: IntArray) -> IntArray:
        places = np.full(table.shape, CONSTANT)
        unknown = table != CONSTANT
        places[unknown] = tree.in_front(number, table[unknown])
        return places

    own_columns = front + np.arange(3 * len(points)).reshape(-1, 3)
    point_columns = np.where(unknowns.points[points] == CONSTANT, CONSTANT, own_columns)
    found = SubBlock(
        photo,
        np.searchsorted(points, observed.point[rays]),
        camera,
        observed.xy[rays],
        observed.rows.error.reshape(-1, 2)[rays],
        observed.at_measured[rays],
        observed.is_equidistant[rays],
        in_front(unknowns.cameras[cameras]),
        in_front(unknowns.additional[cameras]),
        in_front(unknowns.photos[photos]),
        in_front(unknowns.motions[photos]),
        point_columns,
        coordinates[points],
        front,
        tuple((cameras.tolist().index(row), name, base) for row, name, base in observed.sets if row in cameras),
        None if observed.readout_a_mm is None else observed.readout_a_mm[cameras],
    )
    blocks = np.empty(len(points), dtype=np.int64)
    blocks[blocks_of_points(_unknowns(found))] = of_point[points]
    return found, Members(rays, photos, cameras, points, blocks)


def loop_of(sub_block: SubBlock) -> PhotoPointLoop:
    """Return the compiled loop over the photo points of a sub-block."""
    unknowns = _unknowns(sub_block)
    rows = Rows(PHOTO_POINT, (), (), (), sub_block.xy.ravel(), sub_block.error.ravel(), np.zeros(0, dtype=bool), None)
    observed = PhotoPointObservations(
        rows, sub_block.photo, sub_block.point, sub_block.camera, sub_block.xy, sub_block.at_measured,
        sub_block.is_equidistant, sub_block.sets, unknowns, sub_block.readout_a_mm,
    )  # fmt: skip
    return photo_loop(observed, unknowns, sub_block.coordinates)


def layout_of(sub_block: SubBlock, fixed: BoolArray) -> Layout:
    """Return the layout of a sub-block's unknowns; `fixed` (q, 3) are coordinates that are none."""
    return Layout(sub_block.front, len(fixed), np.concatenate([np.zeros(sub_block.front, dtype=bool), fixed.ravel()]))


def _unknowns(sub_block: SubBlock) -> Unknowns:
    count = len(sub_block.coordinates)
    nothing = np.zeros((0, 3), dtype=np.int64)
    fixed = sub_block.point_columns == CONSTANT
    return Unknowns(
        cameras=sub_block.camera_columns,
        additional=sub_block.additional_columns,
        antennas=nothing,
        shifts=nothing,
        drifts=nothing,
        theodolites=np.zeros(0, dtype=np.int64),
        figures=np.zeros((0, len(FIGURE_PARAMETERS)), dtype=np.int64),
        photos=sub_block.photo_columns,
        motions=sub_block.motion_columns,
        points=sub_block.point_columns,
        layout=layout_of(sub_block, fixed),
        names=UnknownNames((), (), np.arange(count), fixed.ravel()),
    )


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


def right_side(
    source: SubBlockSource, state: BlockState, root_weights: FloatArray, misclosure: FloatArray
) -> FloatArray:
    """Return the right-hand side (f + 3 q,), with nothing eliminated."""
    loop = source.loop()
    layout = loop.points.unknowns.layout
    return loop.right_side(state, root_weights, misclosure, np.zeros(layout.size), layout)


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
