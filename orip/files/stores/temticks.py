"""The store of temticks (.TIK): given tick marks of kinds of templates."""

from __future__ import annotations

from collections.abc import Iterable

from orip.files.stores.definitions import Definitions, Parts, StoredRecord, definition_table
from orip.files.stores.marks import given_marks_table, mark_rows, marks_of
from orip.files.stores.store import Store
from orip.records.photo import Temtick

TEMTICK = definition_table("temtick", ())
TICK = given_marks_table("tick", "temtick")
TABLES = (TEMTICK, TICK)


def read(store: Store) -> tuple[StoredRecord[Temtick], ...]:
    """Return all temticks in their order."""
    return _TEMTICKS.read(store)


def write(store: Store, stored: Iterable[StoredRecord[Temtick]]) -> None:
    """Replace all temticks."""
    _TEMTICKS.write(store, stored)


def _apart(temtick: Temtick) -> Parts:
    return Parts((), (mark_rows(temtick.ticks),))


def _together(name: str, parts: Parts) -> Temtick:
    return Temtick(name, marks_of(parts.lists[0]))


_TEMTICKS = Definitions(TEMTICK, (TICK,), _apart, _together)
