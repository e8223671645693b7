"""Records as tables of orip.toml and back, TOML as orip writes it, and a record as words of a command line."""

from __future__ import annotations

import copy
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar, cast, get_args

from msgspec import Struct

from orip.files.project.forms import Choice, Form, ListOf, Number, Table, Text
from orip.files.project.tables import keys_of, table_of, unknown_key
from orip.files.project.toml_lines import toml_document
from orip.files.text.shown import printable, shown_token
from orip.records.definition import RECORD_TYPES, Precision
from orip.records.fields import Part, RecordField, fields_by_key, fields_of

TomlTable: TypeAlias = dict[str, Any]
"""A table as the TOML reader gives it; keys without a value are missing."""

T = TypeVar("T")


def record_of(record: type[T], table: Mapping[str, Any]) -> T:
    """Return the record that a table says, as its form has read it; a key that is missing has the record's default."""
    given, kind = {}, cast(type, record)
    for record_field in fields_of(kind):
        if record_field.field.parts:
            values = (value for part in record_field.field.parts for value in _elements(part, table))
            # a camera with the lens of another one has no principal distance of its own: not a number
            optional = float not in get_args(record_field.type)
            given[record_field.name] = tuple(math.nan if value is None and not optional else value for value in values)
        elif record_field.key in table:
            given[record_field.name] = _value(record_field, table[record_field.key])
    return record(**given)


def _elements(part: Part, table: Mapping[str, Any]) -> Sequence[Any]:
    value = table.get(part.key)
    if part.names:
        return [(value or {}).get(name, 0.0) for name in part.names]
    if part.size > 1:
        return (0.0,) * part.size if value is None else value
    return (part.default if value is None else value,)


def _value(record_field: RecordField, value: Any) -> Any:
    if record_field.field.names:
        return tuple(value.get(name, 0.0) for name in record_field.field.names)
    return _converted(record_field.item or record_field.type, value)


def _converted(kind: Any, value: Any) -> Any:
    """Return a checked value as records hold it: tuples in place of lists, structures in place of tables."""
    if isinstance(value, dict):
        return record_of(kind, value)
    if isinstance(value, list):
        return tuple(_converted(kind, item) for item in value)
    return value


def toml_of(record: Any) -> TomlTable:
    """Return a record as a table of orip.toml; what is None or an empty list has no key."""
    return {
        key: value
        for record_field in fields_by_key(type(record))
        for key, value in _keys_of(record_field, getattr(record, record_field.name))
        if value is not None and value not in ([], {})
    }


def _keys_of(record_field: RecordField, value: Any) -> Iterator[tuple[str, Any]]:
    if not record_field.field.parts:
        named = record_field.field.names and value is not None
        yield record_field.key, dict(zip(record_field.field.names, value, strict=True)) if named else _plain(value)
    first = 0
    for part in record_field.field.parts:
        elements = value[first : first + part.size]
        first += part.size
        if part.names:
            yield part.key, {name: element for name, element in zip(part.names, elements, strict=True) if element}
        else:
            given = elements[0] if part.size == 1 else list(elements)
            yield part.key, None if given == part.default else given


def _plain(value: Any) -> Any:
    """Return a value of a record as TOML has it."""
    if isinstance(value, Precision):
        return value.value if value.unit == "mm" else f"{value.value}px"
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return toml_of(value) if isinstance(value, Struct) else value


_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_WIDEST = 100
"""A list that takes more columns than that is written one item a line."""


def toml_value(value: Any) -> str:
    """Return a value on one line; numbers with as few digits as give the same one back."""
    if isinstance(value, str):
        # JSON's escapes are TOML's; one character more may not stand as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_assignments(value)) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return str(value)  # numbers, dates and times


def toml_table(header: str, table: Mapping[str, Any]) -> str:
    """Return a table with its header (brackets included) and a line for each key."""
    return "\n".join([header, *(toml_assignment(key, value) for key, value in table.items())]) + "\n"


def toml_assignment(key: str, value: Any) -> str:
    """Return a key and its value, a long list on several lines."""
    return f"{toml_key(key)} = {_broken(value)}"


def toml_key(key: str) -> str:
    """Return a key, quoted where it has to be."""
    return key if _BARE_KEY.fullmatch(key) else toml_value(key)


def _assignments(table: Mapping[str, Any]) -> Iterator[str]:
    return (f"{toml_key(key)} = {toml_value(value)}" for key, value in table.items())


def _broken(value: Any) -> str:
    """Return a value; a list of tables, or one that is too wide, on several lines."""
    text = toml_value(value)
    if not isinstance(value, list) or (len(text) <= _WIDEST and not any(isinstance(item, dict) for item in value)):
        return text
    return "[\n" + "".join(f"    {toml_value(item)},\n" for item in value) + "]"


# A key may have parts: ``distortion.A3``, ``fiducials.3.x`` for the mark called 3, and ``distortion_curve.12.5`` for
# the point of the curve at the radius 12.5. A value is TOML, but texts need
# no quotation marks, and lists no brackets (``camera=OLYMPUS``, ``unknown=C,A3``); none at all (``stage=``) takes the
# key away.


_PAIR = ListOf(Number(), 2)


def with_assignments(kind: str, table: TomlTable, words: Iterable[str]) -> tuple[TomlTable, tuple[str, ...]]:
    """Return a record's table with values assigned, and what is wrong with the words.

    Whether the record's table knows the keys and allows the values is looked at where orip.toml is checked.
    """
    changed, faults = copy.deepcopy(table), []
    for word in words:
        key, equals, text = word.partition("=")
        fault = _word_fault(kind, key.strip(), equals)
        if fault is None:
            fault = _assign(table_of(RECORD_TYPES[kind]), changed, key.strip().split("."), text.strip())
        if fault is not None:
            faults.append(printable(f"{shown_token(word)}: {fault}"))
    return changed, tuple(faults)


def _word_fault(kind: str, key: str, equals: str) -> str | None:
    if not equals or not all(key.split(".")):
        return "this is not KEY=VALUE; write the key of orip.toml, = and the value in one word"
    if key == "name":
        return f"a name is not a value; give the record another one with 'orip {kind} rename'"
    if kind == "bundle" and key.split(".", maxsplit=1)[0] == "model":
        return "models are records of their own; change them with 'orip model'"
    return None


def _assign(known: Table, table: TomlTable, path: Sequence[str], text: str) -> str | None:
    """Assign in place; return what is wrong, or None."""
    key, *rest = path
    form = known.keys[key].form if key in known.keys else None
    if not rest:
        if not text and form is None:
            return unknown_key(key, "the record", keys_of(known))
        return _set(table, key, form, text)
    if isinstance(form, ListOf):
        return _assign_to_named(form.item, table, key, rest, text)
    if not isinstance(table.setdefault(key, {}), dict):
        return f"{key} has no parts"
    return _assign(form if isinstance(form, Table) else Table({}), table[key], rest, text)


def _assign_to_named(form: Form, table: TomlTable, key: str, rest: Sequence[str], text: str) -> str | None:
    """Assign to an element of a list of tables, which is found by its name; a new name is a new element."""
    name, *inner = rest
    if form == _PAIR:
        return _assign_to_pair(table, key, ".".join(rest), text)
    if not isinstance(form, Table):
        return f"the items of {key} have no names; write all of them in one list"
    elements: list[TomlTable] = table.setdefault(key, [])
    known = next((element for element in elements if element["name"] == name), None)
    if not text and not inner:
        if known is None:
            names = ", ".join(element["name"] for element in elements)
            return f"{key} has no item of that name; known are: {names or 'none'}"
        elements.remove(known)
        return None
    if known is None:
        known = {"name": name}
        elements.append(known)
    if inner:
        return _assign(form, known, inner, text)
    holder: TomlTable = {}
    fault = _set(holder, "value", None, text)
    if fault is None and not isinstance(holder["value"], dict):
        fault = "write the values in braces, for example '{x=-12.0, y=18.0}'"
    known.update(holder["value"] if fault is None else {})
    return fault


def _assign_to_pair(table: TomlTable, key: str, at: str, text: str) -> str | None:
    """Assign the second number of the pair whose first one is `at`; a new pair comes where it is in their order."""
    place, value = _toml(at), _toml(text)
    numbers = [one for one in (place, value) if isinstance(one, int | float) and not isinstance(one, bool)]
    if len(numbers) < (2 if text else 1):
        return f"the items of {key} are pairs of numbers; write {key}.FIRST=SECOND, or {key}.FIRST= to remove one"
    pairs: list[list[float]] = [pair for pair in table.get(key) or [] if pair[0] != numbers[0]]
    if not text and len(pairs) == len(table.get(key) or []):
        known = ", ".join(f"{pair[0]:g}" for pair in pairs)
        return f"{key} has no pair that begins with {at}; known are: {known or 'none'}"
    pairs += [[float(number) for number in numbers]] if text else []
    table[key] = sorted(pairs)
    if not pairs:
        del table[key]
    return None


def _set(table: TomlTable, key: str, form: Form | None, text: str) -> str | None:
    if not text:
        table.pop(key, None)
        return None
    value = _toml(text)
    if value is None and isinstance(form, ListOf):
        value = _toml(f"[{text}]")
    if isinstance(form, Text | Choice):
        value = value if isinstance(value, str) else text
    elif isinstance(form, ListOf) and isinstance(form.item, Text | Choice):
        value = value if _is_texts(value) else _words(text)
    elif value is None and text[0] in "[{\"'":
        return "this is not TOML; check brackets and quotation marks, and keep the shell from removing them: '...'"
    elif value is None:
        value = text
    table[key] = value
    return None


def _toml(text: str) -> Any:
    """Return the value of a text that is TOML, None for any other text."""
    try:
        document = toml_document(f"value = {text}")
    except ValueError:
        return None
    return document["value"] if len(document) == 1 else None


def _is_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)


def _words(text: str) -> list[str]:
    """Return ``[C, "A3"]`` or ``C,A3`` as words, whichever brackets and quotation marks a shell has removed."""
    return list(filter(None, (word.strip().strip("\"'") for word in text.strip("[]").split(","))))
