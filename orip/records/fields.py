"""The properties of each field of a record: its key, its limits, its unit, its heading.

A record is declared once, as a structure whose annotations carry a `Field`. The columns of its store, the keys of its
table in orip.toml with their types and limits, and the headings and units of lists of records all follow from that: a
new setting is one new line of the structure, and its use.
"""

from __future__ import annotations

import types
from collections.abc import Iterator
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from msgspec import Struct, StructMeta

TextKind = Literal["any", "line", "date"]
"""A text, one that can be printed on a line, or a date or such a text."""

GROUND_UNIT = "ground unit"
"""In place of a unit: that of the project."""


class Part(Struct, frozen=True, kw_only=True):
    """A key of orip.toml that holds some elements of a field which is spread over several keys.

    Parameters
    ----------
    size : int
        Number of elements; 1: the value itself, more: a list.
    names : tuple of str
        Keys of the elements in a table of their own, in place of a list.
    units : tuple of str
        One for all elements, or one for each.
    """

    key: str
    size: int = 1
    names: tuple[str, ...] = ()
    example: str = ""
    heading: str = ""
    units: tuple[str, ...] = ("",)
    above: float | None = None
    default: float | None = None
    required: bool = False


class Field(Struct, frozen=True, kw_only=True):
    """What a field is called, how its value is written, and what it may be.

    Parameters
    ----------
    key : str
        Key of orip.toml; that of the attribute if empty.
    example : str
        A value as orip.toml has it, for messages.
    heading : str
        Heading in lists of records; without one it is not listed.
    units : tuple of str
        One, or with `names` one for each; `GROUND_UNIT` for that of the project.
    above, least, most : float or None
        Limits: greater than, at least, at most.
    shortest, longest : int or None
        Limits of the number of characters.
    text : {"any", "line", "date"}
        What a text may be.
    names_record : bool
        The name of a record: case does not count.
    names : tuple of str
        Keys of the elements of a tuple, which is a table in orip.toml.
    one_for_all : bool
        A single number may stand for all elements of a tuple.
    own_records : bool
        The items are records of their own, with headers of their own in orip.toml.
    parts : tuple of Part
        The field is spread over several keys.
    column : str
        What the names of its columns in the store begin with; the attribute if empty.
    elements : tuple of str
        What the names of the columns of a tuple end with; the names themselves if the field has parts.
    key_after, column_after : str
        Attribute after which it comes in orip.toml or in the store. Attributes themselves cannot change their order:
        digests of records depend on it.
    """

    key: str = ""
    example: str = ""
    heading: str = ""
    units: tuple[str, ...] = ("",)
    above: float | None = None
    least: float | None = None
    most: float | None = None
    shortest: int = 0
    longest: int | None = None
    text: TextKind = "any"
    names_record: bool = False
    names: tuple[str, ...] = ()
    one_for_all: bool = False
    own_records: bool = False
    parts: tuple[Part, ...] = ()
    column: str = ""
    elements: tuple[str, ...] = ()
    key_after: str = ""
    column_after: str = ""


class RecordField(Struct, frozen=True):
    """A field of a record.

    Parameters
    ----------
    name : str
        The attribute.
    type : type
        Its type where it is given.
    optional : bool
        It may be None.
    required : bool
        It has no default.
    """

    name: str
    type: Any
    optional: bool
    required: bool
    field: Field

    @property
    def key(self) -> str:
        """Return the key of orip.toml."""
        return self.field.key or self.name

    @property
    def item(self) -> Any:
        """Return the type of the items of a list of any length; None if it is no such list."""
        args = get_args(self.type)
        return args[0] if get_origin(self.type) is tuple and args[1:] == (...,) and not self.field.parts else None


@cache
def fields_of(record: StructMeta) -> tuple[RecordField, ...]:
    """Return the fields of a record in the order of its attributes."""
    hints = get_type_hints(record, include_extras=True)
    optional = record.__struct_fields__[len(record.__struct_fields__) - len(record.__struct_defaults__) :]
    return tuple(_field(name, hints[name], required=name not in optional) for name in record.__struct_fields__)


def fields_by_key(record: type) -> tuple[RecordField, ...]:
    """Return the fields of a record in the order of orip.toml."""
    return _in_order(
        fields_of(record), {record_field.name: record_field.field.key_after for record_field in fields_of(record)}
    )


def fields_by_column(record: type) -> tuple[RecordField, ...]:
    """Return the fields of a record in the order of its store's columns."""
    return _in_order(
        fields_of(record), {record_field.name: record_field.field.column_after for record_field in fields_of(record)}
    )


def headings_of(record: type) -> Iterator[tuple[str, str, bool]]:
    """Yield heading and key of what is listed of a record, and whether a list of records is shown as its number."""
    for record_field in fields_by_key(record):
        for listed in record_field.field.parts or (record_field.field,):
            if listed.heading:
                yield listed.heading, listed.key or record_field.name, isinstance(record_field.item, StructMeta)


def units_of(record: type) -> Iterator[tuple[str, str]]:
    """Yield the keys of a record's values with their units; those in a table in it as ``sensor.columns``."""
    for record_field in fields_of(record):
        for part in record_field.field.parts or (
            Part(key=record_field.key, names=record_field.field.names, units=record_field.field.units),
        ):
            units = part.units * (len(part.names) or 1) if len(part.units) == 1 else part.units
            paths = [f"{part.key}.{name}" for name in part.names] or [part.key]
            yield from zip(paths, units, strict=True)
        inner = record_field.item or record_field.type
        if isinstance(inner, StructMeta):
            between = ".*" if record_field.item else ""
            yield from ((f"{record_field.key}{between}.{path}", unit) for path, unit in units_of(inner))


def without_none(hint: Any) -> Any:
    """Return the type of an optional value where it is given; any other type as it is."""
    if get_origin(hint) in {Union, types.UnionType}:
        (hint,) = (part for part in get_args(hint) if part is not type(None))
    return hint


def _field(name: str, hint: Any, *, required: bool) -> RecordField:
    field = Field()
    if get_origin(hint) is Annotated:
        hint, field = get_args(hint)
    kind = without_none(hint)
    return RecordField(name, kind, kind is not hint, required, field)


def _in_order(fields: tuple[RecordField, ...], after: dict[str, str]) -> tuple[RecordField, ...]:
    ordered = [record_field for record_field in fields if not after[record_field.name]]
    for record_field in fields:
        if after[record_field.name]:
            place = next(index for index, other in enumerate(ordered) if other.name == after[record_field.name])
            ordered.insert(place + 1, record_field)
    return tuple(ordered)
