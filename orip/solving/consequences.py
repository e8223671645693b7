"""What follows from what: warnings and contradictions that are not said where their cause is.

One table, of causes and of what follows from them. A cause is a warning; what follows are other warnings, and groups of
observations that contradict the others.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from msgspec import Struct

from orip.errors import ProjectWarning
from orip.mistakes.camera_values import (
    CAMERA_SIGNS,
    FAR_FROM_GIVEN,
    NOT_SQUARE,
    OTHER_LENS,
)
from orip.mistakes.contradicting_rigs import EXCHANGED_CAMERAS, MOUNTING
from orip.mistakes.control.check_points import HEIGHT_SYSTEM
from orip.mistakes.control.contradicting_control import CODE as CONTROL
from orip.mistakes.control.contradicting_distances import DISTANCE_UNIT
from orip.mistakes.control.distances_alone import CODE as DISTANCE
from orip.mistakes.control.free_network import DISTANCE_AXES
from orip.mistakes.control.reduced_control import REDUCED_CONTROL
from orip.mistakes.control.seen_control import SHORT_TEXTS_OF_CONTROL
from orip.mistakes.errors_too_small import TOO_SMALL
from orip.mistakes.exchanged_photos import ANOTHER_FLIGHT
from orip.mistakes.hypothesis import EXPLAINING_WARNINGS
from orip.mistakes.marks.all_films import MARK_TRANSFORMATION, MARK_UNIT, MARKS_GIVEN_WRONG
from orip.mistakes.marks.misnamed import MISNAMED_MARKS, MISREAD_MARK
from orip.mistakes.misread_photos import MIRRORED
from orip.mistakes.outside_frame import EXCHANGED_TEMPLATES, STRAY_POINTS
from orip.mistakes.photo_coordinates import COORDINATE_UNIT, RESOLUTION
from orip.mistakes.photo_precision import PRECISION
from orip.mistakes.stations.contradicting_positions import CODE as POSITION
from orip.mistakes.stations.contradicting_positions import SCATTERED, SHORT_TEXTS_OF_POSITIONS
from orip.mistakes.stations.misread_angles import CODE as ANGLES
from orip.mistakes.stations.misread_antennas import SHORT_TEXTS_OF_ANTENNAS
from orip.mistakes.stations.misread_pictures import OF_PICTURES
from orip.mistakes.stations.misread_positions import HEIGHT_OFFSET, SHORT_TEXTS_OF_STATIONS
from orip.mistakes.stations.rolling_shutters import READOUT_TIME, ROLLING_SHUTTER
from orip.mistakes.stations.strips import MOVED
from orip.mistakes.stations.two_lenses import TWO_LENSES
from orip.mistakes.two_systems import SHORT_TEXTS_OF_SYSTEMS
from orip.mistakes.vertical_photos import HEIGHT_UNIT, SHORT_TEXTS_OF_VERTICAL_PHOTOS

REPLACED = "given-values"
"""Code of the warning that the adjustment did not start from the given values."""

GIVEN = "given-orientation"
_OF_START = (GIVEN, "exchanged-photos", "angle-unit", "control-unit", MIRRORED)
"""Codes of what is said of the values that an adjustment started from."""

MISREAD_PHOTO = (MIRRORED, "exchanged-axes", "turned", "other-camera", "shifted-numbers", "contradicting-photo")
"""Codes of what is wrong with all measurements of a photo."""

MARKS = (MISNAMED_MARKS, MISREAD_MARK, EXCHANGED_TEMPLATES, MARK_UNIT, MARK_TRANSFORMATION, MARKS_GIVEN_WRONG)

OF_STATIONS = frozenset(
    (
        *SHORT_TEXTS_OF_SYSTEMS,
        *SHORT_TEXTS_OF_STATIONS,
        *SHORT_TEXTS_OF_ANTENNAS,
        HEIGHT_SYSTEM,
        TWO_LENSES,
        ANGLES,
        MOVED,
    ),
)
"""Causes that all stations, or their control, appear wrong by."""

_GROUND = ("exposure station", "attitudes", "control point")


class Consequence(Struct, frozen=True):
    """What follows from a warning.

    Parameters
    ----------
    causes : collection of str
        Its codes.
    warnings : collection of str, or None
        Codes of the warnings that follow; None: all others.
    groups : tuple of str
        Words in the names of groups of observations whose contradictions follow.
    of_same_photo : bool
        Only warnings about a photo that the cause names follow.
    """

    causes: Collection[str]
    warnings: Collection[str] | None = ()
    groups: tuple[str, ...] = ()
    of_same_photo: bool = False


CONSEQUENCES: tuple[Consequence, ...] = (
    # pixels that all are somewhere else leave nothing to be said of photos and control
    Consequence((COORDINATE_UNIT, RESOLUTION), warnings=None),
    # a photo that is measured wrong as a whole is anywhere, and leads the adjustment astray
    Consequence(EXPLAINING_WARNINGS, warnings=None, of_same_photo=True),
    # ... and the control that it shows with it
    Consequence(MISREAD_PHOTO, groups=(*_GROUND, "check point")),
    # where pictures are wrong, preliminary values are, and what a camera seems to have
    Consequence(
        (
            *EXPLAINING_WARNINGS,
            *SHORT_TEXTS_OF_VERTICAL_PHOTOS,
            *CAMERA_SIGNS,
            OTHER_LENS,
            MIRRORED,
            ANOTHER_FLIGHT,
            TWO_LENSES,
            "other-camera",
        ),
        warnings=("preliminary-values", "photo-left-out", "one-ray"),
    ),
    Consequence(("outside-frame", "senseless-camera"), warnings=(FAR_FROM_GIVEN,), groups=(*_GROUND, "check point")),
    # positions that are wrong lead nowhere, and photos are not where they were given
    Consequence(OF_STATIONS, warnings=(REPLACED, *_OF_START), groups=_GROUND),
    # coordinates in another unit make their errors those of no survey
    Consequence(SHORT_TEXTS_OF_SYSTEMS, warnings=("error-unit", TOO_SMALL, DISTANCE_UNIT), groups=("distance",)),
    # a longer lens shows its points beyond the frame of the shorter one
    Consequence((TWO_LENSES,), warnings=("outside-frame", STRAY_POINTS)),
    Consequence(
        (TOO_SMALL,), warnings=(SCATTERED, POSITION, CONTROL, PRECISION, REPLACED), groups=(*_GROUND, "check point")
    ),
    Consequence((POSITION,), warnings=(REPLACED,)),
    # a held camera takes up what it can of positions and heights that are off alike
    Consequence(SHORT_TEXTS_OF_POSITIONS, warnings=(REPLACED, *_OF_START), groups=(*_GROUND, "camera")),
    Consequence((HEIGHT_OFFSET,), groups=("camera",)),
    # marks that are wrong bend the pictures
    Consequence(MARKS, warnings=None, groups=(*_GROUND, "check point", "distance", "camera", "photo")),
    # what explains a picture explains its points
    Consequence(OF_PICTURES, warnings=(STRAY_POINTS,), of_same_photo=True),
    Consequence((POSITION,), warnings=(GIVEN,), of_same_photo=True),
    # control that is somewhere else takes all photos with it
    Consequence(SHORT_TEXTS_OF_CONTROL, warnings=(REPLACED, *_OF_START), groups=(*_GROUND, "check point", "camera")),
    Consequence((REDUCED_CONTROL,), warnings=None, groups=(*_GROUND, "check point", "camera")),
    # weights that are a hundred times too large bend the block
    Consequence((PRECISION,), warnings=None, groups=(*_GROUND, "check point", "camera", "photo")),
    # a camera displaces photos along their axes, and these the control
    Consequence((OTHER_LENS, *CAMERA_SIGNS), groups=_GROUND),
    # rows exposed at another time displace photos along the flight
    Consequence((ROLLING_SHUTTER, READOUT_TIME), groups=(*_GROUND, "camera")),
    Consequence((READOUT_TIME,), warnings=(CONTROL, POSITION, *SHORT_TEXTS_OF_POSITIONS, PRECISION, REPLACED)),
    # cameras that are not where a rig has them bend all that it holds
    Consequence(
        (MOUNTING, EXCHANGED_CAMERAS),
        warnings=(REPLACED, *_OF_START),
        groups=(*_GROUND, "check point", "camera", "photo"),
    ),
    Consequence((NOT_SQUARE,), groups=("distance",)),
    Consequence((DISTANCE_UNIT,), groups=("distance", "exposure station", "control point")),
    Consequence((DISTANCE_AXES,), groups=("distance",)),
    Consequence((DISTANCE,), groups=("distance",)),
    Consequence((HEIGHT_UNIT,), groups=("camera", "control point")),
)


def without_consequences(found: Iterable[ProjectWarning], causes: Sequence[ProjectWarning]) -> list[ProjectWarning]:
    """Return the warnings that follow from none of the causes."""
    return [warning for warning in found if not any(follows(warning, cause) for cause in causes)]


def follows(warning: ProjectWarning, cause: ProjectWarning) -> bool:
    """Tell whether a warning says what follows from another one; causes of a kind do not follow from each other."""
    return any(
        cause.code in line.causes
        and warning.code not in line.causes
        and (line.warnings is None or warning.code in line.warnings)
        and (not line.of_same_photo or _is_of_same_photo(warning, cause))
        for line in CONSEQUENCES
    )


def groups_that_follow(causes: Iterable[ProjectWarning]) -> set[str]:
    """Return words of the groups whose contradictions follow from warnings."""
    codes = {cause.code for cause in causes}
    return {word for line in CONSEQUENCES if codes & set(line.causes) for word in line.groups}


def _is_of_same_photo(warning: ProjectWarning, cause: ProjectWarning) -> bool:
    """Tell whether a warning is about a photo that its cause is about, or about the start that such photos spoil."""
    named = set(f"{cause.where} {cause.text.split(';')[0]}".replace(":", " ").replace(",", " ").split())
    if warning.code == REPLACED:
        return cause.where.startswith("photo ")
    if warning.where.startswith("photo "):
        name = warning.where.removeprefix("photo ")
        return warning.where == cause.where or (warning.code == GIVEN and name in named)
    return cause.where.removeprefix("photo ") in f"{warning.where} {warning.text}".split()[:3]
