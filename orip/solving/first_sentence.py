"""What the first sentence of a solution has of the warnings."""

from __future__ import annotations

from collections.abc import Sequence

from orip.bundle.groups.words import CODE as CONTRADICTION
from orip.bundle.groups.words import EXPLAINED
from orip.bundle.verdict import MISTAKE
from orip.errors import UNREAD_FILE, ProjectWarning
from orip.mistakes.control.check_points import HEIGHT_SYSTEM, OF_HEIGHT_SYSTEMS
from orip.mistakes.control.contradicting_distances import DISTANCE_UNIT, OF_DISTANCE_UNITS
from orip.mistakes.control.free_network import DISTANCE_AXES, FREE_DATUM
from orip.mistakes.control.reduced_control import OF_REDUCED_CONTROL, REDUCED_CONTROL
from orip.mistakes.control.seen_control import SHORT_TEXTS_OF_CONTROL
from orip.mistakes.errors_too_small import TOO_SMALL
from orip.mistakes.hypothesis import EXPLAINING_WARNINGS
from orip.mistakes.names import OTHER_SPELLING
from orip.mistakes.photo_coordinates import COORDINATE_UNIT, RESOLUTION
from orip.mistakes.photo_precision import IMPRECISE, OF_PRECISION, PRECISION
from orip.mistakes.stations.contradicting_positions import SHORT_TEXTS_OF_POSITIONS
from orip.mistakes.stations.misread_angles import CODE as ANGLES
from orip.mistakes.stations.misread_angles import OF_ANGLES
from orip.mistakes.stations.misread_antennas import SHORT_TEXTS_OF_ANTENNAS
from orip.mistakes.stations.misread_positions import SHORT_TEXTS_OF_STATIONS
from orip.mistakes.stations.rolling_shutters import OF_READOUT_TIMES, READOUT_TIME
from orip.mistakes.stations.two_lenses import OF_TWO_LENSES, TWO_LENSES
from orip.mistakes.two_systems import GROUND_SYSTEM, IN_DEGREES, SHORT_TEXTS_OF_SYSTEMS
from orip.mistakes.vertical_photos import SHORT_TEXTS_OF_VERTICAL_PHOTOS
from orip.records.results.solution import Diagnosis, Solution
from orip.solving.consequences import REPLACED, groups_that_follow
from orip.structs import replace

FIRST_CAUSES = {
    OTHER_SPELLING, GROUND_SYSTEM, IN_DEGREES, FREE_DATUM, DISTANCE_AXES, TOO_SMALL, RESOLUTION, UNREAD_FILE,
}  # fmt: skip
"""Warnings about the input that are listed first: misfits of the adjustment may be their consequence."""

WRONG = {
    **SHORT_TEXTS_OF_VERTICAL_PHOTOS, **SHORT_TEXTS_OF_SYSTEMS, **SHORT_TEXTS_OF_STATIONS,
    **SHORT_TEXTS_OF_POSITIONS, **SHORT_TEXTS_OF_ANTENNAS, **SHORT_TEXTS_OF_CONTROL,
    REDUCED_CONTROL: OF_REDUCED_CONTROL, HEIGHT_SYSTEM: OF_HEIGHT_SYSTEMS, TWO_LENSES: OF_TWO_LENSES, ANGLES: OF_ANGLES,
    COORDINATE_UNIT: "the photo coordinates are in another unit", DISTANCE_UNIT: OF_DISTANCE_UNITS,
    PRECISION: OF_PRECISION, READOUT_TIME: OF_READOUT_TIMES,
}  # fmt: skip
"""What the status says of a block that fits, and is wrong nevertheless, by the code of the warning."""

CONTRADICTING = {DISTANCE_AXES, TOO_SMALL}
"""Codes of what is given so that it contradicts the rest."""

_CONTROL_POINT = "control point "


def judged(
    solution: Solution,
    mistaken: Sequence[ProjectWarning],
    gathered: Sequence[ProjectWarning],
    taken: Sequence[ProjectWarning],
) -> Solution:
    """Return a solution with what its first sentence has of the warnings; one that fits, and is wrong, is doubtful."""
    wrong = [
        Diagnosis(EXPLAINED, found.where, WRONG[found.code], "first correct it as the warning says")
        for found in (*mistaken, *gathered)
        if found.code in WRONG
    ]
    # measurements that are wrong explain what does not fit, and nothing else is said of it
    codes = EXPLAINING_WARNINGS if solution.status == "doubtful" else set()
    if any(found.code == CONTRADICTION for found in solution.diagnosis):
        codes = {*codes, *CONTRADICTING}
    measured = [found for found in gathered if found.code in codes]
    others = [_mistake(found) for found in (*measured, *mistaken, *taken) if found.code not in WRONG]
    status = "doubtful" if wrong and solution.status == "converged" else solution.status
    diagnosis = (*wrong, *_after_causes(solution, (*mistaken, *(gathered if wrong else measured))), *others)
    return replace(solution, status=status, diagnosis=diagnosis)


def _mistake(warning: ProjectWarning) -> Diagnosis:
    """Return what the first sentence has of a warning that says what is probably wrong."""
    if warning.code == IMPRECISE:
        return Diagnosis(EXPLAINED, warning.where, OF_PRECISION, "first correct it as the warning says")
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
    follows = groups_that_follow(mistaken)
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
        replace(found, code=EXPLAINED, remedy=f"first correct the {found.where} as the warning says")
        if found.code == CONTRADICTION and found.where in causes
        else found
        for found in solution.diagnosis
    )
