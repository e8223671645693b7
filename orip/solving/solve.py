"""The adjustment of a block from its starting values to the solution, with what probably went wrong."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

import numpy as np
from msgspec import Struct

from orip.bundle.assemble import BlockInput
from orip.bundle.diagnosis import forewarnings
from orip.bundle.groups.words import CODE as CONTRADICTION
from orip.bundle.methods import Method, adjust_block
from orip.bundle.problem import BlockProblem, pose_problem
from orip.bundle.solve import SolvedBlock
from orip.bundle.verdict import MISTAKE, headline, sigma0_test
from orip.errors import UNREAD_FILE, NotSolvableError, ProjectWarning
from orip.mistakes.camera_values import OTHER_LENS
from orip.mistakes.check_points import HEIGHT_SYSTEM, OF_HEIGHT_SYSTEMS
from orip.mistakes.contradicting_distances import DISTANCE_UNIT, OF_DISTANCE_UNITS
from orip.mistakes.contradicting_positions import CODE as CONTRADICTING_POSITION
from orip.mistakes.exchanged_photos import OF_TWO_LENSES, TWO_LENSES
from orip.mistakes.explanation import concerns_position, explain_failure, explain_misfit, explain_start
from orip.mistakes.free_network import FREE_DATUM
from orip.mistakes.ground_systems import GROUND_SYSTEM, IN_DEGREES, SHORT_TEXTS_OF_SYSTEMS
from orip.mistakes.hypothesis import EXPLAINING_WARNINGS, Readjuster
from orip.mistakes.names import OTHER_SPELLING
from orip.mistakes.photo_coordinates import COORDINATE_UNIT, RESOLUTION
from orip.mistakes.stations import SHORT_TEXTS_OF_STATIONS
from orip.mistakes.vertical_photos import SHORT_TEXTS_OF_VERTICAL_PHOTOS
from orip.prelim.chain import preliminary_values_from_all_rays
from orip.prelim.similarity.absolute_orientation import NO_CONTROL
from orip.records.block import Block
from orip.records.results.preliminary import PreliminaryValues
from orip.records.results.solution import Diagnosis, IterationPass, Solution
from orip.solving.better_minimum import doubt_about_given, is_better
from orip.solving.starting_values import (
    StartedBlock,
    explained_preliminary_values,
    gather_bundle,
    own_start,
    started_block,
)
from orip.structs import replace

FIRST_CAUSES = {
    OTHER_SPELLING, GROUND_SYSTEM, IN_DEGREES, FREE_DATUM, RESOLUTION, UNREAD_FILE,
}  # fmt: skip
"""Warnings about the input that are listed first: misfits of the adjustment may be their consequence."""

OF_STATIONS = {
    **SHORT_TEXTS_OF_SYSTEMS, **SHORT_TEXTS_OF_STATIONS, HEIGHT_SYSTEM: OF_HEIGHT_SYSTEMS,
    TWO_LENSES: OF_TWO_LENSES,
}  # fmt: skip
"""The same of positions of photos that are not in the system of the control: what is said of single photos, or of
groups of the two, follows from it."""

WRONG = {
    **SHORT_TEXTS_OF_VERTICAL_PHOTOS, **OF_STATIONS, COORDINATE_UNIT: "the photo coordinates are in another unit",
    DISTANCE_UNIT: OF_DISTANCE_UNITS,
}  # fmt: skip
"""What the status says of a block that fits, and is wrong nevertheless, by the code of the warning."""
_FOLLOW: tuple[tuple[Collection[str], tuple[str, ...]], ...] = (
    ((*OF_STATIONS, OTHER_LENS), ("exposure station", "control point")),
    ((DISTANCE_UNIT,), ("distance", "exposure station", "control point")),
)
"""Codes of warnings, and of which groups of observations a contradiction follows from them."""

REPLACED = "given-values"
"""Code of the warning that the adjustment did not start from the given values."""

_CONTROL_POINT = "control point "

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
    method : Method
    watcher : SolveWatcher
    pose : callable

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
    try:
        adjusted, mistaken, taken = _best_of_starts(adjuster)
    except NotSolvableError as error:
        causes = [warning for warning in gathered.warnings if warning.code in FIRST_CAUSES]
        if not (adjuster.is_misread or adjuster.lacks_only_control):
            causes += explain_failure(_readjuster(gathered), adjuster.not_oriented)
        raise NotSolvableError("\n".join([*map(str, causes), str(error)])) from None
    start, solution = adjusted.start, adjusted.solution
    mistaken = _with_mistakes_of_the_block(mistaken, adjuster, adjusted)
    mistaken, taken = (_without_consequences(found, gathered.warnings) for found in (mistaken, taken))
    causes = [warning for warning in gathered.warnings if warning.code in FIRST_CAUSES]
    if any(warning.code in (*OF_STATIONS, CONTRADICTING_POSITION) for warning in (*causes, *mistaken)):
        taken = []  # positions that are wrong lead nowhere, and are to be mended first
    others = [warning for warning in gathered.warnings if warning not in causes]
    explained = [warning for warning in others if any(_is_explained(found, warning) for found in mistaken)]
    mistaken = [found for found in mistaken if not any(_is_explained(found, warning) for warning in explained)]
    causes += explained
    others = [warning for warning in others if warning not in explained]
    of_start = _without_consequences(start.warnings, gathered.warnings)
    warnings = (*causes, *mistaken, *taken, *others, *of_start, *forewarnings(start.block))
    rows = tuple((warning.code, warning.where, warning.text) for warning in warnings)
    solution = replace(_judged(solution, mistaken, gathered.warnings, taken), warnings=rows)
    return replace(solution, verdict=headline(solution, 0, sigma0_test(solution))[1]), adjusted.solved


def _is_explained(found: ProjectWarning, warning: ProjectWarning) -> bool:
    """Tell whether a photo is not where it was given because of what a warning about its measurements says."""
    if found.code != "given-orientation" or warning.code not in EXPLAINING_WARNINGS:
        return False
    return found.where.removeprefix("photo ") in f"{warning.where} {warning.text}".replace(":", " ").split()


def _judged(
    solution: Solution,
    mistaken: Sequence[ProjectWarning],
    gathered: Sequence[ProjectWarning],
    taken: Sequence[ProjectWarning],
) -> Solution:
    """Return a solution with what its first sentence has of the warnings; one that fits, and is wrong, is doubtful."""
    wrong = [
        Diagnosis(CONTRADICTION, found.where, WRONG[found.code], "first correct it as the warning says")
        for found in (*mistaken, *gathered)
        if found.code in WRONG
    ]
    # measurements that are wrong explain what does not fit, and nothing else is said of it
    measured = [found for found in gathered if found.code in EXPLAINING_WARNINGS and solution.status == "doubtful"]
    others = [_mistake(found) for found in (*measured, *mistaken, *taken) if found.code not in WRONG]
    status = "doubtful" if wrong and solution.status == "converged" else solution.status
    diagnosis = (*wrong, *_after_causes(solution, (*mistaken, *gathered) if wrong else mistaken), *others)
    return replace(solution, status=status, diagnosis=diagnosis)


def _mistake(warning: ProjectWarning) -> Diagnosis:
    """Return what the first sentence has of a warning that says what is probably wrong."""
    if warning.code == REPLACED:
        text = "not from the given values, see the warning"
    elif warning.where:
        text = f"see the warning about {warning.where}"
    else:
        text = "see the warning"
    return Diagnosis(MISTAKE, warning.where, text, "see the warning")


def _after_causes(solution: Solution, mistaken: Sequence[ProjectWarning]) -> tuple[Diagnosis, ...]:
    """Return the diagnosis; where the cause of a contradiction is named, that is to be mended, and nothing else set.

    A wrong control point may have displaced itself or others: what is then said of groups follows from it.
    """
    causes = {warning.where for warning in mistaken}
    exchanged = [warning.text.split() for warning in mistaken if warning.where.startswith(_CONTROL_POINT)]
    causes |= {
        found.where
        for found in solution.diagnosis
        if found.where.startswith(_CONTROL_POINT)
        and any(found.where.removeprefix(_CONTROL_POINT) in words for words in exchanged)
    }
    follows = {word for codes, words in _FOLLOW for warning in mistaken if warning.code in codes for word in words}
    solution = replace(
        solution,
        diagnosis=tuple(
            found
            for found in solution.diagnosis
            if not (found.code == CONTRADICTION and any(word in found.where for word in follows))
        ),
    )
    contradictions = [found for found in solution.diagnosis if found.code == CONTRADICTION]
    if contradictions and contradictions[0].where in causes and contradictions[0].where.startswith(_CONTROL_POINT):
        return tuple(found for found in solution.diagnosis if found.code != CONTRADICTION)
    return tuple(
        replace(found, remedy=f"first correct the {found.where} as the warning says")
        if found.code == CONTRADICTION and found.where in causes
        else found
        for found in solution.diagnosis
    )


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
    if any(found.code in OF_STATIONS for found in (*explained, *adjuster.gathered.warnings)):
        of_start = ()
    positions = [found for found in explained if found.code == CONTRADICTING_POSITION]
    of_start = [found for found in of_start if not concerns_position(found, positions)]
    of_place = {found.where: found for found in reversed(explained) if found.where}
    first = [of_place.get(found.where, found) for found in of_start]
    left_out = list(start.left_out)
    if left_out:
        left_out = [*explain_failure(_readjuster(gathered), adjuster.not_oriented), *left_out]
    return [*first, *left_out, *(found for found in explained if found not in first)]


def _without_consequences(found: Sequence[ProjectWarning], gathered: Sequence[ProjectWarning]) -> list[ProjectWarning]:
    """Return the warnings that do not follow from one about the measurements of all photos, or of a photo.

    A photo that is wrong as a whole is not where it was given, and leads an adjustment astray.
    """
    if any(warning.code in (COORDINATE_UNIT, RESOLUTION) for warning in gathered):
        return []
    photos = {
        warning.where.removeprefix("photo ")
        for warning in gathered
        if warning.code in EXPLAINING_WARNINGS and warning.where.startswith("photo ")
    }
    return [
        warning
        for warning in found
        if not (photos and warning.code == REPLACED) and not photos & set(f"{warning.where} {warning.text}".split()[:3])
    ]


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
        # which rays are wrong was looked for in the block as it is; a comparison for each hypothesis takes seconds
        started = started_block(changed, preliminary_values_from_all_rays)
        if started.left_out:
            raise NotSolvableError("\n".join(map(str, started.left_out)))
        return started.block

    return Readjuster(gathered, start)
