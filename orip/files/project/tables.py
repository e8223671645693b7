"""The tables and keys of orip.toml as the text has them: forms, limits and examples.

All follow from the fields of structures: those of the records, and of the tables that are no records. Each key carries
an example; messages about a wrong value show it. What concerns several records together is looked at in `checks`.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date, datetime
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin

from msgspec import Struct, StructMeta

from orip.files.project.forms import Choice, Form, Key, ListOf, Number, OwnForm, Table, Text
from orip.files.text.decimal_numbers import parse_photo_error
from orip.records.observations.control import PHOTO_ERRORS, PIXEL_ERRORS
from orip.records.project.definition import Precision
from orip.records.project.fields import Field, Part, RecordField, fields_by_key, without_none

SECTIONS = ("project", "check", "report", "camera", "temtick", "template", "photo", "antenna", "bundle")
"""Tables of orip.toml; all but the first three may come several times."""


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
    return Number(kind is int, field.above, field.least, field.most)


# values that may be written in several ways


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
