"""The store of temticks (.TIK): given tick marks of kinds of templates."""

from __future__ import annotations

from collections.abc import Iterable

from orip.files.stores.contents.definitions import DefinitionTables, StoredRecord, definition_table, record_list
from orip.files.stores.store import Store
from orip.records.camera import Mark
from orip.records.photo import Temtick

TEMTICK = definition_table("temtick", Temtick)
TICK = record_list("tick", "temtick", Mark)
TABLES = (TEMTICK, TICK)

_TEMTICKS = DefinitionTables(Temtick, TEMTICK, {"ticks": TICK})


def read(store: Store) -> tuple[StoredRecord[Temtick], ...]:
    """Return all temticks in their order."""
    return _TEMTICKS.read(store)


def write(store: Store, stored: Iterable[StoredRecord[Temtick]]) -> None:
    """Replace all temticks."""
    _TEMTICKS.write(store, stored)
