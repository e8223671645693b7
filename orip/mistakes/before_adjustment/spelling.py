"""Names that two files write differently: with a hyphen or without, with the ending of an image file or without."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from orip.errors import ProjectWarning
from orip.wording import counted_names, first_names

OTHER_SPELLING = "other-spelling"

_NAMED = 3

_ENDING = re.compile(r"\.(jpe?g|tiff?|png|dng|nef|cr[23]|arw|raf|rw2|orf)$", re.IGNORECASE)
_SEPARATORS = re.compile(r"[-_.]")


def control_spelt_otherwise(unmeasured: Sequence[str], unknown: Iterable[str]) -> list[ProjectWarning]:
    """Return a warning for control points whose names the measurements write differently.

    Parameters
    ----------
    unmeasured : sequence of str
        Names of control points that are not measured.
    unknown : iterable of str
        Names of measured points without control.
    """
    pairs = _spelt_otherwise(unmeasured, unknown)
    if not pairs:
        return []
    are = "is" if len(pairs) == 1 else "are"
    text = (
        f"{are} not measured in any photo, but {first_names(list(pairs.values()), _NAMED)} {are}: the names differ by "
        f"{_difference(pairs)} alone; write them alike in control file and measurements"
    )
    return [ProjectWarning(OTHER_SPELLING, counted_names("control point", list(pairs)), text)]


def stations_spelt_otherwise(unknown: Sequence[str], without_station: Iterable[str]) -> list[ProjectWarning]:
    """Return a warning for exposure stations whose photos are named differently in the project.

    Parameters
    ----------
    unknown : sequence of str
        Names in stations that no photo has.
    without_station : iterable of str
        Names of photos without a station.
    """
    pairs = _spelt_otherwise(unknown, without_station)
    if not pairs:
        return []
    text = (
        f"the bundle has no photos of these names, but {first_names(list(pairs.values()), _NAMED)}: the names differ "
        f"by {_difference(pairs)} alone; write them alike in the .STA file and in orip.toml"
    )
    return [ProjectWarning(OTHER_SPELLING, counted_names("exposure station", list(pairs)), text)]


def _spelt_otherwise(names: Sequence[str], others: Iterable[str]) -> dict[str, str]:
    """Return the names of which exactly one other is a different spelling, with that."""
    wanted = set(map(_form, names))
    by_form: dict[str, list[str]] = {}
    for other in others if wanted else ():
        by_form.setdefault(_form(other), []).append(other)
    return {name: found[0] for name in names if len(found := by_form.get(_form(name), [])) == 1 and found[0] != name}


def _form(name: str) -> str:
    plain = _SEPARATORS.sub("", _ENDING.sub("", name)).upper()
    return plain.lstrip("0") or plain


def _difference(pairs: Mapping[str, str]) -> str:
    """Return what all names differ by, as far as it is the same."""
    found = {_between(*sorted(pair, key=len)) for pair in pairs.items()}
    return found.pop() if len(found) == 1 else "their spelling"


def _between(shorter: str, longer: str) -> str:
    if longer.upper() == shorter.upper():
        return "capitals"
    ending = _ENDING.search(longer)
    if ending and longer[: ending.start()] == shorter:
        return f"the ending {ending[0]}"
    for sign, noun in (("-", "a hyphen"), ("_", "an underscore"), (".", "a point")):
        if longer.replace(sign, "") == shorter:
            return noun
    return "leading zeros" if longer.lstrip("0") == shorter.lstrip("0") else "their spelling"
