"""The adjustment of a block from its starting values to the solution, with what probably went wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace

from orip.bundle.assemble import BlockInput
from orip.bundle.diagnosis import forewarnings
from orip.bundle.methods import Method, adjust_block
from orip.bundle.solve import SolvedBlock
from orip.errors import NotSolvableError
from orip.mistakes.explanation import explain_failure, explain_misfit
from orip.mistakes.readjuster import Readjuster
from orip.records.block import Block
from orip.records.preliminary import PreliminaryValues
from orip.records.solution import IterationPass, Solution
from orip.solving.gathering import gather_bundle
from orip.solving.starting_values import started_block

PLAIN = Method()
"""All observations, weights by the Danish method as the bundle's definition says."""


@dataclass(frozen=True, slots=True)
class SolveWatcher:
    """What follows the progress of an adjustment, and may stop it.

    Parameters
    ----------
    oriented : callable
        Told the preliminary values, if some were missing and had to be found.
    started : callable
        Told the block before the first iteration.
    passed : callable
        Told each pass.
    stoppable : context manager
        Is entered for the time of the iterations and gives a function: once that returns True, the current iteration
        is the last one; the result is kept and marked as stopped.
    """

    oriented: Callable[[PreliminaryValues], None]
    started: Callable[[Block], None]
    passed: Callable[[IterationPass], None]
    stoppable: Callable[[], AbstractContextManager[Callable[[], bool]]]


@contextmanager
def _never_stopped() -> Iterator[Callable[[], bool]]:
    yield lambda: False


NOBODY = SolveWatcher(lambda _: None, lambda _: None, lambda _: None, _never_stopped)
"""Progress is not shown, and the adjustment is not stopped."""


def solve_bundle(
    inputs: BlockInput, method: Method = PLAIN, watcher: SolveWatcher = NOBODY
) -> tuple[Solution, SolvedBlock]:
    """Gather the block of a bundle and solve it; see `gather_bundle` and `solve`."""
    return solve(gather_bundle(inputs), method, watcher)


def solve(gathered: Block, method: Method = PLAIN, watcher: SolveWatcher = NOBODY) -> tuple[Solution, SolvedBlock]:
    """Find starting values where they are missing, adjust the block, and say what is probably wrong with it.

    Parameters
    ----------
    gathered : Block
        See `gather_bundle`.
    method : Method
    watcher : SolveWatcher

    Returns
    -------
    solution : Solution
        Diagnosed, with all warnings; name of the project, inputs, interior orientation and run are empty.
    solved : SolvedBlock
        As it was adjusted last, with the normal equations.

    Raises
    ------
    NotSolvableError
        With the probable causes first.
    """
    not_found: list[str] = []
    readjuster = Readjuster(gathered, lambda block: started_block(block, lambda _: None)[0])

    def oriented(values: PreliminaryValues) -> None:
        not_found.extend(photo.name for photo in values.photos if photo.rotation is None)
        watcher.oriented(values)

    try:
        block, start_warnings = started_block(gathered, oriented)
        watcher.started(block)
        with watcher.stoppable() as stop_asked:
            solution, solved = adjust_block(block, method, watcher.passed, stop_asked)
    except NotSolvableError as error:
        causes = explain_failure(readjuster, not_found)
        raise NotSolvableError("\n".join([*map(str, causes), str(error)])) from None
    explained = () if solution.status == "stopped" else explain_misfit(solution, solved, block, readjuster)
    warnings = (*explained, *gathered.warnings, *start_warnings, *forewarnings(block))
    rows = tuple((warning.code, warning.where, warning.text) for warning in warnings)
    return replace(solution, warnings=rows), solved
