"""The ways of adjusting a block: as it is, freed of blunders, freed of needless camera parameters, or of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from orip.adjustment.iteration import PassRecord
from orip.bundle.advice import blunder_advice, pruning_advice
from orip.bundle.calibration import prune
from orip.bundle.diagnosis import diagnose
from orip.bundle.results import iteration_pass, solution_of
from orip.bundle.snooping import SnoopingSettings, snoop, without_blunders
from orip.bundle.solve import SolvedBlock, solve_block
from orip.records.block import Block
from orip.records.solution import Blunder, Diagnosis, Solution


@dataclass(frozen=True, slots=True)
class Method:
    """How to adjust.

    Parameters
    ----------
    snooping : SnoopingSettings or None
        Search blunders and leave them out, instead of reducing weights.
    prune : bool
        Hold camera parameters at zero that are not significant or not determinable.
    """

    snooping: SnoopingSettings | None = None
    prune: bool = False


def adjust_block(
    block: Block,
    method: Method,
    ground_unit: str,
    on_pass: Callable[[PassRecord], None],
    stop_asked: Callable[[], bool],
) -> Solution:
    """Adjust a block by a method and return its solution, diagnosed.

    Parameters
    ----------
    block : Block
    method : Method
    ground_unit : str
        For the wording of diagnoses.
    on_pass, stop_asked : callables
        See `orip.bundle.solve.solve_block`; passes are numbered through.

    Returns
    -------
    Solution
    """
    passes: list[PassRecord] = []

    def numbered(record: PassRecord) -> None:
        passes.append(replace(record, iteration=len(passes) + 1))
        on_pass(passes[-1])

    advice: list[Diagnosis] = []
    solved, blunders = _solved(block, method, numbered, stop_asked)
    advice += blunder_advice(blunders, ground_unit)
    if method.prune and not stop_asked():
        pruned = prune(solved, lambda fewer: solve_block(without_blunders(fewer, blunders), numbered, stop_asked))
        solved = pruned.solved
        advice += pruning_advice(pruned.removed)
    solution = solution_of(solved)
    # the last adjustment may have converged, but the search for blunders or parameters has not come to its end
    cut_short = method != Method() and stop_asked()
    return replace(
        solution,
        status="stopped" if cut_short else solution.status,
        iterations=tuple(iteration_pass(record) for record in passes),
        blunders=blunders,
        diagnosis=(*advice, *diagnose(solved)),
    )


def _solved(
    block: Block, method: Method, on_pass: Callable[[PassRecord], None], stop_asked: Callable[[], bool]
) -> tuple[SolvedBlock, tuple[Blunder, ...]]:
    if method.snooping is None:
        return solve_block(block, on_pass, stop_asked), ()
    snooped = snoop(block, method.snooping, on_pass, stop_asked)
    return snooped.solved, snooped.blunders
