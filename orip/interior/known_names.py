"""How messages name what is known when a name is not."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from orip.records.names import record_key
from orip.wording import listed_names


def unknown_record(what: str, name: str, known: Iterable[str]) -> str:
    """Say that a record is not defined, and which are."""
    return (
        f"{what} {name} is not defined; known are: {listed_names(known)}; correct the name, or define it in orip.toml "
        "and run 'orip init'"
    )


def near_names(name: str, known: Iterable[str]) -> str:
    """Return the names most like one that is not known, for a message; the first of all names where none is alike."""
    by_key = {record_key(each): each for each in known}
    near = set(difflib.get_close_matches(record_key(name), by_key, 4))
    if near:
        return f"did you mean {' or '.join(each for key, each in by_key.items() if key in near)}?"
    return f"known are: {listed_names(by_key.values())}"
