"""Numbers as people and Fortran programs write them, gates, and tables of names with numbers."""

from __future__ import annotations

import math
import re
import unicodedata
from pathlib import Path
from typing import cast

from orip.files.text.regular_file import beginning
from orip.files.text.shown import shown_token
from orip.records.results.tests import OPERATORS, Gate, GateOperator

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eEdD][+-]?[0-9]+)?")
_DECIMAL_COMMA = re.compile(r"([+-]?)([0-9]*),([0-9]+(?:[eEdD][+-]?[0-9]+)?)")
_WITH_THOUSANDS = re.compile(
    r"(?P<whole>[+-]?[0-9]{1,3}(?P<mark>[,.'’])[0-9]{3}(?:(?P=mark)[0-9]{3})*)(?:(?!(?P=mark))[.,](?P<fraction>[0-9]*))?"
)
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
_D_EXPONENT = str.maketrans("dD", "ee")
_MINUS_SIGNS = str.maketrans("−–—٫", "---.")
_WITH_UNIT = re.compile(r"(?P<number>\S+?)\s*(?P<unit>pix|pixels?|px|[uµμ]m|microns?|mm|cm)", re.IGNORECASE)
_MEASURED = re.compile(r"±?(?P<number>\S+?)(?:[uµμ]m|[mck]?m|ft|feet|in|px|pix|gon|deg|rad)", re.IGNORECASE)
UNIT_IN_WORDS = "is not how a unit is written"
"""Of a number that is followed by what it is to be instead."""
_MILLIMETRES = {"mm": 1.0, "cm": 10.0}
"""Of the units of lengths that people write after a photo error; all others are micrometres."""
_LONGEST_GUESS = 40
ORDINARY_NUMBER = r"[+-]?+(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[eE][+-]?+[0-9]++)?+"
"""Pattern of a number that `float` reads as it is, for formats that read many plain lines at a time."""
LARGEST_NUMBER = 1e30
"""Nothing measured is larger, and the fourth power of a larger number would overflow."""


def parse_number(token: str) -> float:
    """Return the value of a decimal number; Fortran's ``1.5D-3`` is one.

    Raises
    ------
    ValueError
        With a sentence that says what was found and what to write.
    """
    if _NUMBER.fullmatch(token):
        value = float(token.translate(_D_EXPONENT))
        if abs(value) <= LARGEST_NUMBER:
            return value
        message = f"'{shown_token(token)}' is too large for a number; check its exponent"
        raise ValueError(message)
    raise ValueError(_number_fault(token))


def parse_degrees(token: str, sides: str) -> float:
    """Return a longitude or latitude in degrees, which may be written as ``53°30'00"N``, ``53:30:00`` or ``N53.5``.

    Parameters
    ----------
    sides : str
        Letters of the hemispheres that it may have: ``EW`` of a longitude, ``NS`` of a latitude.

    Raises
    ------
    ValueError
        With a sentence that says what was found and what to write.
    """
    found = degrees_and_side(token)
    if found is None:
        return parse_number(token)
    degrees, side = found
    if side and side not in sides:
        message = f"'{shown_token(token)}' should end in {' or '.join(sides)}; are longitude and latitude exchanged?"
        raise ValueError(message)
    return degrees


def is_number(token: str) -> bool:
    """Tell whether a token is a finite decimal number."""
    return _NUMBER.fullmatch(token) is not None and abs(float(token.translate(_D_EXPONENT))) <= LARGEST_NUMBER


def parse_photo_error(token: str) -> tuple[float, bool]:
    """Return an a-priori error of photo coordinates and whether it is in pixels: ``0.004`` (mm) or ``0.5px``.

    Raises
    ------
    ValueError
        With a sentence that says what was found and what to write.
    """
    in_pixels = token[-2:].lower() == "px"
    if in_pixels and is_number(token[:-2]):
        return parse_number(token[:-2]), True
    if (written := _WITH_UNIT.fullmatch(token)) and is_number(written["number"]):
        number, unit = written["number"], written["unit"].lower()
        in_mm = f"{parse_number(number) * _MILLIMETRES.get(unit, 1e-3):.10g} (mm)"
        message = f"'{shown_token(token)}' {UNIT_IN_WORDS}; write {f'{number}px' if unit.startswith('p') else in_mm}"
        raise ValueError(message)
    if in_pixels:
        message = f"'{shown_token(token)}' is not a number of pixels; write for example 0.5px"
        raise ValueError(message)
    return parse_number(token), False


def _number_fault(token: str) -> str:
    shown = shown_token(token)
    if _NOT_FINITE.fullmatch(token):
        return f"'{shown}' is not allowed; write a finite decimal number"
    comma = _DECIMAL_COMMA.fullmatch(token)
    if comma:
        sign, whole, fraction = comma.groups()
        return f"'{shown}' has a decimal comma; write a decimal point: {shown_token(f'{sign}{whole or 0}.{fraction}')}"
    thousands = _WITH_THOUSANDS.fullmatch(token)
    if thousands:
        whole = thousands["whole"].replace(thousands["mark"], "")
        meant = f"{whole}.{thousands['fraction']}" if thousands["fraction"] else whole
        return f"'{shown}' has marks between thousands; write {shown_token(meant)}"
    if token.endswith(",") and _NUMBER.fullmatch(token[:-1]):
        return f"'{shown}' ends in a comma; separate fields by blanks and write {shown_token(token[:-1])}"
    angle = degrees_and_side(token)
    if angle is not None:
        return f"'{shown}' is an angle in degrees, minutes and seconds; write decimal degrees: {round(angle[0], 10)!r}"
    if (measured := _MEASURED.fullmatch(token)) and _NUMBER.fullmatch(measured["number"].replace(",", ".")):
        return f"'{shown}' is written with a unit; write the number alone, in the unit that this field has"
    return f"'{shown}' is not a number; write a plain decimal such as {_likely_number(token)}"


def _likely_number(token: str) -> str:
    """Return the decimal that was probably meant, or an example where none can be guessed."""
    # digits of other scripts, of full width and of Arabic among them
    plain = (str(unicodedata.decimal(one, one)) for one in unicodedata.normalize("NFKC", token.lstrip("±~≈")))
    candidate = "".join(plain).translate(_MINUS_SIGNS)
    first_point = candidate.find(".") + 1
    candidate = candidate[:first_point] + candidate[first_point:].replace(".", "")
    if len(candidate) > _LONGEST_GUESS or not _NUMBER.fullmatch(candidate):
        return "12.345"
    sign = candidate[0] if candidate[0] in "+-" else ""
    digits = candidate[len(sign) :]
    return f"{sign}0{digits}" if digits.startswith(".") else candidate


GATE_FORM = "name operator number, for example 'sigma0<=1.5'; operators are < <= > >= == !="
"""How a gate is written, for messages."""

_OPERATOR = "|".join(map(re.escape, sorted(OPERATORS, key=len, reverse=True)))
_GATE = re.compile(
    rf"""
    \s* (?P<name> [A-Za-z_][A-Za-z0-9_.]* )
    \s* (?P<operator> {_OPERATOR} )
    \s* (?P<limit> [+-]? (?: [0-9]+ (?: \.[0-9]* )? | \.[0-9]+ ) (?: [eE] [+-]? [0-9]+ )? )
    \s*""",
    re.VERBOSE,
)


def parse_gate(text: str) -> Gate:
    """Return the gate that a text means; whether its name is that of a figure is not looked at.

    Raises
    ------
    ValueError
        With what is wrong and what is allowed.
    """
    match = _GATE.fullmatch(text)
    if match is None or not math.isfinite(limit := float(match["limit"])):
        message = f"'{shown_token(text)}' is not a gate; write {GATE_FORM}"
        raise ValueError(message)
    return Gate(match["name"], cast("GateOperator", match["operator"]), limit)


_ENDINGS = frozenset({".csv", ".dat", ".pnt", ".pts", ".tsv", ".txt", ".xyz"})

_MOST_FILES, _MOST_CHARACTERS = 50, 200_000

_SEPARATORS = re.compile(r"[,;\s]+")
_COORDINATES = 3


def tables_in_folder(folder: Path) -> dict[Path, tuple[str, ...]]:
    """Return the files of a folder with lines of a name and three numbers or more, and these names.

    Of large files only the beginning is looked at; files that cannot be read are left out.
    """
    files = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in _ENDINGS and path.is_file()]
    return {path: names for path in files[:_MOST_FILES] if (names := _names_with_numbers(path))}


_OTHER_CONTROL = (".len", ".dir", ".con", ".sta", ".ele", ".rel")


def control_texts_of_folder(folder: Path) -> dict[Path, frozenset[str]]:
    """Return the control texts of a folder, but those of points, and the words in the beginning of each.

    Files that cannot be read are left out.
    """
    found = {}
    files = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in _OTHER_CONTROL and path.is_file()]
    for path in files[:_MOST_FILES]:
        try:
            found[path] = frozenset(beginning(path, _MOST_CHARACTERS).split())
        except (OSError, UnicodeDecodeError):
            continue
    return found


def _names_with_numbers(path: Path) -> tuple[str, ...]:
    try:
        text = beginning(path, _MOST_CHARACTERS)
    except (OSError, UnicodeDecodeError):
        return ()
    rows = (_SEPARATORS.split(line.strip()) for line in text.splitlines())
    return tuple(
        dict.fromkeys(row[0].strip("'\"") for row in rows if len(row) > _COORDINATES and all(map(_is_number, row[1:4])))
    )


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


_ANGLE_NUMBER = r"[0-9]{1,3}(?:[.,][0-9]{0,15})?"
_ANGLE = re.compile(
    rf"""
    (?P<before> [NSEW]? ) \s* (?P<sign> [+−-]? ) \s* (?P<degrees> {_ANGLE_NUMBER} )
    (?P<mark> \s* [°º˚] )?
    (?: (?: (?(mark) \s* | (?: \s*:\s* | \s+ ) ) ) (?P<minutes> {_ANGLE_NUMBER} )
        (?: (?: \s*['′’´]\s* | \s*:\s* | \s+ ) (?: (?P<seconds> {_ANGLE_NUMBER} ) \s* (?: ["″”] | '' | ′′ | ’’ )? )? )?
    )?
    \s* (?P<after> [NSEW]? )
    """,
    re.VERBOSE,
)
_ANGLE_PARTS = ("degrees", "minutes", "seconds")
_LONGEST_ANGLE = 60
_SIXTY = 60.0


def degrees_and_side(token: str) -> tuple[float, str] | None:
    """Return an angle in degrees and the letter of its hemisphere, "" without one; None if it is not so written.

    South and west are negative. A plain number is not so written.
    """
    match = _ANGLE.fullmatch(token.strip()) if len(token) <= _LONGEST_ANGLE else None
    if match is None:
        return None
    side = match["before"] or match["after"]
    parts = [match[part] for part in _ANGLE_PARTS if match[part] is not None]
    is_written = side or match["mark"] or ":" in token or len(parts) == len(_ANGLE_PARTS)
    if not is_written or (match["before"] and match["after"]) or (match["sign"] and side):
        return None
    numbers = [float(part.replace(",", ".")) for part in parts]
    if any(not part.isdigit() for part in parts[:-1]) or any(number >= _SIXTY for number in numbers[1:]):
        return None
    size = sum(number / _SIXTY**power for power, number in enumerate(numbers))
    return (-size if side in ("S", "W") or match["sign"] in ("-", "−") else size), side
