"""A wrong value or key of orip.toml described in a sentence: what was found, what is allowed, what to write."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from orip.files.project.tables import example_of, keys_of
from orip.files.text.shown import shown_token

Fault = tuple[tuple[str | int, ...], str]
"""Where in the text (keys and indices), and the message."""

_ALLOWED: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "string_type": lambda _: "a text in quotes",
    "float_type": lambda _: "a number",
    "int_type": lambda _: "a whole number",
    "int_from_float": lambda _: "a whole number",
    "list_type": lambda _: "a list in brackets",
    "model_type": lambda _: "a table in braces",
    "finite_number": lambda _: "a finite number",
    "literal_error": lambda limits: str(limits["expected"]),
    "greater_than": lambda limits: f"a number above {limits['gt']:g}",
    "greater_than_equal": lambda limits: f"a number of at least {limits['ge']:g}",
    "less_than_equal": lambda limits: f"a number of at most {limits['le']:g}",
    "too_short": lambda limits: f"a list of {limits['min_length']} elements",
    "too_long": lambda limits: f"a list of {limits['max_length']} elements",
    "string_too_short": lambda _: "a text that is not empty",
    "string_too_long": lambda limits: f"a text of at most {limits['max_length']} characters",
}
"""What is allowed, by pydantic's name of the fault and its limits."""

_MOST_COMPARED = 500
"""With more names than that no nearest one is looked for: thousands of wrong names would take minutes."""


def table_faults(error: ValidationError, table: type[BaseModel], title: str, place: Sequence[str | int]) -> list[Fault]:
    """Return a sentence for each thing that pydantic found wrong in one table.

    Parameters
    ----------
    error : ValidationError
    table : type of BaseModel
        The keys that were allowed.
    title : str
        The record as messages call it, e.g. ``camera 'OLYMPUS'``.
    place : sequence of str or int
        Keys and indices that lead to the table.
    """
    details = error.errors(include_url=False)
    return [((*place, *detail["loc"]), _sentence(detail, table, title)) for detail in details]


def unknown_key(key: str, title: str, allowed: Sequence[str]) -> str:
    """Return what to say of a key that does not exist; the nearest known one is named."""
    shown = shown_token(key)
    near = _nearest(key, allowed)
    guess = f"did you mean '{near}'? " if near else ""
    return f"{title} has the unknown key '{shown}'; {guess}Allowed: {', '.join(allowed)}"


def unknown_name(name: str, kind: str, where: str, known: Sequence[str]) -> str:
    """Return what to say of a name that no record has; the nearest known one is named."""
    near = _nearest(name, known)
    remedy = f"did you mean '{near}'?" if near else f"define a [[{kind}]] of that name or correct it"
    return f"{where} names {kind} '{shown_token(name)}', which is not defined; {remedy}"


def _nearest(word: str, known: Sequence[str]) -> str | None:
    if len(known) > _MOST_COMPARED:
        return None
    by_upper = {candidate.upper(): candidate for candidate in known}
    near = difflib.get_close_matches(word.upper()[:100], list(by_upper), 1)
    return by_upper[near[0]] if near else None


def _sentence(detail: ErrorDetails, table: type[BaseModel], title: str) -> str:
    if not detail["loc"]:
        return f"{title} is {_found(detail)}, but a table is required; write its keys below a header in brackets"
    *around, last = detail["loc"]
    innermost = _inner_table(table, around)
    where = " of ".join([*_places(around), title])
    if detail["type"] == "extra_forbidden":
        return unknown_key(str(last), where, keys_of(innermost) if innermost else [])
    if detail["type"] == "missing":
        example = example_of(innermost, str(last)) if innermost else None
        return f"{where} has no {last}; it is required, write for example {last} = {example}"
    key = next((str(part) for part in reversed(detail["loc"]) if isinstance(part, str)), "")
    holder = _inner_table(table, detail["loc"][: _last_key(detail["loc"])])
    example = example_of(holder, key) if holder else None
    remedy = f"write for example {key} = {example or 0.0}"
    what = " of ".join([*_places(detail["loc"]), title])
    return f"{what} is {_found(detail)}, but {_allowed(detail)}; {remedy}"


def _last_key(location: Sequence[str | int]) -> int:
    return max((index for index, part in enumerate(location) if isinstance(part, str)), default=0)


def _allowed(detail: ErrorDetails) -> str:
    limits = detail.get("ctx", {})
    if detail["type"] == "value_error":
        return str(limits["error"])
    phrase = _ALLOWED.get(detail["type"])
    return f"{phrase(limits)} is required" if phrase else detail["msg"]


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


def _found(detail: ErrorDetails) -> str:
    value = detail["input"]
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


def _inner_table(table: type[BaseModel], location: Sequence[str | int]) -> type[BaseModel] | None:
    """Follow keys into nested tables; None where a key is not that of a known table."""
    current: type[BaseModel] | None = table
    for part in location:
        if isinstance(part, int) or current is None:
            continue
        info = current.model_fields.get(part)
        current = _table_in(info.annotation) if info else None
    return current


def _table_in(annotation: Any) -> type[BaseModel] | None:
    """Find the table in an annotation such as ``SensorTable | None`` or ``list[MarkTable]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in get_args(annotation):
        found = _table_in(part)
        if found is not None:
            return found
    return None
