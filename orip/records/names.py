"""Names: record names ignore case, point and mark names do not."""

from __future__ import annotations

import difflib
import re
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from orip.wording import listed_names

RESERVED_NAMES = frozenset({"-", "="})
COMMENT_MARKS = ("!", "#")


def name_fault(name: str) -> str | None:
    """Say what is wrong with a name of any kind, or return None if it is fit for use."""
    if not name:
        return "an empty name"
    if any(character.isspace() for character in name):
        shown = f"'{name}'" if name.isprintable() else repr(name)
        return f"{shown} has a blank; names are one word"
    if not name.isprintable():
        return f"{name!r} has a character that cannot be printed"
    if name in RESERVED_NAMES or name.startswith(COMMENT_MARKS):
        return f"'{name}' is not allowed as a name ('-' and '=' are reserved, '!' and '#' start a comment)"
    return None


def record_key(name: str) -> str:
    """Return the form in which names of records (cameras, photos, ...) are compared: case does not count."""
    return name.upper()


def case_twins(names: Iterable[str]) -> list[tuple[str, str]]:
    """Return pairs of different names that are the same when case is ignored."""
    seen: dict[str, str] = {}
    twins = []
    for name in dict.fromkeys(names):
        first = seen.setdefault(record_key(name), name)
        if first != name:
            twins.append((first, name))
    return twins


_remembered: deque[tuple[tuple[str, ...], Mapping[str, int]]] = deque(maxlen=8)


def places_of_names(names: tuple[str, ...]) -> Mapping[str, int]:
    """Return the place of each name; remembered, as everything asks for that of a block's points."""
    for known, places in tuple(_remembered):
        if known is names:  # a dictionary of such keys would go through a million names at every question
            return places
    places = MappingProxyType(dict(zip(names, range(len(names)), strict=True)))
    _remembered.append((names, places))
    return places


def look_alikes(names: Iterable[str]) -> list[tuple[str, ...]]:
    """Return groups of different point names that differ only in case or leading zeros."""
    names = tuple(names)
    text = "\n".join(("", *names))
    if text.upper() == text and "\n0" not in text:  # often, and blocks have a million names
        return []
    distinct = tuple(dict.fromkeys(names))
    keys = _without_case_and_zeros(distinct)
    if len(set(keys)) == len(keys):
        return []
    groups: dict[str, list[str]] = defaultdict(list)
    for name, key in zip(distinct, keys, strict=True):
        groups[key].append(name)
    return [tuple(group) for group in groups.values() if len(group) > 1]


def _without_case_and_zeros(names: Sequence[str]) -> list[str]:
    text = "\n".join(names).upper()  # names are one word; one call for all is several times faster
    return re.sub("^0+", "", text, flags=re.MULTILINE).split("\n")


def near_names(name: str, known: Iterable[str]) -> str:
    """Return the names most like one that is not known, for a message; the first of all names where none is alike."""
    by_key = {record_key(record): record for record in known}
    stem, _, ending = name.rpartition(".")
    if (meant := by_key.get(record_key(stem))) is not None:
        return f"did you mean {meant}, without .{ending}?"
    near = set(difflib.get_close_matches(record_key(name), by_key, 4))
    if near:
        return f"did you mean {' or '.join(record for key, record in by_key.items() if key in near)}?"
    return f"known are: {listed_names(by_key.values())}"
