"""What a mistake is: the code of its warning, what the status says of it, and what follows from it.

The module that finds a mistake declares it, and nothing else has to know it. A warning has the code of a mistake only
after that module was loaded, so that the declarations of all warnings there are can be looked up.
"""

from __future__ import annotations

from msgspec import Struct

ON_GROUND = ("exposure station", "attitudes", "control point")
"""Words in the names of groups of observations that place a block on the ground."""

REPLACED = "given-values"
"""Code of the warning that the adjustment did not start from the given values."""

GIVEN_ORIENTATION = "given-orientation"
ANOTHER_START = (REPLACED, GIVEN_ORIENTATION, "exchanged-photos", "angle-unit", "control-unit", "mirrored")
"""Codes of what is said of the values that an adjustment started from."""


class Consequence(Struct, frozen=True):
    """What follows from a mistake, and is not said where that is.

    Parameters
    ----------
    warnings : tuple of str, or None
        Codes of the warnings that follow; None: all but those from which the same follows.
    groups : tuple of str
        Words in the names of groups of observations whose contradictions follow.
    of_same_photo : bool
        Only warnings about a photo that the cause names follow.
    """

    warnings: tuple[str, ...] | None = ()
    groups: tuple[str, ...] = ()
    of_same_photo: bool = False


class Mistake(Struct, frozen=True):
    """What orip knows of a mistake.

    Parameters
    ----------
    code : str
        Of its warnings.
    words : str
        What the status says of it; "": that there is a warning.
    consequences : tuple of Consequence
    explains_misfit : bool
        What was measured is wrong: nothing else is tried where a block does not fit.
    comes_first : bool
        It is in the input, and misfits may be its consequence: its warning is listed first.
    contradicts_others : bool
        What is given contradicts the rest.
    is_serious : bool
        A block that fits is doubtful nevertheless, if it has words.
    places_photos : bool
        Photos were resected from what is wrong, and placed with it.
    """

    code: str
    words: str = ""
    consequences: tuple[Consequence, ...] = ()
    explains_misfit: bool = False
    comes_first: bool = False
    contradicts_others: bool = False
    is_serious: bool = True
    places_photos: bool = False


BAD_START = Consequence(warnings=("preliminary-values", "photo-left-out", "one-ray"))
"""Where pictures are wrong, preliminary values are, and what a camera seems to have."""

ALL_OF_ITS_PHOTO = Consequence(warnings=None, of_same_photo=True)
"""A photo that is measured wrong as a whole is anywhere, and leads the adjustment astray."""

MISPLACED_PHOTO = Consequence(groups=(*ON_GROUND, "check point", "camera"))
"""... and the control that it shows with it, and the camera takes up what it can of that."""

ALL_THE_REST = Consequence(warnings=None)
"""Pixels that all are somewhere else leave nothing to be said of photos and control."""

OTHER_FRAME = Consequence(warnings=("far-from-given",), groups=(*ON_GROUND, "check point", "camera"))
"""A camera that has another frame has another principal distance, too."""

STATIONS_OFF = Consequence(warnings=ANOTHER_START, groups=ON_GROUND)
"""Positions that are wrong lead nowhere, and photos are not where they were given."""

POSITIONS_OFF = Consequence(warnings=ANOTHER_START, groups=(*ON_GROUND, "camera"))
"""A held camera takes up what it can of positions and heights that are off alike."""

BENT_PICTURES = Consequence(warnings=None, groups=(*ON_GROUND, "check point", "distance", "camera", "photo"))
"""Marks that are wrong bend the pictures."""

_declared: dict[str, Mistake] = {}


def declare(
    code: str,
    words: str = "",
    *consequences: Consequence,
    explains_misfit: bool = False,
    comes_first: bool = False,
    contradicts_others: bool = False,
    is_serious: bool = True,
    places_photos: bool = False,
) -> str:
    """Declare a mistake, see `Mistake`, and return its code.

    Raises
    ------
    ValueError
        If the code was declared already, otherwise.
    """
    if explains_misfit:
        consequences = (*consequences, ALL_OF_ITS_PHOTO, BAD_START)
    mistake = Mistake(
        code, words, consequences, explains_misfit, comes_first, contradicts_others, is_serious, places_photos
    )
    if _declared.setdefault(code, mistake) != mistake:
        message = f"mistake {code} is declared twice"
        raise ValueError(message)
    return code


def mistake_of(code: str) -> Mistake:
    """Return the mistake that warnings of a code tell; one without words and consequences where none was declared."""
    return _declared.get(code) or Mistake(code)
