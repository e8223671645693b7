"""The tables and keys of orip.toml as the text has them: types, limits and defaults.

Those of the records follow from the fields of the records. Each key carries an example; messages about a wrong value
show it. What concerns several records together is looked at in `checks`.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date, datetime
from functools import cache
from typing import Annotated, Any, TypeAlias, get_args, get_origin

from msgspec import StructMeta
from pydantic import AfterValidator, BaseModel, ConfigDict, PlainValidator, create_model
from pydantic import Field as Limits

from orip.files.text.decimal_numbers import parse_photo_error
from orip.records.observations.a_priori_error import PHOTO_ERRORS, PIXEL_ERRORS
from orip.records.project.definition import Precision
from orip.records.project.fields import Field, Part, RecordField, fields_by_key, without_none

ShortText: TypeAlias = Annotated[str, Limits(max_length=20)]
FilledText: TypeAlias = Annotated[str, Limits(min_length=1)]

SECTIONS = ("project", "check", "report", "camera", "temtick", "template", "photo", "antenna", "bundle")
"""Tables of orip.toml; all but the first three may come several times."""


class CheckedTable(BaseModel):
    """A TOML table: no unknown keys, no conversion of types, no NaN."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True, defer_build=True)


class ProjectTable(CheckedTable):
    """``[project]``."""

    name: Annotated[str, Limits(min_length=1, max_length=20, examples=['"ZURICH"'])]
    user: Annotated[ShortText, Limits(examples=['"K. Dueholm"'])] = ""
    camera_file: Annotated[FilledText, Limits(examples=['"CAMERAS.CAM"'])] = "CAMERAS.CAM"
    temtick_file: Annotated[FilledText, Limits(examples=['"TEMTICKS.TIK"'])] = "TEMTICKS.TIK"
    project_files: Annotated[str | None, Limits(examples=['"ZURICH"'])] = None
    control_files: Annotated[str | None, Limits(examples=['"ZURICH"'])] = None
    measurement_files: Annotated[list[FilledText], Limits(examples=['["*.MEA"]'])] = ["*.MEA"]
    output_folder: Annotated[str | None, Limits(examples=['"results"'])] = None
    ground_unit: Annotated[FilledText, Limits(examples=['"m"'])] = "m"
    crs: Annotated[str | None, Limits(min_length=1, examples=['"EPSG:2056"'])] = None


class CheckTable(CheckedTable):
    """``[check]``."""

    gates: Annotated[list[FilledText], Limits(examples=['["sigma0<=1.5"]'])] = []
    test_level: Annotated[float | None, Limits(ge=1e-9, le=0.5, examples=["0.001"])] = None


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


OneLine: TypeAlias = Annotated[str, AfterValidator(_printable)]
Day: TypeAlias = Annotated[Any, PlainValidator(_day)]


class ReportTable(CheckedTable):
    """``[report]``."""

    title: Annotated[OneLine, Limits(examples=['"Quarry Hohenfels, flight 3"'])] = ""
    client: Annotated[OneLine, Limits(examples=['"Kalkwerk Hohenfels GmbH"'])] = ""
    contractor: Annotated[OneLine, Limits(examples=['"Vermessung Huber"'])] = ""
    author: Annotated[OneLine, Limits(examples=['"K. Huber"'])] = ""
    order: Annotated[OneLine, Limits(examples=['"2026-117"'])] = ""
    location: Annotated[OneLine, Limits(examples=['"Hohenfels"'])] = ""
    flown: Annotated[Day, Limits(examples=["2026-04-28"])] = ""
    date: Annotated[Day, Limits(examples=["2026-05-04"])] = ""
    equipment: Annotated[OneLine, Limits(examples=['"DJI M3E, RTK by SAPOS"'])] = ""
    remarks: Annotated[list[OneLine], Limits(examples=['["Signalled points were set out by the client."]'])] = []


def example_of(table: type[BaseModel], key: str) -> str | None:
    """Return how the value of a key may be written."""
    info = table.model_fields.get(key)
    return str(info.examples[0]) if info is not None and info.examples else None


def keys_of(table: type[BaseModel]) -> list[str]:
    """Return the keys that a table may have, in their order."""
    return list(table.model_fields)


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
    return create_model(f"{record.__name__}Table", __base__=CheckedTable, **keys)


def _key(annotation: Any, field: Field | Part, *, required: bool) -> Any:
    examples = [field.example] if field.example else None
    return Annotated[annotation, Limits(examples=examples)], ... if required else None


def _read_by(record_field: RecordField) -> Any:
    """Return the type of a value that may be written in several forms; None for all others."""
    if record_field.type is Precision:
        return Annotated[Any, PlainValidator(_precision)]
    return Annotated[Any, PlainValidator(_one_for_both)] if record_field.field.one_for_all else None


def _part(element: Any, part: Part) -> Any:
    if part.names:
        return _elements_table(part.names)
    value = _limited(element, above=part.above)
    return value if part.size == 1 else _list_of(value, part.size)


def _value(kind: Any, field: Field) -> Any:
    """Return the type of a value as pydantic checks it: a table, a list of any or of a certain length, or itself."""
    items = get_args(kind) if get_origin(kind) is tuple else ()
    if field.names:
        return _elements_table(field.names)
    if isinstance(kind, StructMeta):
        return table_of(kind)
    if items[1:] == (...,):
        return _list_of(_value(items[0], field), None)
    if items:
        return _list_of(_value(items[0], field), len(items))
    return _limited(kind, above=field.above, least=field.least, most=field.most)


def _elements_table(names: Sequence[str]) -> type[CheckedTable]:
    elements: dict[str, Any] = dict.fromkeys(names, (float, 0.0))
    return create_model("ElementsTable", __base__=CheckedTable, **elements)


def _list_of(item: Any, length: int | None) -> Any:
    return list[item] if length is None else Annotated[list[item], Limits(min_length=length, max_length=length)]


def _limited(kind: Any, above: float | None = None, least: float | None = None, most: float | None = None) -> Any:
    if above is None and least is None and most is None:
        return kind
    return Annotated[kind, Limits(gt=above, ge=least, le=most)]
