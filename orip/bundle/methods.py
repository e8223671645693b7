"""A block adjusted by a method: with Danish weights or data snooping, and with camera parameters pruned or not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from orip.adjustment.iteration import IterationRecord
from orip.bundle.calibration import prune, pruning_diagnosis
from orip.bundle.diagnosis import diagnose
from orip.bundle.results import iteration_pass, solution_of
from orip.bundle.snooping import SnoopingSettings, blunder_diagnosis, snoop, without_blunders
from orip.bundle.solve import SolvedBlock, solve_block
from orip.records.block import Block
from orip.records.solution import Blunder, Diagnosis, IterationPass, Solution


@dataclass(frozen=True, slots=True)
class Method:
    """How a block is adjusted.

    Parameters
    ----------
    snooping : SnoopingSettings or None
        Find blunders by data snooping and leave them out; None: reduce weights by the Danish method.
    prune : bool
        Hold camera parameters at zero that are not significant or not determinable.
    """

    snooping: SnoopingSettings | None = None
    prune: bool = False


def adjust_block(
    block: Block, method: Method, on_iteration: Callable[[IterationPass], None], stop_asked: Callable[[], bool]
) -> tuple[Solution, SolvedBlock]:
    """Adjust a block by a method.

    Parameters
    ----------
    block : Block
        With starting values; its definition holds the settings.
    method : Method
    on_iteration : callable
        Called after each iteration; those of successive adjustments are numbered consecutively.
    stop_asked : callable
        Asked after each iteration; True ends the adjustment with the current state.

    Returns
    -------
    solution : Solution
        In the user's names and units, diagnosed. Project, user, inputs, warnings, interior and run are empty.
    solved : SolvedBlock
        As it was adjusted last.

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
    solved, blunders = _solved(block, method, numbered, stop_asked)
    advice += blunder_diagnosis(blunders, block.ground_unit)
    if method.prune and not stop_asked():
        pruned = prune(solved, lambda fewer: solve_block(without_blunders(fewer, blunders), numbered, stop_asked))
        solved = pruned.solved
        advice += pruning_diagnosis(pruned.removed)
    solution = solution_of(solved)
    # the last adjustment may have converged, but the search for blunders or parameters was not finished
    cut_short = method != Method() and stop_asked()
    solution = replace(
        solution,
        status="stopped" if cut_short else solution.status,
        iterations=tuple(iterations),
        blunders=blunders,
        diagnosis=(*advice, *diagnose(solved)),
    )
    return solution, solved


def _solved(
    block: Block, method: Method, on_iteration: Callable[[IterationRecord], None], stop_asked: Callable[[], bool]
) -> tuple[SolvedBlock, tuple[Blunder, ...]]:
    if method.snooping is None:
        return solve_block(block, on_iteration, stop_asked), ()
    snooped = snoop(block, method.snooping, on_iteration, stop_asked)
    return snooped.solved, snooped.blunders
