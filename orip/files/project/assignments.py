"""Values for a record as words of a command line: ``KEY=VALUE`` with the keys and values of orip.toml.

A key may have parts: ``distortion.A3``, and ``fiducials.3.x`` for the mark called 3. A value is TOML, but texts need no
quotation marks, and lists no brackets (``camera=OLYMPUS``, ``unknown=C,A3``); none at all (``stage=``) takes the key
away.
"""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel

from orip.files.project.record_values import TomlTable
from orip.files.project.tables import CheckedTable, keys_of, table_of
from orip.files.project.toml_faults import unknown_key
from orip.files.text.shown import printable, shown_token
from orip.records.project.definition import RECORD_TYPES


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


def _assign(form: type[BaseModel], table: TomlTable, path: Sequence[str], text: str) -> str | None:
    """Assign in place; return what is wrong, or None."""
    key, *rest = path
    annotation = _annotation(form, key)
    if not rest:
        if not text and annotation is None:
            return unknown_key(key, "the record", keys_of(form))
        return _set(table, key, annotation, text)
    inner = _table_in(annotation) or CheckedTable
    if get_origin(_without_none(annotation)) is list:
        return _assign_to_named(inner, table, key, rest, text)
    if not isinstance(table.setdefault(key, {}), dict):
        return f"{key} has no parts"
    return _assign(inner, table[key], rest, text)


def _assign_to_named(form: type[BaseModel], table: TomlTable, key: str, rest: Sequence[str], text: str) -> str | None:
    """Assign to an element of a list of tables, which is found by its name; a new name is a new element."""
    name, *inner = rest
    if form is CheckedTable:
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


def _set(table: TomlTable, key: str, annotation: Any, text: str) -> str | None:
    if not text:
        table.pop(key, None)
        return None
    wanted = _without_none(annotation)
    value = _toml(text)
    if value is None and get_origin(wanted) is list:
        value = _toml(f"[{text}]")
    if _is_text(wanted):
        value = value if isinstance(value, str) else text
    elif get_origin(wanted) is list and _is_text(_without_none(get_args(wanted)[0])):
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
        document = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return None
    return document["value"] if len(document) == 1 else None


def _is_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)


def _words(text: str) -> list[str]:
    """Return ``[C, "A3"]`` or ``C,A3`` as words, whichever brackets and quotation marks a shell has removed."""
    return list(filter(None, (word.strip().strip("\"'") for word in text.strip("[]").split(","))))


def _annotation(form: type[BaseModel], key: str) -> Any:
    return info.annotation if (info := form.model_fields.get(key)) is not None else None


def _without_none(annotation: Any) -> Any:
    """Return the type of an optional value without None and without its limits."""
    origin = get_origin(annotation)
    if origin is None or origin in {list, Literal}:
        return annotation
    if origin is Annotated:
        return _without_none(get_args(annotation)[0])
    return next((_without_none(part) for part in get_args(annotation) if part is not type(None)), annotation)


def _is_text(annotation: Any) -> bool:
    return annotation is str or get_origin(annotation) is Literal


def _table_in(annotation: Any) -> type[BaseModel] | None:
    return next(_tables(annotation), None)


def _tables(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _tables(part)
