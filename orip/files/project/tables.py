"""The tables and keys of orip.toml as the text has them: types, limits and defaults.

Those of the records follow from the fields of the records. Each key carries an example; messages about a wrong value
show it. What concerns several records together is looked at in `checks`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from datetime import date, datetime
from functools import cache
from typing import Annotated, Any, TypeAlias, get_args, get_origin

from orip.files.project.checked_table import CheckedTable, Example, Limits, ReadBy
from orip.files.text.decimal_numbers import parse_photo_error
from orip.records.observations.a_priori_error import PHOTO_ERRORS, PIXEL_ERRORS
from orip.records.project.definition import RECORD_TYPES, Precision
from orip.records.project.fields import Field, Part, RecordField, fields_by_key, without_none

ShortText: TypeAlias = Annotated[str, Limits(longest=20)]
FilledText: TypeAlias = Annotated[str, Limits(shortest=1)]

SECTIONS = ("project", "check", "report", "camera", "temtick", "template", "photo", "antenna", "bundle")
"""Tables of orip.toml; all but the first three may come several times."""


class ProjectTable(CheckedTable):
    """``[project]``."""

    name: Annotated[str, Limits(shortest=1, longest=20), Example('"ZURICH"')]
    user: Annotated[ShortText, Example('"K. Dueholm"')] = ""
    camera_file: Annotated[FilledText, Example('"CAMERAS.CAM"')] = "CAMERAS.CAM"
    temtick_file: Annotated[FilledText, Example('"TEMTICKS.TIK"')] = "TEMTICKS.TIK"
    project_files: Annotated[str | None, Example('"ZURICH"')] = None
    control_files: Annotated[str | None, Example('"ZURICH"')] = None
    measurement_files: Annotated[tuple[FilledText, ...], Example('["*.MEA"]')] = ("*.MEA",)
    output_folder: Annotated[str | None, Example('"results"')] = None
    ground_unit: Annotated[FilledText, Example('"m"')] = "m"
    crs: Annotated[str | None, Limits(shortest=1), Example('"EPSG:2056"')] = None


class CheckTable(CheckedTable):
    """``[check]``."""

    gates: Annotated[tuple[FilledText, ...], Example('["sigma0<=1.5"]')] = ()
    test_level: Annotated[float | None, Limits(least=1e-9, most=0.5), Example("0.001")] = None


def _printable(text: str) -> str:
    if not text.isprintable():
        message = "only a text on one line is allowed"
        raise ValueError(message)
    return text


def _day(value: object) -> str:
    """Return a date as text, written as a TOML date or in words."""
    if isinstance(value, str):
        return _printable(value)
    if isinstance(value, date) and not isinstance(value, datetime):
        return value.isoformat()
    message = "only a date such as 2026-05-04 or a text is allowed"
    raise ValueError(message)


OneLine: TypeAlias = Annotated[str, ReadBy(_printable)]
Day: TypeAlias = Annotated[Any, ReadBy(_day)]


class ReportTable(CheckedTable):
    """``[report]``."""

    title: Annotated[OneLine, Example('"Quarry Hohenfels, flight 3"')] = ""
    client: Annotated[OneLine, Example('"Kalkwerk Hohenfels GmbH"')] = ""
    contractor: Annotated[OneLine, Example('"Vermessung Huber"')] = ""
    author: Annotated[OneLine, Example('"K. Huber"')] = ""
    order: Annotated[OneLine, Example('"2026-117"')] = ""
    location: Annotated[OneLine, Example('"Hohenfels"')] = ""
    flown: Annotated[Day, Example("2026-04-28")] = ""
    date: Annotated[Day, Example("2026-05-04")] = ""
    equipment: Annotated[OneLine, Example('"DJI M3E, RTK by SAPOS"')] = ""
    remarks: Annotated[tuple[OneLine, ...], Example('["Signalled points were set out by the client."]')] = ()


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


@cache
def table_of(record: type) -> type[CheckedTable]:
    """Return the table that a record is in orip.toml; records in it that have headers of their own are not part of it.

    A key that may be missing is None without it; its default is that of the record.
    """
    keys: dict[str, Any] = {}
    for record_field in fields_by_key(record):
        if record_field.field.parts:
            element = without_none(get_args(record_field.type)[0])
            keys |= {
                part.key: _key(_part(element, part), part, required=part.required) for part in record_field.field.parts
            }
        elif not record_field.field.own_records:
            keys[record_field.key] = _key(
                _read_by(record_field) or _value(record_field.type, record_field.field),
                record_field.field,
                required=record_field.required,
            )
    return _table_class(f"{record.__name__}Table", keys)


def _table_class(name: str, keys: Mapping[str, tuple[Any, Any]]) -> type[CheckedTable]:
    """Return the class of a table with the annotation and the default of each key; `...`: it has to be there."""
    annotations = {key: annotation for key, (annotation, _) in keys.items()}
    defaults = {key: default for key, (_, default) in keys.items() if default is not ...}
    return type(name, (CheckedTable,), {"__annotations__": annotations, **defaults})


def _key(annotation: Any, field: Field | Part, *, required: bool) -> Any:
    shown = Annotated[annotation, Example(field.example)] if field.example else annotation
    return shown, ... if required else None


def _read_by(record_field: RecordField) -> Any:
    """Return the type of a value that may be written in several forms; None for all others."""
    if record_field.type is Precision:
        return Annotated[Any, ReadBy(_precision)]
    return Annotated[Any, ReadBy(_one_for_both)] if record_field.field.one_for_all else None


def _part(element: Any, part: Part) -> Any:
    if part.names:
        return _elements_table(part.names)
    value = _limited(element, above=part.above)
    return value if part.size == 1 else _list_of(value, part.size)


def _value(kind: Any, field: Field) -> Any:
    """Return the type of a value as it is checked: a table, a list of any or of a certain length, or itself."""
    items = get_args(kind) if get_origin(kind) is tuple else ()
    if field.names:
        return _elements_table(field.names)
    if is_dataclass(kind) and isinstance(kind, type):
        return table_of(kind)
    if items[1:] == (...,):
        return _list_of(_value(items[0], field), None)
    if items:
        return _list_of(_value(items[0], field), len(items))
    return _limited(kind, above=field.above, least=field.least, most=field.most)


def _elements_table(names: Sequence[str]) -> type[CheckedTable]:
    return _table_class("ElementsTable", dict.fromkeys(names, (float, 0.0)))


def _list_of(item: Any, length: int | None) -> Any:
    return list[item] if length is None else Annotated[list[item], Limits(shortest=length, longest=length)]


def _limited(kind: Any, above: float | None = None, least: float | None = None, most: float | None = None) -> Any:
    if above is None and least is None and most is None:
        return kind
    return Annotated[kind, Limits(above, least, most)]


TABLE_OF_KIND: Mapping[str, type[CheckedTable]] = {kind: table_of(record) for kind, record in RECORD_TYPES.items()}
"""The table of orip.toml by kind of record."""
