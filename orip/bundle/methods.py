"""A block adjusted by a method: with Danish weights or data snooping, and with camera parameters pruned or not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from msgspec import Struct

from orip.adjustment.iteration_state import IterationRecord
from orip.bundle.diagnosis import diagnose
from orip.bundle.groups.verdict import GroupVerdict, group_verdict
from orip.bundle.groups.words import group_diagnosis
from orip.bundle.problem import BlockProblem, pose_problem
from orip.bundle.results.solution import iteration_pass, solution_of
from orip.bundle.solve import SolvedBlock, iteration_settings, solve_block
from orip.bundle.verdict import TWO_PLACES, headline, sigma0_test
from orip.records.block import Block
from orip.records.results.solution import Blunder, Diagnosis, IterationPass, Solution
from orip.records.results.tests import NOT_DETERMINED, VarianceComponent
from orip.structs import replace

if TYPE_CHECKING:
    from orip.bundle.snooping.search import SnoopingSettings


class Method(Struct, frozen=True):
    """How a block is adjusted.

    Parameters
    ----------
    snooping : SnoopingSettings or None
        Find blunders by data snooping and leave them out; None: reduce weights by the Danish method.
    prune : bool
        Hold camera parameters at zero that are not significant or not determinable.
    variance_components : bool
        Estimate the a-priori error of each group of observations, and adjust with these errors.
    """

    snooping: SnoopingSettings | None = None
    prune: bool = False
    variance_components: bool = False


def adjust_block(
    block: Block,
    method: Method,
    on_iteration: Callable[[IterationPass], None],
    stop_asked: Callable[[], bool],
    pose: Callable[[Block], BlockProblem] = pose_problem,
) -> tuple[Solution, SolvedBlock]:
    """Adjust a block by a method.

    Parameters
    ----------
    block : Block
        With starting values; its definition holds the settings.
    on_iteration : callable
        Called after each iteration; those of successive adjustments are numbered consecutively.
    stop_asked : callable
        Asked after each iteration; True ends the adjustment with the current state.
    pose : callable
        Returns the problem of a block, as a whole or divided.

    Returns
    -------
    solution : Solution
        In the user's names and units, diagnosed. Project, user, inputs, warnings, interior and run are empty.
    solved : SolvedBlock
        The last adjustment.

    Raises
    ------
    NotSolvableError
        When there are no unknowns, or the iterations diverged to numbers that are not finite.
    """
    iterations: list[IterationPass] = []

    def numbered(record: IterationRecord) -> None:
        iterations.append(replace(iteration_pass(record), iteration=len(iterations) + 1))
        on_iteration(iterations[-1])

    advice: list[Diagnosis] = []
    blunders: tuple[Blunder, ...] = ()
    if method.snooping is None:
        solved = solve_block(block, numbered, stop_asked, pose=pose)
    else:
        # what most adjustments do not need is loaded where it is
        from orip.bundle.snooping.findings import snooping_diagnosis
        from orip.bundle.snooping.search import snoop

        snooped = snoop(block, method.snooping, numbered, stop_asked, pose)
        solved, blunders = snooped.solved, snooped.blunders
        advice += snooping_diagnosis(solved, snooped.findings)
    if method.prune and not stop_asked():
        from orip.bundle.calibration import prune, pruning_diagnosis
        from orip.bundle.snooping.findings import without_blunders

        pruned = prune(
            solved, lambda fewer: solve_block(without_blunders(fewer, blunders), numbered, stop_asked, pose=pose)
        )
        solved = pruned.solved
        advice += pruning_diagnosis(pruned.removed)
    components: tuple[VarianceComponent, ...] = ()
    if method.variance_components and not stop_asked():
        from orip.bundle.variance.components import estimate_errors

        settings = iteration_settings(block.definition)
        if method.snooping is not None:
            settings = replace(settings, start_down_weight=None)
        solved, components = estimate_errors(solved, settings, numbered, stop_asked, pose)
    solution = solution_of(solved)
    # the last adjustment may have converged, but the search for blunders or parameters was not finished
    cut_short = method != Method() and stop_asked()
    solution = replace(
        solution,
        status="stopped" if cut_short else solution.status,
        iterations=tuple(iterations),
        blunders=blunders,
        variance_components=components,
    )
    return _judged(solved, solution, advice), solved


def _judged(solved: SolvedBlock, solution: Solution, advice: Sequence[Diagnosis]) -> Solution:
    """Return a solution with the verdict on its groups of observations, its weaknesses, and the verdict on it all."""
    groups = _grouped(solved, solution)
    contradictions = group_diagnosis(groups.contradictions, solution.ground_unit)
    found = tuple(diagnose(solved))
    status = solution.status
    if status in ("converged", "doubtful") and any(diagnosis.code in NOT_DETERMINED for diagnosis in found):
        status = "not_determined"
    elif status == "converged" and any(diagnosis.code == TWO_PLACES for diagnosis in found):
        status = "doubtful"
    judged = replace(solution, status=status, groups=groups.groups, diagnosis=(*contradictions, *advice, *found))
    _, verdict = headline(judged, 0, sigma0_test(judged))
    return replace(judged, verdict=verdict)


def _grouped(solved: SolvedBlock, solution: Solution) -> GroupVerdict:
    """Return the verdict on the groups of observations; none of an adjustment that did not converge."""
    if not solved.converged:
        return GroupVerdict((), ())
    left_out = {blunder.point for blunder in solution.blunders}
    return group_verdict(
        solved, solution.residuals.a_priori, {point.name for point in solution.check_points} - left_out
    )
