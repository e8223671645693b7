"""The tables and keys of orip.toml: forms, limits and examples; and a wrong value described in a sentence."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from datetime import date, datetime
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin

from msgspec import Struct, StructMeta

from orip.files.project.forms import (
    Choice,
    Finding,
    Form,
    Key,
    ListOf,
    Number,
    OwnForm,
    Place,
    Table,
    Text,
    UnknownKey,
    WrongValue,
)
from orip.files.text.decimal_numbers import UNIT_IN_WORDS, parse_photo_error
from orip.files.text.shown import shown_token
from orip.records.control import PHOTO_ERRORS, PIXEL_ERRORS
from orip.records.definition import AngleUnit, Precision
from orip.records.fields import Field, Part, RecordField, fields_by_key, without_none

# All follow from the fields of structures: those of the records, and of the tables that are no records. Each key
# carries an example; messages about a wrong value show it. What concerns several records together is looked at in
# `checks`.

SINGLE_SECTIONS = ("project", "check", "report", "plan", "gnss", "gnss_network", "imu")
RECORD_SECTIONS = ("camera", "temtick", "template", "photo", "antenna", "terrain", "rig", "exposure", "bundle")
SECTIONS = (*SINGLE_SECTIONS, *RECORD_SECTIONS)
"""Tables of orip.toml; all but `SINGLE_SECTIONS` may come several times."""


class ProjectTable(Struct, frozen=True):
    """``[project]``."""

    name: Annotated[str, Field(shortest=1, longest=20, example='"ZURICH"')]
    user: Annotated[str, Field(longest=20, example='"K. Dueholm"')] = ""
    camera_file: Annotated[str, Field(shortest=1, example='"CAMERAS.CAM"')] = "CAMERAS.CAM"
    temtick_file: Annotated[str, Field(shortest=1, example='"TEMTICKS.TIK"')] = "TEMTICKS.TIK"
    project_files: Annotated[str | None, Field(example='"ZURICH"')] = None
    control_files: Annotated[str | None, Field(example='"ZURICH"')] = None
    measurement_files: Annotated[tuple[str, ...], Field(shortest=1, example='["*.MEA"]')] = ("*.MEA",)
    output_folder: Annotated[str | None, Field(example='"results"')] = None
    ground_unit: Annotated[str, Field(shortest=1, example='"m"')] = "m"
    angle_unit: Annotated[AngleUnit, Field(example='"gon"')] = "degrees"
    crs: Annotated[str | None, Field(shortest=1, example='"EPSG:2056"')] = None


class CheckTable(Struct, frozen=True):
    """``[check]``."""

    gates: Annotated[tuple[str, ...], Field(shortest=1, example='["sigma0<=1.5"]')] = ()
    test_level: Annotated[float | None, Field(least=1e-9, most=0.5, example="0.001")] = None


def example_of(table: Table, key: str) -> str | None:
    """Return how the value of a key may be written."""
    return table.keys[key].example or None if key in table.keys else None


def keys_of(table: Table) -> list[str]:
    """Return the keys that a table may have, in their order."""
    return list(table.keys)


@cache
def table_of(record: type) -> Table:
    """Return the table that a record is in orip.toml; records in it that have headers of their own are not part of it.

    A key that is missing has the record's default.
    """
    keys: dict[str, Key] = {}
    for record_field in fields_by_key(record):
        if record_field.field.parts:
            element = without_none(get_args(record_field.type)[0])
            keys |= {
                part.key: Key(_part(element, part), part.example, part.required) for part in record_field.field.parts
            }
        elif not record_field.field.own_records:
            form = _own_form(record_field) or _form(record_field.type, record_field.field)
            keys[record_field.key] = Key(form, record_field.field.example, record_field.required)
    return Table(keys)


def _own_form(record_field: RecordField) -> Form | None:
    """Return the form of a value that may be written in several ways; None for all others."""
    if record_field.type is Precision:
        return OwnForm(_precision)
    return OwnForm(_one_for_both) if record_field.field.one_for_all else None


def _part(element: Any, part: Part) -> Form:
    if part.names:
        return _elements(part.names)
    value = _single(element, Field(above=part.above))
    return value if part.size == 1 else ListOf(value, part.size)


def _form(kind: Any, field: Field) -> Form:
    """Return the form of a value: a table, a list of any or of a certain length, or a single value."""
    items = get_args(kind) if get_origin(kind) is tuple else ()
    if field.names:
        return _elements(field.names)
    if isinstance(kind, StructMeta):
        return table_of(kind)
    if items:
        return ListOf(_form(items[0], field), None if items[1:] == (...,) else len(items))
    return _single(kind, field)


def _elements(names: Sequence[str]) -> Table:
    """Return the table of the elements of a tuple; those that are missing are 0."""
    return Table(dict.fromkeys(names, Key(Number())))


def _single(kind: Any, field: Field) -> Form:
    if get_origin(kind) is Literal:
        return Choice(get_args(kind))
    if kind is str:
        is_one_line = field.text == "line"
        return OwnForm(_day) if field.text == "date" else Text(field.shortest, field.longest, is_one_line)
    if kind is bool:
        return OwnForm(_truth)
    return Number(kind is int, field.above, field.least, field.most)


# values that may be written in several ways


def _truth(value: object) -> bool:
    if not isinstance(value, bool):
        message = "only true or false, without quotation marks, is allowed"
        raise ValueError(message)  # noqa: TRY004  # what is allowed is told by a ValueError
    return value


def _day(value: object) -> str:
    """Return a date as text, written as a TOML date or in words."""
    if isinstance(value, date) and not isinstance(value, datetime):
        return value.isoformat()
    if not isinstance(value, str):
        message = "only a date such as 2026-05-04 or a text is allowed"
        raise ValueError(message)  # noqa: TRY004  # what is allowed is told by a ValueError
    fault = Text(is_one_line=True).fault(value)
    if fault is not None:
        raise ValueError(fault)
    return value


def _as_number(value: object) -> float | None:
    """Return a TOML number as a float; None for anything else, and for what is too large for one."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if abs(number) < float("inf") else None


def _precision(value: object) -> Precision:
    number, unit = _as_number(value), "mm"
    if isinstance(value, str):
        number, in_pixels = parse_photo_error(value)
        unit = "px" if in_pixels else "text"
    if number is None or unit == "text":
        message = "only a number (mm) or a text such as '0.5px' is allowed"
        raise ValueError(message)
    if number <= 0:
        message = "a precision is above 0"
        raise ValueError(message)
    fault = (PIXEL_ERRORS if unit == "px" else PHOTO_ERRORS).fault(number)
    if fault is not None:
        raise ValueError(fault)
    return Precision(number, "px" if unit == "px" else "mm")


def _one_for_both(value: object) -> tuple[float, float]:
    sizes = value if isinstance(value, list) else [value, value]
    numbers = [number for number in map(_as_number, sizes) if number is not None and number > 0]
    if len(sizes) != 2 or len(numbers) != 2:
        message = "only a number above 0 (mm) or two of them, [px, py], are allowed"
        raise ValueError(message)
    return numbers[0], numbers[1]


Fault = tuple[tuple[str | int, ...], str]
"""Where in the text (keys and indices), and the message."""

_MOST_COMPARED = 500
"""With more names than that no nearest one is looked for: thousands of wrong names would take minutes."""


def table_faults(findings: Sequence[Finding], table: Table, title: str, place: Place) -> Iterator[Fault]:
    """Yield a sentence for each thing that was found wrong in one table.

    Parameters
    ----------
    table : Table
        The keys that were allowed.
    title : str
        The record as messages call it, e.g. ``camera 'OLYMPUS'``.
    place : tuple of str or int
        Keys and indices that lead to the table.
    """
    # a key that does not exist stands in place of one that is missing
    for finding in sorted(findings, key=lambda found: not isinstance(found, UnknownKey)):
        yield (*place, *finding.place), _sentence(finding, table, title)


_SYNONYMS = {
    **dict.fromkeys(
        ("F", "FX", "FY", "FOCAL", "FOCAL_LENGTH", "FOCALLENGTH", "CK", "PRINCIPAL_DISTANCE", "CAMERA_CONSTANT"), ("C",)
    ),
    **dict.fromkeys(("CX", "PPX", "XP", "XH", "X_PP"), ("DX", "PRINCIPAL_POINT")),
    **dict.fromkeys(("CY", "PPY", "YP", "YH", "Y_PP"), ("DY", "PRINCIPAL_POINT")),
    "PP": ("PRINCIPAL_POINT",),
    **{f"K{order}": (f"A{2 * order + 1}", "DISTORTION") for order in range(1, 5)},
    **dict.fromkeys(("P1", "P2", "B1", "B2"), ("DISTORTION",)),
    **dict.fromkeys(("SENSOR_WIDTH", "SENSOR_SIZE", "PIXEL_SIZE", "IMAGE_SIZE", "COLUMNS", "ROWS"), ("SENSOR",)),
    **dict.fromkeys(("IMAGE", "PICTURE", "SHOT", "PHOTOGRAPH"), ("PHOTO",)),
    **dict.fromkeys(("PRECISION", "SIGMA", "SIGMA_IMAGE", "PIXEL_ERROR", "SD"), ("MEASUREMENT_PRECISION",)),
    **dict.fromkeys(("ITERATIONS", "MAX_ITER"), ("MAX_ITERATIONS",)),
    **dict.fromkeys(("EPSG", "SRS", "COORDINATE_SYSTEM"), ("CRS",)),
    **dict.fromkeys(("UNIT", "UNITS"), ("GROUND_UNIT",)),
    **dict.fromkeys(("OFFSET", "GPS_OFFSET", "ANTENNA_OFFSET"), ("LEVER_ARM",)),
}
"""What other programs call a thing, in capitals, and orip's words for it, of which a table has one at most."""

_K_OF_OTHERS = (
    "; of coordinates divided by the focal length, as other programs have them, k1 = A3 C² and k2 = A5 C⁴ (C in mm)"
)


def unknown_key(key: str, title: str, allowed: Sequence[str]) -> str:
    """Return what to say of a key that does not exist; the nearest known one is named."""
    shown = shown_token(key)
    near = nearest_word(key, allowed)
    note = _K_OF_OTHERS if key.upper() in ("K1", "K2", "K3", "K4") else ""
    if key.upper() in ("PIXEL_SIZE", "PIXEL", "PIXEL_PITCH") and "width" in allowed:
        note = "; width = columns times the size of a pixel in mm, height = rows times it"
    if "LAP" in key.upper() and "forward" in allowed:
        near, note = None, "; overlaps along and across the strips are forward and side, in percent"
    return f"{title} has the unknown key '{shown}'; {instead(near, allowed)}{note}"


def instead(near: str | None, allowed: Sequence[str]) -> str:
    """Return what to write instead of a word that is not known: the nearest known one, if there is one, and all."""
    words = ", ".join(allowed)
    return f"did you mean '{near}'? Allowed: {words}" if near else f"allowed: {words}"


def unknown_name(name: str, kind: str, where: str, known: Sequence[str]) -> str:
    """Return what to say of a name that no record has; the nearest known one is named."""
    near = nearest_word(name, known)
    remedy = f"did you mean '{near}'?" if near else f"define a [[{kind}]] of that name or correct it"
    return f"{where} names {kind} '{shown_token(name)}', which is not defined; {remedy}"


def nearest_word(word: str, known: Sequence[str]) -> str | None:
    """Return the known word that another one probably stands for: what other programs call so, or what is spelt so."""
    if len(known) > _MOST_COMPARED:
        return None
    by_upper = {candidate.upper(): candidate for candidate in known}
    for meant in _SYNONYMS.get(word.upper(), ()):
        if meant in by_upper:
            return by_upper[meant]
    near = difflib.get_close_matches(word.upper()[:100], list(by_upper), 1)
    return by_upper[near[0]] if near else None


def _sentence(finding: Finding, table: Table, title: str) -> str:
    if isinstance(finding, WrongValue):
        return _wrong_value(finding, table, title)
    around, last = finding.place[:-1], finding.place[-1]
    where = " of ".join([*_places(around), title])
    holder = table.around(around)
    if isinstance(finding, UnknownKey):
        return unknown_key(str(last), where, keys_of(holder))
    return f"{where} has no {last}; it is required, write for example {last} = {example_of(holder, str(last))}"


def _wrong_value(finding: WrongValue, table: Table, title: str) -> str:
    if not finding.place:
        return f"{title} is {_found(finding.found)}, but a table is required; write its keys below a header in brackets"
    last = max(index for index, part in enumerate(finding.place) if isinstance(part, str))
    key = str(finding.place[last])
    example = example_of(table.around(finding.place[:last]), key)
    what = " of ".join([*_places(finding.place), title])
    said = f"{what} is {_found(finding.found)}, but {finding.allowed}"
    return said if UNIT_IN_WORDS in said else f"{said}; write for example {key} = {example or 0.0}"


def _places(location: Sequence[str | int]) -> list[str]:
    """Return the steps to a value from the inside out, elements of lists counted from 1."""
    steps: list[str] = []
    for part in location:
        if isinstance(part, int):
            previous = steps.pop() if steps else "element"
            steps.append(f"{previous} number {part + 1}")
        else:
            steps.append(shown_token(part))
    return steps[::-1]


def _found(value: Any) -> str:
    if isinstance(value, str):
        return f'"{shown_token(value)}"'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    try:
        return shown_token(str(value))
    except ValueError:  # Python refuses to print whole numbers of thousands of digits
        return "a very large number"
