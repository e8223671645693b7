"""A store as canonical text: equal data give equal text, whatever the history of the file.

A dump is one JSON value a line: a header, then for each table a line that names it and its columns, and its rows sorted
by primary key, and at last a line that tells that nothing is missing::

    {"format": "orip.dump/1", "kind": "TIK", "schema": 1, "run": null}
    {"table": "temtick", "columns": ["name", "position", "text_digest", "origin"]}
    ["RESEAU", 0, null, null]
    {"end": "TIK"}

Numbers are written with as few digits as give the same double back; infinity is ``Infinity``, NaN is ``null``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from orip.files.stores.explain import explained
from orip.files.stores.provenance import META, run_of
from orip.files.stores.schema import DUMP_VERSION, summed_tables
from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable
from orip.files.stores.transaction import reading

FORMAT = "orip.dump/1"
# JSON leaves these characters as they are, but many programs end a line there.
LINE_ENDS = str.maketrans({mark: f"\\u{ord(mark):04x}" for mark in "\x7f\x85\u2028\u2029"})


def dump(path: Path) -> Iterator[str]:
    """Yield the lines of a store's dump, without line ends; an absent store has no rows.

    Raises
    ------
    InputError
        If the file is no store of its kind, of another version or damaged; before the first line.
    """
    with reading([path]) as stores:
        store = stores[path]
        if store.present:
            with explained([path]):
                store.verify()
        yield _line({"format": FORMAT, "kind": store.kind, "schema": DUMP_VERSION, "run": run_of(store)})
        yield from _body(store)


def dumped_tables(kind: str) -> tuple[StoreTable, ...]:
    """Return the tables of a dump in their order; the contents of `meta` are in the header."""
    return tuple(table for table in summed_tables(kind) if table is not META)


def _body(store: Store) -> Iterator[str]:
    with explained([store.path]):
        for table in dumped_tables(store.kind):
            yield _line({"table": table.name, "columns": table.column_names})
            for row in store.stored_rows(table):
                yield _line(row)
        yield _line({"end": store.kind})


def _line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False).translate(LINE_ENDS)
