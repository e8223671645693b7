"""A block adjusted once: the iterations and the precision of their result."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from orip.adjustment.convergence import TerminationReason
from orip.adjustment.equations import Equations, Linearised
from orip.adjustment.iteration import Adjustment, adjust
from orip.adjustment.iteration_state import IterationRecord, IterationSettings
from orip.adjustment.precision import Cofactors, VarianceOfUnitWeight, cofactors, variance_of_unit_weight
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.problem import BlockProblem, pose_problem
from orip.bundle.starting_state import starting_state
from orip.bundle.state import BlockState
from orip.bundle.undetermined_unknowns import (
    agrees_with_held,
    loose_calibration,
    undetermined_with_removed,
    with_calibration_held,
    with_undetermined_held,
)
from orip.bundle.unknowns import CONSTANT
from orip.errors import NotSolvableError
from orip.geometry.rotation import rotation_vectors_with_partials
from orip.progress import stage
from orip.records.block import Block
from orip.records.definition import BundleDefinition
from orip.structs import replace
from orip.threads import limited_threads
from orip.units import DEGREES_PER_RADIAN

_CREEPING_STEPS, _NEAR = 10, 2.0
"""Damped steps in a row with corrections below a hundredth of their standard deviations (ENP)."""


class SolvedBlock(Adjustment[BlockState], frozen=True):
    """The adjustment of a block, with the precision of all unknowns.

    Parameters
    ----------
    problem : BlockProblem
    cofactors : Cofactors
    variance : VarianceOfUnitWeight
    undetermined : array (m + 3 b,) of bool
        Unknowns that were removed, and those that move with them.
    """

    problem: BlockProblem
    cofactors: Cofactors
    variance: VarianceOfUnitWeight
    undetermined: BoolArray

    def is_undetermined(self, columns: IntArray) -> BoolArray:
        """Return which of some unknowns, by their columns of any shape, are not determined; constants never."""
        return np.asarray((columns != CONSTANT) & self.undetermined[columns])

    @property
    def block(self) -> Block:
        """Return the block that was adjusted."""
        return self.problem.block

    @property
    def converged(self) -> bool:
        """Return whether the iterations converged."""
        return self.reason is TerminationReason.CONVERGED

    @property
    def deviation_scale(self) -> float:
        """Return the factor from the root of a cofactor to a standard deviation: sigma0, or 1 without redundancy."""
        return self.variance.sigma0 if np.isfinite(self.variance.sigma0) else 1.0

    def ground_design(self, rows: IntArray) -> csr_array:
        """Return rows (k, m + 3 b) of the design matrix, none of photo points, divided by their a-priori errors."""
        others, numbers, first = [], [np.zeros(0, dtype=np.int64)], 0
        for kind in self.problem.observations:
            if not isinstance(kind, PhotoPointObservations):
                others.append(kind)
                numbers.append(first + np.arange(len(kind.rows.error)))
            first += len(kind.rows.error)
        design = BlockProblem(self.block, self.problem.unknowns, tuple(others)).design(self.state)
        return csr_array(design[np.searchsorted(np.concatenate(numbers), rows)])

    def cofactors_of(self, columns: IntArray) -> FloatArray:
        """Return the cofactor matrix (k, k) of unknowns that are all in the reduced system or all of one point."""
        m = self.problem.layout.reduced
        if (columns < m).all():
            return np.asarray(self.cofactors.reduced[np.ix_(columns, columns)])
        place = (columns - m) % 3
        return np.asarray(self.cofactors.blocks[(columns[0] - m) // 3][np.ix_(place, place)])


def without_observations(problem: BlockProblem, excluded: BoolArray) -> BlockProblem:
    """Return a problem without some observations (n,), whose errors then have no part in other equations."""
    ends = np.cumsum([len(kind.rows.error) for kind in problem.observations])
    parts = zip(problem.observations, np.split(excluded, ends[:-1]), strict=True)
    kept = tuple(kind.with_left_out(part) for kind, part in parts)
    streamed = problem.streamed
    if streamed is not None:
        of_kind = {kind.rows.kind.name: kind for kind in kept if kind.correlations()}
        rest = tuple(of_kind.get(kind.rows.kind.name, kind) for kind in streamed[1].observations)
        streamed = (streamed[0], replace(streamed[1], observations=rest))
    return replace(problem, observations=kept, excluded=excluded, streamed=streamed)


def iteration_settings(definition: BundleDefinition) -> IterationSettings:
    """Return the settings of the iterations; no down-weighting where a bundle's is off."""
    return IterationSettings(
        definition.enp_stop,
        definition.max_iterations,
        definition.max_standard_residual,
        definition.start_down_weight if definition.reduces_weights else None,
        definition.max_lost_digits,
        definition.early_weights == "scaled",
    )


def solve_block(
    block: Block,
    on_iteration: Callable[[IterationRecord], None],
    stop_asked: Callable[[], bool],
    settings: IterationSettings | None = None,
    pose: Callable[[Block], BlockProblem] = pose_problem,
) -> SolvedBlock:
    """Adjust a block.

    Parameters
    ----------
    on_iteration : callable
        Called after each iteration.
    stop_asked : callable
        Asked after each iteration; True stops there.
    settings : IterationSettings, optional
        Those of the block's definition by default.
    pose : callable
        Returns the block's problem: as a whole, or divided.

    Raises
    ------
    NotSolvableError
        When there are no unknowns, or the iterations diverged to numbers that are not finite.
    """
    problem = pose(block)
    if not problem.layout.unknowns:
        message = "every camera, photo and point is constant: there is nothing to adjust"
        raise NotSolvableError(message)
    chosen = iteration_settings(block.definition) if settings is None else settings
    return solve_problem(problem, starting_state(block), chosen, on_iteration, stop_asked)


def solve_problem(
    problem: BlockProblem,
    start: BlockState,
    settings: IterationSettings,
    on_iteration: Callable[[IterationRecord], None],
    stop_asked: Callable[[], bool],
) -> SolvedBlock:
    """Adjust a block's problem from any state; see `solve_block`."""
    settings = replace(settings, is_small=stop_criterion(problem))
    with limited_threads(None):
        creeping = _Creeping(on_iteration, stop_asked)
        solved = _solved(problem, start, settings, on_iteration, stop_asked, creeping)
        if creeping.has_stopped and not solved.converged:
            solved = _solved(problem, start, settings, on_iteration, stop_asked)
        return solved


class _Creeping:
    """Stops iterations that follow a curved valley by small damped steps, one after the other.

    A parameter of a camera that hardly anything determines moves so: C of vertical photos over level ground goes to
    four times its value in eighty iterations, and is held at its start in the end. That is looked at sooner.
    """

    def __init__(self, on_iteration: Callable[[IterationRecord], None], stop_asked: Callable[[], bool]) -> None:
        self._told, self._asked = on_iteration, stop_asked
        self._steps = 0
        self.has_stopped = False

    def on_iteration(self, record: IterationRecord) -> None:
        """Take note of an iteration."""
        self._steps = self._steps + 1 if record.step_limited and record.enp >= _NEAR else 0
        self._told(record)

    def stop_asked(self) -> bool:
        """Return whether to stop, as it creeps or somebody asks for it."""
        if self._asked():
            return True
        self.has_stopped = self._steps >= _CREEPING_STEPS
        return self.has_stopped


def _solved(
    problem: BlockProblem,
    start: BlockState,
    settings: IterationSettings,
    on_iteration: Callable[[IterationRecord], None],
    stop_asked: Callable[[], bool],
    creeping: _Creeping | None = None,
) -> SolvedBlock:
    """Adjust, then with what is not determined held at its start, and with parameters of cameras that are loose."""
    with stage("adjusting"):
        first = (on_iteration, stop_asked) if creeping is None else (creeping.on_iteration, creeping.stop_asked)
        adjustment = adjust(problem, start, settings, *first)
        if creeping is not None and creeping.has_stopped:
            adjustment = replace(adjustment, reason=TerminationReason.MAX_ITERATIONS)
        adjustment = with_undetermined_held(problem, start, adjustment, settings, on_iteration, stop_asked)
    solved = _with_precision(problem, adjustment)
    held, tried = np.empty(0, dtype=np.int64), solved
    while len(loose := _loose(problem, tried, held)):
        held = np.append(held, loose)
        with stage("adjusting"):
            again = with_calibration_held(problem, start, solved, held, settings, on_iteration, stop_asked)
        if not np.isfinite(again.iterations[-1].enp):
            break
        tried = _with_precision(problem, again)
        solved = tried if agrees_with_held(tried, solved) else solved
    return solved


def _loose(problem: BlockProblem, solved: SolvedBlock, held: IntArray) -> IntArray:
    """Return the next unknowns of cameras to be held at its start; sigma0 counts only where it is below 1."""
    if solved.reason is TerminationReason.STOPPED:
        return held[:0]
    variances = min(solved.deviation_scale, 1.0) ** 2 * solved.cofactors.reduced.diagonal()
    return loose_calibration(problem, solved, variances, held)


def _with_precision(problem: BlockProblem, found: Adjustment[BlockState]) -> SolvedBlock:
    """Return the adjusted block with the precision of all unknowns."""
    equations, normals = found.equations, found.normals.with_constraints(found.equations)
    if not np.isfinite(found.iterations[-1].enp) or not np.isfinite(equations.residual).all():
        message = (
            "the adjustment diverged to numbers that are not finite; check the preliminary values, the control and "
            "the a-priori errors"
        )
        raise NotSolvableError(message)
    with stage("precision"):
        precision = cofactors(equations, normals, problem.inner_constraints(found.state))
        undetermined = undetermined_with_removed(problem, equations, found.weight_factors, normals, precision)
    effective = problem.layout.unknowns - int(np.count_nonzero(normals.removed))
    variance = variance_of_unit_weight(equations, found.weight_factors, precision.leverage, effective)
    return SolvedBlock(
        found.state, equations, found.weight_factors, normals, found.linearised_at, found.iterations, found.reason,
        found.weighing, problem, precision, variance, undetermined,
    )  # fmt: skip


Criterion = Callable[[Linearised[BlockState], Linearised[BlockState], FloatArray], bool]


def stop_criterion(problem: BlockProblem) -> Criterion | None:
    """Return whether an iteration, from one state to the next, with weight factors (n,), was small enough.

    None: the bundle has no criterion but ENP. These are the criteria of OLTRIS (Kersten, Baltsavias, Schwarz and Leiss
    1992): averages over the block, in the units of the project.
    """
    definition, unknowns = problem.block.definition, problem.unknowns
    angles, coordinates, vtpv = definition.stop_angles, definition.stop_coordinates, definition.stop_vtpv
    if angles is None and coordinates is None and vtpv is None:
        return None
    is_unknown = unknowns.elements != CONSTANT
    turns, moves = is_unknown[:, 3:].any(axis=1), is_unknown[:, :3].any(axis=1)
    moving_points = (unknowns.points != CONSTANT).any(axis=1)

    def is_small(before: Linearised[BlockState], after: Linearised[BlockState], weights: FloatArray) -> bool:
        one, other = before.state, after.state
        turned = rotation_vectors_with_partials(other.rotations[turns] @ np.swapaxes(one.rotations[turns], 1, 2))[0]
        moved = np.concatenate(
            [(other.centres - one.centres)[moves].ravel(), (other.points - one.points)[moving_points].ravel()]
        )
        then, now = _square_sum(before.equations, weights), _square_sum(after.equations, weights)
        return (
            (angles is None or DEGREES_PER_RADIAN * _average(turned) <= angles)
            and (coordinates is None or _average(moved) <= coordinates)
            and (vtpv is None or abs(now - then) <= vtpv * max(now, np.finfo(np.float64).tiny))
        )

    return is_small


def _average(changes: FloatArray) -> float:
    return float(np.mean(np.abs(changes))) if changes.size else 0.0


def _square_sum(equations: Equations, weights: FloatArray) -> float:
    taking_part = equations.active & ~equations.exact
    return float(np.sum(weights[taking_part] * equations.residual[taking_part] ** 2))
