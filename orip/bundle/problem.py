"""A block as an adjustment problem: all kinds of observation with one order of the unknowns."""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.equations import Equations, Layout, OtherPlace
from orip.adjustment.factorisation.band import arranged
from orip.adjustment.factorisation.elimination import BlockFactors
from orip.adjustment.factorisation.null_space import InnerConstraints
from orip.adjustment.sparse_rows import SparseRows
from orip.adjustment.weights import danish_costs, greatest_danish_cost
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.compiled.loop_pattern import blocks_of_points
from orip.bundle.compiled.photo_loop import PhotoPointLoop, is_compiled, photo_loop
from orip.bundle.compiled.rig_loop import RigLoop, rig_loop
from orip.bundle.compiled.streamed_rows import PointLoop, StreamedRows, touched_groups
from orip.bundle.datum.free_datum import FreeDatum, free_datum
from orip.bundle.kinds.all_kinds import KINDS, require_enough_digits
from orip.bundle.kinds.observation import Observations, partials_by_unknowns
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.known_motions import KnownMotions, motions_of_rolling_shutters
from orip.bundle.points.consensus import (
    Moves,
    come_near,
    moves_of_points,
    placed,
    points_by_photos_alone,
    where_better,
    with_consensus,
    with_intersected_points,
    with_points_moved,
    with_steady_weights,
)
from orip.bundle.points.left_out import (
    LEAST_WEIGHT_OF_FIT,
    improved_points,
    without_contradicting_pairs,
    without_contradictory_points,
    without_undetermined_points,
)
from orip.bundle.points.on_figures import with_points_on_figures
from orip.bundle.points.other_places import other_places
from orip.bundle.points.rival_places import control_rows, rival_places
from orip.bundle.rigs.starting import columns_by_rigs
from orip.bundle.starting_state import starting_state
from orip.bundle.state import BlockState, entries_at, moving, rotation_limit
from orip.bundle.unknowns import CONSTANT, Unknowns, number_unknowns
from orip.records.block import Block
from orip.set_aside import ColumnByParts, set_aside
from orip.structs import replace


class BlockProblem(Struct, frozen=True):
    """The observation equations of a block.

    Parameters
    ----------
    observations : tuple of Observations
        One of each kind, in the order of their rows.
    datum : FreeDatum or None
        That of a free network; None: control, or whatever else leaves no movement free.
    excluded : array (n,) of bool or None
        Observations left out as blunders: their residuals are computed, but have no influence.
    streamed : tuple (loop, others) or None
        What passes over the photo points, and the problem of all other rows; None: the design matrix is stored.
    """

    block: Block
    unknowns: Unknowns
    observations: tuple[Observations, ...]
    datum: FreeDatum | None = None
    excluded: NDArray[np.bool_] | None = None
    streamed: tuple[PointLoop, BlockProblem] | None = None
    known_motions: KnownMotions = KnownMotions()

    @property
    def layout(self) -> Layout:
        """Return the order of the unknowns."""
        return self.unknowns.layout

    @property
    def defect(self) -> int:
        """Return the datum defect: the number of free movements of the whole block."""
        return 0 if self.datum is None else len(self.datum.held)

    def inner_constraints(self, state: BlockState) -> InnerConstraints | None:
        """Return the inner constraints of a free network at a state; None: nothing is free to move."""
        return None if self.datum is None else self.datum.inner_constraints(state, self.unknowns)

    def columns(self) -> list[IntArray | NDArray[np.int32]]:
        """Return the unknowns that each equation touches, kind by kind."""
        return [columns_by_rigs(np.asarray(kind.columns()), self.unknowns.rigs) for kind in self.observations]

    def as_observed(self, residual: FloatArray) -> FloatArray:
        """Convert equation residuals to residuals (n,) of the observations, in observed units."""
        found, first = residual.copy(), 0
        converted: dict[str, FloatArray] = {}
        for kind in self.observations:
            part = slice(first, first + len(kind.rows.error))
            found[part] = kind.as_observed(residual[part], converted)
            converted[kind.rows.kind.name] = found[part]
            first = part.stop
        return found

    def linearise(self, state: BlockState) -> Equations:
        """Return all observation equations at a state, divided by their a-priori errors."""
        found = self._stored(state) if self.streamed is None else self._streamed(state, *self.streamed)
        found = replace(found, groups=self._groups(), wider_groups=self._wider_groups)
        idle = self.excluded
        if state.left_out.any():
            of_points = self._rows_of_points(state.left_out)
            idle = of_points if idle is None else idle | of_points
        return found if idle is None else replace(found, active=found.active & ~idle)

    def _groups(self) -> IntArray | None:
        """Return the groups (n,) of observations that lose weight together; None if there are none."""
        of_kinds = [kind.groups() if len(kind.rows.error) else None for kind in self.observations]
        if all(groups is None for groups in of_kinds):
            return None
        found, first = [], 0
        for kind, groups in zip(self.observations, of_kinds, strict=True):
            found.append(
                np.full(len(kind.rows.error), -1) if groups is None else np.where(groups < 0, -1, first + groups)
            )
            first += 0 if groups is None else int(groups.max()) + 1
        return np.concatenate(found)

    def _wider_groups(self) -> IntArray:
        """Return the groups (n,) with the two coordinates of each photo point as one more group."""
        size, groups = sum(len(kind.rows.error) for kind in self.observations), self._groups()
        wider = np.full(size, -1) if groups is None else groups.copy()
        first, number = 0, int(wider.max(initial=-1)) + 1
        for kind in self.observations:
            if isinstance(kind, PhotoPointObservations):
                wider[first : first + 2 * len(kind.point)] = number + np.arange(2 * len(kind.point)) // 2
            first += len(kind.rows.error)
        return wider

    def _rows_of_points(self, points: BoolArray) -> BoolArray:
        """Return which equations (n,) are photo points of some points (number of points,)."""
        of_kinds = [
            np.repeat(points[kind.point], 2)
            if isinstance(kind, PhotoPointObservations)
            else np.zeros(len(kind.rows.photo), dtype=bool)
            for kind in self.observations
        ]
        return np.concatenate([np.zeros(0, dtype=bool), *of_kinds])

    def design(self, state: BlockState) -> csr_array:
        """Return the whole design matrix (n, m + 3 b) at a state."""
        return self._stored(state).design

    def _stored(self, state: BlockState) -> Equations:
        # a block has millions of rows, with dozens of partials each
        data, residual = ColumnByParts(np.dtype(np.float64)), ColumnByParts(np.dtype(np.float64))
        indices, counts = ColumnByParts(np.dtype(np.int32)), ColumnByParts(np.dtype(np.int32))
        active, exact = ColumnByParts(np.dtype(np.bool_)), ColumnByParts(np.dtype(np.bool_))
        measured = [kind for kind in self.observations if len(kind.rows.error)]
        for observations in chain.from_iterable(kind.in_parts() for kind in measured):
            values, (partials, columns) = partials_by_unknowns(observations, state, self.unknowns)
            error, keep = observations.rows.error, columns != CONSTANT
            data.append((partials / error[:, None])[keep])
            indices.append(columns[keep])
            counts.append(keep.sum(axis=1))
            residual.append((values.residual + state.memory.get(observations.rows.kind.name, 0.0)) / error)
            exact.append(np.full(len(error), observations.exact))
            active.append(observations.rows.used & values.computable)
        indptr = np.append(0, np.cumsum(counts.whole(), dtype=np.int64))
        design = csr_array((data.whole(), indices.whole(), indptr), shape=(len(indptr) - 1, self.layout.size))
        return Equations(SparseRows(design), residual.whole(), active.whole(), exact.whole())

    def _streamed(self, state: BlockState, loop: PointLoop, others: BlockProblem) -> Equations:
        rest = others.linearise(state)
        staying = loop.staying()
        stay, photos = len(staying), loop.points.xy.size
        residual, active = loop.residuals(state, len(rest.residual) - stay)
        residual[photos:], active[photos:] = rest.residual[stay:], rest.active[stay:]
        active[:photos] &= loop.points.rows.used
        exact = np.zeros(len(residual), dtype=bool)
        exact[photos:] = rest.exact[stay:]
        rows = np.concatenate([staying, np.arange(photos, len(residual))])
        stored = StreamedRows(loop, state, SparseRows(rest.design), rows, self.design)
        return Equations(stored, set_aside(residual), set_aside(active), set_aside(exact))

    def update(self, state: BlockState, correction: FloatArray) -> BlockState:
        """Return the state after a correction."""
        if self.datum is not None:
            correction = self.datum.transformed(correction, state, self.unknowns)
        moved = moving(state.moved(correction, self.unknowns), self.block, self.known_motions)
        memory = {
            kind.rows.kind.name: kept
            for kind in self.observations
            if len(kind.rows.error) and (kept := kind.remembered(moved)) is not None
        }
        return replace(moved, memory=memory)

    def other_places(
        self, state: BlockState, equations: Equations, weights: FloatArray, limit: float
    ) -> list[OtherPlace]:
        """Return other places of points that a ray contradicts."""
        return other_places(self.block, self.unknowns, self._photo_points(), state, equations, weights, limit)

    def rival_places(
        self, state: BlockState, equations: Equations, weights: FloatArray, limit: float
    ) -> list[OtherPlace]:
        """Return places of points where as many of their rays meet, nearly, as where they are."""
        kind, control = self._photo_points(), control_rows(self.observations)
        return rival_places(self.block, self.unknowns, kind, control, state, equations, weights, limit)

    def _photo_points(self) -> PhotoPointObservations:
        """Return the photo points, whose equations are the first ones."""
        return next(kind for kind in self.observations if isinstance(kind, PhotoPointObservations))

    def improve_consensus(self, state: BlockState, equations: Equations, limit: float) -> BlockState | None:
        """Return the state with points moved to where more of their rays fit; None if there are none."""
        moved = state.moved(self._moves(state, equations, limit, where_better), self.unknowns)
        all_in = self.with_all_blocks(moved)
        return improved_points(self.block, self.unknowns, state, all_in, lambda at: self._points_that_fit(at, limit))

    def moves_to_steady_weights(self, state: BlockState, equations: Equations, limit: float) -> FloatArray:
        """Return corrections (m + 3 b,) of points that do not fit, after which their weights no longer change.

        Only of points that nothing but photos observes, that do not come near to a photo by that, and whose robust cost
        falls.
        """
        correction = self._moves(state, equations, limit, with_steady_weights)
        if not correction.any():
            return correction
        moved = state.moved(correction, self.unknowns)
        better = self._costs_of_points(self.linearise(moved), limit) < self._costs_of_points(equations, limit)
        better &= points_by_photos_alone(self.block, self.unknowns) & ~come_near(state, moved, self.block.photo_points)
        places = self.unknowns.points[~better]
        correction[places[places != CONSTANT]] = 0.0
        return correction

    def _costs_of_points(self, equations: Equations, limit: float) -> FloatArray:
        """Return the robust cost (number of points,) of the rays of each point; most, where one is not computable."""
        kind = self._photo_points()
        rows = slice(2 * len(kind.point))
        squares = np.where(equations.active[rows], equations.residual[rows] ** 2, 0.0).reshape(-1, 2).sum(axis=1)
        lost = kind.rows.used[::2] & ~equations.active[rows].reshape(-1, 2).any(axis=1)
        parts = np.where(lost, greatest_danish_cost(limit), danish_costs(np.sqrt(squares), limit))
        return np.asarray(np.bincount(kind.point, parts, len(self.unknowns.points)), dtype=np.float64)

    def _moves(self, state: BlockState, equations: Equations, limit: float, moves: Moves) -> FloatArray:
        """Return corrections of all unknowns (m + 3 b,) that move points which do not fit."""
        return moves_of_points(self._photo_points(), self.unknowns, equations, state, limit, moves)

    def with_all_blocks(self, state: BlockState) -> BlockState:
        """Return the state with the points that were left out, where their rays meet; itself if none are."""
        if not state.left_out.any():
            return state
        points = np.where(state.left_out[:, None], self.with_blocks_recomputed(state).points, state.points)
        everywhere = replace(state, points=points, left_out=np.zeros_like(state.left_out))
        return with_consensus(self.block, everywhere, state.left_out)

    def with_doubtful_blocks_placed(self, state: BlockState, equations: Equations, limit: float) -> BlockState:
        """Return the state with points that do not fit moved to where most of their rays agree, wherever they were.

        Points whose two rays contradict each other are left out.
        """
        moved = state.moved(self._moves(state, equations, limit, placed), self.unknowns)
        return without_contradicting_pairs(self.block, moved, self.unknowns, self._points_that_fit(moved, limit))

    def _points_that_fit(self, state: BlockState, limit: float) -> BoolArray:
        """Return the points (number of points,) that lie in front of all their photos, with residuals up to a limit."""
        fits, equations, kind = np.ones(len(state.points), dtype=bool), self.linearise(state), self._photo_points()
        rows = slice(2 * len(kind.point))
        wrong = kind.rows.used & ~(equations.active[rows] & (np.abs(equations.residual[rows]) <= limit))
        fits[kind.point[wrong.reshape(-1, 2).any(axis=1)]] = False
        return fits

    def without_undetermined_blocks(self, state: BlockState, factors: BlockFactors, scale: float) -> BlockState | None:
        """Return the state without points that have no angle of intersection; None if there are none."""
        return without_undetermined_points(self.block, state, self.unknowns, factors, scale)

    def without_contradictory_blocks(
        self, state: BlockState, factors: BlockFactors, scale: float, weights: FloatArray
    ) -> BlockState | None:
        """Return the state without points that the rays that fit do not determine; None if there are none."""
        kind = self._photo_points()
        weight = weights[: 2 * len(kind.point)].reshape(-1, 2).min(axis=1)
        fitting = np.bincount(kind.point[weight >= LEAST_WEIGHT_OF_FIT], minlength=len(state.points))
        return without_contradictory_points(self.block, state, self.unknowns, factors, scale, fitting)

    def with_blocks_recomputed(self, state: BlockState) -> BlockState:
        """Return the state with its points intersected from the rays of the photos."""
        return with_intersected_points(self.block, state, self.unknowns)

    def with_blocks_moved(self, state: BlockState, correction: FloatArray) -> BlockState:
        """Return the state with its points moved: linearly in direction and inverse distance."""
        rays = self.block.photo_points
        move = entries_at(np.concatenate([np.zeros(self.layout.reduced), correction]), self.unknowns.points)
        return with_points_moved(state, move, state.centres[rays.photo], rays.point)

    def step_factor(self, correction: FloatArray) -> float:
        """Return the factor that keeps the rotation of every photo within the range of the linearisation."""
        return rotation_limit(correction, self.unknowns)


class Posed(NamedTuple):
    """A block's problem with its design matrix stored, and its photo points apart from all other rows.

    `others` are those of tied points and of all other kinds; `couples_points`: one of them touches both an eliminated
    point and a reduced unknown.
    """

    problem: BlockProblem
    photo_points: PhotoPointObservations
    others: BlockProblem
    couples_points: bool


def posed(block: Block) -> Posed:
    """Return the parts of a block's problem; see `require_enough_digits` for what is refused."""
    require_enough_digits(block)
    tied = frozenset[int]().union(*(kind.tied_points(block) for kind in KINDS))
    unknowns = number_unknowns(block, tied)
    observations = tuple(kind.observe(block, unknowns) for kind in KINDS)
    photo_points = next(kind for kind in observations if isinstance(kind, PhotoPointObservations))
    eliminated = blocks_of_points(unknowns)[photo_points.point] >= 0
    rest = tuple(kind for kind in observations if kind is not photo_points and len(kind.rows.error))
    staying = () if eliminated.all() else (photo_points.of(~eliminated),)
    others = BlockProblem(block, unknowns, (*staying, *rest))
    problem = BlockProblem(block, unknowns, observations, known_motions=motions_of_rolling_shutters(block))
    return Posed(problem, photo_points, others, _couples_points(others))


def pose_problem(block: Block) -> BlockProblem:
    """Return the problem of a block."""
    problem, photo_points, others, couples_points = posed(block)
    if not couples_points:
        loop = photo_loop if problem.unknowns.rigs is None else rig_loop
        problem = _arranged(problem, loop(photo_points, problem.unknowns, block.point_start), others)
    return freed(problem, block) if block.is_free_network else problem


def _arranged(problem: BlockProblem, loop: PhotoPointLoop | RigLoop, others: BlockProblem) -> BlockProblem:
    """Return the problem with its reduced system as a band, where that pays, and streamed, where that is possible."""
    touching, touched = loop.touched()
    count = int(touching.max(initial=-1)) + 1
    groups = touched_groups(problem.unknowns, others.columns(), touching, touched, count)
    layout = replace(problem.layout, arrangement=arranged(*groups))
    loop = loop.arranged_as(layout.arrangement) if isinstance(loop, RigLoop) else loop
    unknowns = replace(problem.unknowns, layout=layout)
    return replace(problem, unknowns=unknowns, streamed=(loop, others) if is_compiled() else None)


def _couples_points(problem: BlockProblem) -> bool:
    """Return whether an observation touches both an eliminated point and a reduced unknown."""
    reduced = problem.layout.reduced
    return any(
        bool(((columns >= reduced).any(axis=1) & ((columns != CONSTANT) & (columns < reduced)).any(axis=1)).any())
        for columns in problem.columns()
    )


def freed(problem: BlockProblem, block: Block) -> BlockProblem:
    """Return the problem of a free network: while solving, as many unknowns are held as it has free movements."""
    others = tuple(kind for kind in problem.observations if not isinstance(kind, PhotoPointObservations))
    state, unknowns = with_points_on_figures(others, starting_state(block)), problem.unknowns
    on_the_ground = replace(problem, observations=others, streamed=None).linearise(state)
    datum = free_datum(block, state, unknowns, on_the_ground, np.ones(len(on_the_ground.residual), dtype=bool))
    if datum is None:
        return problem
    fixed = unknowns.layout.fixed.copy()
    fixed[datum.held] = True
    layout = replace(unknowns.layout, fixed=fixed)
    return replace(problem, unknowns=replace(unknowns, layout=layout), datum=datum)
