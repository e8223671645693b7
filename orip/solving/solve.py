"""The adjustment of a block from its starting values to the solution, with what probably went wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace

from orip.bundle.diagnosis import forewarnings
from orip.bundle.methods import Method, adjust_block
from orip.bundle.solve import SolvedBlock
from orip.errors import NotSolvableError, ProjectWarning
from orip.mistakes.explanation import explain_failure, explain_misfit
from orip.mistakes.readjuster import Readjuster
from orip.records.block import Block
from orip.records.camera import Camera
from orip.records.control import PreliminaryPoint
from orip.records.preliminary import PreliminaryValues
from orip.records.solution import IterationPass, Solution
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


@dataclass(frozen=True, slots=True)
class GatheredBlock:
    """A block as measured and given, before its starting values are known.

    Parameters
    ----------
    block : Block
        Elements of photos that are not known are NaN, and so are all starting coordinates of points.
    preliminary : tuple of PreliminaryPoint
        Given preliminary coordinates of points.
    cameras : tuple of Camera
        All that a photo may have been taken with.
    ground_unit : str
    warnings : tuple of ProjectWarning
        What is doubtful in what was measured and given.
    """

    block: Block
    preliminary: tuple[PreliminaryPoint, ...]
    cameras: tuple[Camera, ...]
    ground_unit: str
    warnings: tuple[ProjectWarning, ...] = ()


@dataclass(frozen=True, slots=True)
class SolvedGathered:
    """What came out of a gathered block.

    Parameters
    ----------
    solution : Solution
        Diagnosed, with all warnings; name of the project, inputs, interior orientation and run are empty.
    solved : SolvedBlock
        As it was adjusted last, with the normal equations.
    preliminary : PreliminaryValues or None
        What was found of missing starting values; None if none were missing.
    """

    solution: Solution
    solved: SolvedBlock
    preliminary: PreliminaryValues | None


def solve_gathered(gathered: GatheredBlock, method: Method = PLAIN, watcher: SolveWatcher = NOBODY) -> SolvedGathered:
    """Find starting values where they are missing, adjust the block, and say what is probably wrong with it.

    Raises
    ------
    NotSolvableError
        With the probable causes first.
    """
    found: list[PreliminaryValues] = []
    readjuster = Readjuster(
        gathered.block,
        lambda block: started_block(block, gathered.preliminary, lambda _: None)[0],
        gathered.cameras,
        gathered.warnings,
    )

    def oriented(values: PreliminaryValues) -> None:
        found.append(values)
        watcher.oriented(values)

    try:
        block, start_warnings = started_block(gathered.block, gathered.preliminary, oriented)
        watcher.started(block)
        with watcher.stoppable() as stop_asked:
            adjusted = adjust_block(block, method, gathered.ground_unit, watcher.passed, stop_asked)
    except NotSolvableError as error:
        missing = [photo.name for values in found for photo in values.photos if photo.rotation is None]
        causes = explain_failure(readjuster, missing, gathered.ground_unit)
        raise NotSolvableError("\n".join([*map(str, causes), str(error)])) from None
    solution = adjusted.solution
    explained = () if solution.status == "stopped" else explain_misfit(adjusted, block, readjuster)
    warnings = (*explained, *gathered.warnings, *start_warnings, *forewarnings(block))
    rows = tuple((warning.code, warning.where, warning.text) for warning in warnings)
    return SolvedGathered(replace(solution, warnings=rows), adjusted.solved, found[0] if found else None)
