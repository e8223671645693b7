"""Canonical text back into a store: checked as a whole first, then put in place of what the store holds."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

from orip.files.stores.contents import exterior
from orip.files.stores.digest import set_run
from orip.files.stores.dump import dumped_tables, read_dump
from orip.files.stores.identity import create, kind_of
from orip.files.stores.store import Store
from orip.files.stores.transaction import connected, writing
from orip.structs import replace


def load(lines: Iterable[str], path: Path, *, source: str = "dump", timeout: float = 10.0) -> None:
    """Replace the content of a store by that of a dump, in one transaction.

    Parameters
    ----------
    lines : iterable of str
        As `dump` gives them, with or without line ends.
    path : Path
        The store; made if it is absent.
    source : str
        Name of the text, for complaints.
    timeout : float
        Seconds to wait for another process that holds the store.

    Raises
    ------
    InputError
        With every fault of the text by line (the first hundred); the store is unchanged. Also if `path` is no store.
    LockedError
        If the store is still locked after `timeout`.
    """
    # All rows go to a private database with the same rules first, so that a fault never touches the store.
    with closing(connected(PRIVATE, timeout)) as connection:
        checked = Store(path, kind_of(path), connection, "main", present=True)
        connection.execute("BEGIN")
        create(checked, packed=False)
        run = read_dump(lines, checked, source)
        if checked.kind == "EXT":
            exterior.require_names(checked, source)
        with writing([path], timeout=timeout) as stores:
            _take_over(stores[path], checked, run)


PRIVATE = ""
"""SQLite's name for a database of one connection, on disk where it grows large, gone at the end."""


def _take_over(store: Store, checked: Store, run: str | None) -> None:
    tables = dumped_tables(store.kind)
    for table in reversed(tables):
        store.delete(table)
    for table in tables:
        store.insert(table, checked.stored_rows(replace(table, packed=False)))
    set_run(store, run)
