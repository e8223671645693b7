"""A wrong value or key of orip.toml described in a sentence: what was found, what is allowed, what to write."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from typing import Any

from orip.files.project.forms import Finding, Place, Table, UnknownKey, WrongValue
from orip.files.project.tables import example_of, keys_of
from orip.files.text.shown import shown_token

Fault = tuple[tuple[str | int, ...], str]
"""Where in the text (keys and indices), and the message."""

_MOST_COMPARED = 500
"""With more names than that no nearest one is looked for: thousands of wrong names would take minutes."""


def table_faults(findings: Sequence[Finding], table: Table, title: str, place: Place) -> Iterator[Fault]:
    """Yield a sentence for each thing that was found wrong in one table.

    Parameters
    ----------
    findings : sequence of Finding
    table : Table
        The keys that were allowed.
    title : str
        The record as messages call it, e.g. ``camera 'OLYMPUS'``.
    place : tuple of str or int
        Keys and indices that lead to the table.
    """
    for finding in findings:
        yield (*place, *finding.place), _sentence(finding, table, title)


def unknown_key(key: str, title: str, allowed: Sequence[str]) -> str:
    """Return what to say of a key that does not exist; the nearest known one is named."""
    shown = shown_token(key)
    near = _nearest(key, allowed)
    return f"{title} has the unknown key '{shown}'; {instead(near, allowed)}"


def instead(near: str | None, allowed: Sequence[str]) -> str:
    """Return what to write instead of a word that is not known: the nearest known one, if there is one, and all."""
    words = ", ".join(allowed)
    return f"did you mean '{near}'? Allowed: {words}" if near else f"allowed: {words}"


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
    return f"{what} is {_found(finding.found)}, but {finding.allowed}; write for example {key} = {example or 0.0}"


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
