"""A wrong value or key of orip.toml described in a sentence: what was found, what is allowed, what to write."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import Any, get_args

from orip.files.project.checked_table import MISSING, UNKNOWN, CheckedTable, ValueFault, keys_of
from orip.files.text.shown import shown_token

Fault = tuple[tuple[str | int, ...], str]
"""Where in the text (keys and indices), and the message."""

_MOST_COMPARED = 500
"""With more names than that no nearest one is looked for: thousands of wrong names would take minutes."""


def table_faults(
    faults: Sequence[ValueFault], table: type[CheckedTable], title: str, place: Sequence[str | int]
) -> list[Fault]:
    """Return a sentence for each thing that is wrong in one table.

    Parameters
    ----------
    faults : sequence of ValueFault
    table : type of CheckedTable
        The keys that were allowed.
    title : str
        The record as messages call it, e.g. ``camera 'OLYMPUS'``.
    place : sequence of str or int
        Keys and indices that lead to the table.
    """
    return [((*place, *fault.place), _sentence(fault, table, title)) for fault in faults]


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


def _sentence(fault: ValueFault, table: type[CheckedTable], title: str) -> str:
    if not fault.place:
        return f"{title} is {_found(fault.found)}, but a table is required; write its keys below a header in brackets"
    *around, last = fault.place
    innermost = _inner_table(table, around)
    where = " of ".join([*_places(around), title])
    if fault.allowed == UNKNOWN:
        return unknown_key(str(last), where, list(keys_of(innermost)) if innermost else [])
    if fault.allowed == MISSING:
        return f"{where} has no {last}; it is required, write for example {last} = {_example(innermost, str(last))}"
    key = next((str(part) for part in reversed(fault.place) if isinstance(part, str)), "")
    holder = _inner_table(table, fault.place[: _last_key(fault.place)])
    remedy = f"write for example {key} = {_example(holder, key) or 0.0}"
    what = " of ".join([*_places(fault.place), title])
    return f"{what} is {_found(fault.found)}, but {fault.allowed}; {remedy}"


def _example(table: type[CheckedTable] | None, key: str) -> str | None:
    """Return how the value of a key may be written."""
    found = keys_of(table).get(key) if table else None
    return None if found is None else found.example


def _last_key(location: Sequence[str | int]) -> int:
    return max((index for index, part in enumerate(location) if isinstance(part, str)), default=0)


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


def _inner_table(table: type[CheckedTable], location: Sequence[str | int]) -> type[CheckedTable] | None:
    """Follow keys into nested tables; None where a key is not that of a known table."""
    current: type[CheckedTable] | None = table
    for part in location:
        if isinstance(part, int) or current is None:
            continue
        found = keys_of(current).get(part)
        current = _table_in(found.annotation) if found else None
    return current


def _table_in(annotation: Any) -> type[CheckedTable] | None:
    """Find the table in an annotation such as ``SensorTable | None`` or ``list[MarkTable]``."""
    if isinstance(annotation, type) and issubclass(annotation, CheckedTable):
        return annotation
    for part in get_args(annotation):
        found = _table_in(part)
        if found is not None:
            return found
    return None
