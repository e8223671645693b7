"""The adjustment of a block from its starting values to the solution, with what probably went wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

import numpy as np
from msgspec import Struct

from orip.bundle.assemble import BlockInput
from orip.bundle.diagnosis import forewarnings
from orip.bundle.methods import Method, adjust_block
from orip.bundle.problem import BlockProblem, pose_problem
from orip.bundle.solve import SolvedBlock
from orip.bundle.verdict import headline, sigma0_test
from orip.errors import Complaint, InputError, NotSolvableError, ProjectWarning
from orip.mistakes.explanation import explain_failure, explain_misfit, explain_start
from orip.mistakes.hypothesis import Readjuster
from orip.mistakes.mistake import REPLACED, mistake_of
from orip.records.block import Block
from orip.records.preliminary import NO_CONTROL, PreliminaryValues
from orip.records.results.solution import IterationPass, Solution
from orip.solving.better_minimum import doubt_about_given, is_better
from orip.solving.consequences import comes_first, follows, judged, without_consequences
from orip.solving.other_orientations import other_orientations
from orip.solving.starting_values import (
    StartedBlock,
    explained_preliminary_values,
    gather_bundle,
    own_start,
    started_block,
)
from orip.structs import replace

PLAIN = Method()
"""All observations, with weights by the Danish method as defined for the bundle."""


class SolveWatcher(Struct, frozen=True):
    """What follows the progress of an adjustment, and may stop it.

    Parameters
    ----------
    oriented : callable
        Called with the preliminary values, if some were missing and had to be found.
    doubted : callable
        Called with what is wrong with the adjustment from given values, before it is repeated from the chain's.
    replaced : callable
        Called with the values of the chain if the adjustment from them was better.
    started : callable
        Called with the block before the first iteration.
    passed : callable
        Called after each iteration.
    stoppable : context manager
        Entered for the duration of the iterations. It gives a function: once that returns True, the current iteration
        is the last one, and the result is kept and marked as stopped.
    """

    oriented: Callable[[PreliminaryValues], None]
    doubted: Callable[[str], None]
    replaced: Callable[[PreliminaryValues], None]
    started: Callable[[Block], None]
    passed: Callable[[IterationPass], None]
    stoppable: Callable[[], AbstractContextManager[Callable[[], bool]]]


@contextmanager
def _never_stopped() -> Iterator[Callable[[], bool]]:
    yield lambda: False


NOBODY = SolveWatcher(lambda _: None, lambda _: None, lambda _: None, lambda _: None, lambda _: None, _never_stopped)
"""Progress is not shown, and the adjustment is not stopped."""


Pose = Callable[[Block], BlockProblem]
"""What returns the problem of a block: as a whole, or divided."""


def solve_bundle(
    inputs: BlockInput, method: Method = PLAIN, watcher: SolveWatcher = NOBODY, pose: Pose = pose_problem
) -> tuple[Solution, SolvedBlock]:
    """Gather the block of a bundle and solve it; see `gather_bundle` and `solve`."""
    return solve(gather_bundle(inputs), method, watcher, pose)


def solve(
    gathered: Block, method: Method = PLAIN, watcher: SolveWatcher = NOBODY, pose: Pose = pose_problem
) -> tuple[Solution, SolvedBlock]:
    """Find starting values where they are missing, adjust the block, and say what is probably wrong with it.

    Where the adjustment from given values fails or its end is suspicious, it is repeated from values that the chain
    finds, and the better minimum is taken. Photos that cannot be oriented are left out, with a warning for each.

    Parameters
    ----------
    gathered : Block
        See `gather_bundle`.

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
    adjuster = _Adjuster(gathered, method, watcher, pose)
    adjusted, mistaken, taken = _best_or_causes(adjuster)
    start, solution = adjusted.start, adjusted.solution
    mistaken = _with_mistakes_of_the_block(mistaken, adjuster, adjusted)
    known = (*gathered.warnings, *mistaken)
    causes = [
        warning
        for warning in gathered.warnings
        if comes_first(warning) or any(follows(found, warning) for found in mistaken)
    ]
    others = without_consequences((found for found in gathered.warnings if found not in causes), known)
    mistaken, taken, of_start = (without_consequences(found, known) for found in (mistaken, taken, start.warnings))
    warnings = (*causes, *mistaken, *taken, *others, *of_start, *forewarnings(start.block))
    rows = tuple((warning.code, warning.where, warning.text) for warning in warnings)
    solution = replace(judged(solution, mistaken, gathered.warnings, taken), warnings=rows)
    if elsewhere := other_orientations(adjusted.solved):
        status = "doubtful" if solution.status == "converged" else solution.status
        solution = replace(solution, status=status, diagnosis=(*solution.diagnosis, *elsewhere))
    return replace(solution, verdict=headline(solution, 0, sigma0_test(solution))[1]), adjusted.solved


def adjust_bundle(inputs: BlockInput, method: Method = PLAIN) -> SolvedBlock:
    """Return the block of a bundle as `solve_bundle` adjusts it, for work with its normal equations alone.

    What is wrong with it is not sought, which often takes longer than the adjustment.
    """
    return _best_or_causes(_Adjuster(gather_bundle(inputs), method, NOBODY, pose_problem))[0].solved


def _with_mistakes_of_the_block(
    of_start: Sequence[ProjectWarning], adjuster: _Adjuster, adjusted: _Adjusted
) -> list[ProjectWarning]:
    """Return what was probably mistaken in the given values, then in what was measured.

    What was measured wrong in a photo explains why it is not where it was given, and takes the place of that.
    """
    start, gathered = adjusted.start, adjuster.gathered
    explained = []
    if adjusted.solution.status != "stopped":
        own = adjuster.own if adjuster.own and adjuster.own.start.left_out == start.left_out else None
        explained = explain_misfit(
            adjusted.solution, adjusted.solved, start.block, _readjuster(start.gathered), own.solved if own else None
        )
    of_place = {found.where: found for found in reversed(explained) if found.where}
    first = [of_place.get(found.where, found) for found in of_start]
    left_out = list(start.left_out)
    if any(mistake_of(found.code).places_photos for found in explained):
        # photos were resected from that control, and placed with it
        return [*first, *(found for found in explained if found not in first), *left_out]
    if left_out:
        left_out = [*explain_failure(_readjuster(gathered), adjuster.not_oriented, adjusted.solved), *left_out]
    return [*first, *left_out, *(found for found in explained if found not in first)]


class _Adjusted(Struct, frozen=True):
    """A start, and where the adjustment from it ended."""

    start: StartedBlock
    solution: Solution
    solved: SolvedBlock


class _Adjuster(Struct):
    """Adjusts a gathered block from one start or another.

    The chain runs at most once: `values` is what it found, and `own` the adjustment from these values alone.
    """

    gathered: Block
    method: Method
    watcher: SolveWatcher
    pose: Pose
    values: PreliminaryValues | None = None
    own: _Adjusted | None = None

    @property
    def not_oriented(self) -> list[str]:
        """Return the photos that the chain could not orient."""
        return [] if self.values is None else [photo.name for photo in self.values.photos if photo.rotation is None]

    @property
    def is_misread(self) -> bool:
        """Return whether the control fits only if read differently: no other cause need be sought."""
        return self.values is not None and self.values.reading is not None

    @property
    def lacks_only_control(self) -> bool:
        """Return whether the photos fit each other, and there is no control at all: no other cause need be sought."""
        return self.values is not None and all(photo.how.endswith(NO_CONTROL) for photo in self.values.photos)

    def from_given(self) -> _Adjusted:
        """Adjust from the given values, and from those of the chain where some are missing."""
        return self._from(started_block(self.gathered, self._found))

    def from_own(self, doubt: str) -> _Adjusted | None:
        """Adjust from the values of the chain alone; None where it finds none, or none that lead to an adjustment."""
        if self.values is None:
            self.values = explained_preliminary_values(self.gathered)
        try:
            start = own_start(self.gathered, self.values)
            self.watcher.doubted(doubt)
            self.own = self._from(start)
        except NotSolvableError:
            return None
        return self.own

    def replaced_by(self, own: _Adjusted, doubt: str) -> ProjectWarning:
        """Say that the adjustment from the chain's values is the result."""
        assert self.values is not None, "they are what it started from"
        self.watcher.replaced(self.values)
        text = (
            f"the adjustment from the given values {doubt}; this result was computed from preliminary values found by "
            f"orip (sigma0 {own.solution.sigma0:.4g}). Keep them with 'orip update'"
        )
        return ProjectWarning(REPLACED, "", text)

    def _found(self, block: Block) -> PreliminaryValues:
        self.values = explained_preliminary_values(block)
        self.watcher.oriented(self.values)
        return self.values

    def _from(self, start: StartedBlock) -> _Adjusted:
        self.watcher.started(start.block)
        with self.watcher.stoppable() as stop_asked:
            found = adjust_block(start.block, self.method, self.watcher.passed, stop_asked, self.pose)
        return _Adjusted(start, *found)


def _best_or_causes(adjuster: _Adjuster) -> tuple[_Adjusted, list[ProjectWarning], list[ProjectWarning]]:
    """Return what `_best_of_starts` does; where nothing can be adjusted, an error with the probable causes first."""
    try:
        return _best_of_starts(adjuster)
    except NotSolvableError as error:
        causes = [warning for warning in adjuster.gathered.warnings if comes_first(warning)]
        if not (adjuster.is_misread or adjuster.lacks_only_control):
            causes += explain_failure(_readjuster(adjuster.gathered), adjuster.not_oriented)
        raise NotSolvableError("\n".join([*map(str, causes), str(error)])) from None
    except InputError as error:
        first = (Complaint(str(warning)) for warning in adjuster.gathered.warnings if comes_first(warning))
        raise InputError((*first, *error.complaints)) from None


def _best_of_starts(adjuster: _Adjuster) -> tuple[_Adjusted, list[ProjectWarning], list[ProjectWarning]]:
    """Adjust from the given values and, if that ends suspiciously, from the chain's own.

    If those were better, also what was probably mistaken in the given ones, and a warning that they were taken.
    """
    gathered = adjuster.gathered
    if not (gathered.preliminary or np.isfinite(gathered.photo_orientation).any()):
        return adjuster.from_given(), [], []
    try:
        given = adjuster.from_given()
    except NotSolvableError as error:
        own = adjuster.from_own("failed")
        if own is None:
            raise
        return own, [], [adjuster.replaced_by(own, f"failed ({error})")]
    doubt = doubt_about_given(given.solved)
    if not doubt or given.solution.status == "stopped":
        return given, [], []
    own = adjuster.from_own(doubt)
    if own is None or own.start.left_out != given.start.left_out or not is_better(own.solved, given.solved):
        return given, [], []
    mistaken = explain_start(own.solved, _readjuster(given.start.gathered))
    return own, mistaken, [adjuster.replaced_by(own, doubt)]


def _readjuster(gathered: Block) -> Readjuster:
    """Return what adjusts a block again, complete or not at all."""

    def start(changed: Block) -> Block:
        from orip.prelim.chain import preliminary_values_from_all_rays

        # which rays are wrong was looked for in the block as it is; a comparison for each hypothesis takes seconds
        started = started_block(changed, preliminary_values_from_all_rays)
        if started.left_out:
            raise NotSolvableError("\n".join(map(str, started.left_out)))
        return started.block

    return Readjuster(gathered, start)
