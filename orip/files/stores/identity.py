"""The kinds of stores with the tables of each; whether a file is one, or one of an older orip; creation of new ones."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

from orip.errors import InputError, UsageError
from orip.files.stores import digest as provenance
from orip.files.stores.checksum import CHECKSUM, ContentSums, Sum
from orip.files.stores.contents import observations, solution_tables
from orip.files.stores.contents.stores import (
    BUNDLES,
    CAMERAS,
    PHOTO_ORIENTATIONS,
    PHOTOS,
    TEMPLATE_ORIENTATIONS,
    TEMPLATES,
    TEMTICKS,
)
from orip.files.stores.digest import META
from orip.files.stores.store import Store, damage
from orip.files.stores.store_files import opened
from orip.files.stores.table import StoreTable
from orip.files.text.own_files import make_folder, rename
from orip.files.text.regular_file import kind_of_no_file
from orip.files.text.shown import shown_token

APPLICATION_ID = int.from_bytes(b"ORIP", "big")
SCHEMA_VERSION = 22
"""21: readouts had no direction; 20: there were no heights of terrain models; 19: there were no mountings; 18: cameras
had no readout; 17: there was no reliability of correlated observations; 16: photos had no images, and no bundle had the
points of another; 15: no solution was not determined; 14: checksums were of BLAKE2; 13: all rows of a long list were
one; 12: there were no rigs; 11: long lists were rows; 10: photos had three correlations; 8: cameras had no projection;
7: they had no A9; 6: there were no times of exposures; 5: there were no antennas; 4: a photo had each point once, and
there were no variance components; 3: there were no checksums and no zero directions; 2: no groups of observations, no
alternatives of a blunder; 1: no correlations of coordinates. A store of an older version is refused.
"""
DUMP_VERSION = 16
"""Of the tables that a dump has; checksums are not among them."""

TABLES_OF_KIND: dict[str, tuple[StoreTable, ...]] = {
    "CAM": (*provenance.TABLES, *CAMERAS.tables),
    "TIK": (*provenance.TABLES, *TEMTICKS.tables),
    "PHO": (*provenance.TABLES, *PHOTOS.tables, *PHOTO_ORIENTATIONS.tables),
    "TEM": (*provenance.TABLES, *TEMPLATES.tables, *TEMPLATE_ORIENTATIONS.tables),
    "EXT": (*provenance.TABLES, *BUNDLES.tables, *solution_tables.TABLES),
    "EXO": (*provenance.TABLES, *observations.TABLES),
}
"""Tables by kind of store, parents before their lists."""


def summed_tables(kind: str) -> tuple[StoreTable, ...]:
    """Return the tables that have checksums: all but that of the checksums."""
    return tuple(table for table in TABLES_OF_KIND[kind] if table is not CHECKSUM)


def kind_of(path: Path) -> str:
    """Return the kind of store that a file's extension tells; case does not count.

    Raises
    ------
    UsageError
        If no store has that extension.
    """
    kind = path.suffix.removeprefix(".").upper()
    if kind not in TABLES_OF_KIND:
        known = ", ".join(f".{name}" for name in TABLES_OF_KIND)
        message = f"'{path}' is not a record store: stores end in {known}"
        raise UsageError(message)
    return kind


OLDER_STORES = "older-stores"
"""The folder, beside the stores, into which they are moved."""

_VERSION, _APPLICATION, _END = 60, 68, 72
"""Where the header of an SQLite file has user_version and application_id, four bytes each (sqlite.org/fileformat)."""


def is_older_store(path: Path) -> bool:
    """Return whether a file is a store of orip with an earlier schema."""
    # a file of the running system may keep its reader waiting
    if not path.is_file() or kind_of_no_file(path.stat()) is not None:
        return False
    with path.open("rb") as file:
        header = file.read(_END)
    application = int.from_bytes(header[_APPLICATION:_END], "big", signed=True)
    return application == APPLICATION_ID and int.from_bytes(header[_VERSION : _VERSION + 4], "big") < SCHEMA_VERSION


def refuse_older_stores(paths: Iterable[Path]) -> None:
    """Refuse all of the stores that an older orip wrote at once.

    Raises
    ------
    InputError
        If there is one.
    """
    older = list[Path]()
    for path in paths:
        with suppress(OSError):  # whoever opens the store tells what is in the way
            older += [path] if is_older_store(path) else []
    if older:
        raise older_stores_refused(older)


def older_stores_refused(paths: Sequence[Path]) -> InputError:
    """Return the error that names stores which an older orip wrote, and says what to do."""
    these, them, new = (
        ("this store was", "it", "a new one") if len(paths) == 1 else ("these stores were", "them", "new ones")
    )
    message = (
        f"{these} written by an older orip (this one writes schema {SCHEMA_VERSION}); bring what was edited in {them} "
        f"into the text with that orip ('orip export-toml'), and move {them} away: 'orip run' creates {new}"
    )
    return InputError.single(message, ", ".join(map(str, paths)))


def set_older_stores_aside(paths: Iterable[Path]) -> list[Path]:
    """Move those of the stores that an older orip wrote into a folder of their own, and return where they are.

    What is there from an earlier time stays.

    Raises
    ------
    OSError
        If they cannot be moved.
    """
    moved = []
    for path in filter(is_older_store, paths):
        folder = path.parent / OLDER_STORES
        make_folder(folder)
        target = folder / path.name
        number = 1
        while os.path.lexists(target):
            number += 1
            target = folder / f"{path.name}.{number}"
        rename(path, target)
        moved.append(target)
    return moved


_Objects = dict[tuple[str, str], str]
"""What a schema says of each object, by its type and name."""


def is_present(store: Store) -> bool:
    """Return whether the attached file is a store of its kind; False if it is empty.

    Raises
    ------
    InputError
        If it is something else, of another kind, of another version or damaged, or holds what no store of orip holds.
    """
    with opened(store.path):
        application = _pragma(store, "application_id")
        version = _pragma(store, "user_version")
        found = _objects(store)
        if application == version == 0 and not found:
            return False
        _refuse_strangers(store, application, version)
        meta = ("table", META.name)
        kind = _kind(store) if found.get(meta) == _statement(META) else None
    if kind is not None and kind != store.kind:
        message = f"this store was made as .{kind} and is not a .{store.kind}; give it back its extension"
        raise InputError.single(message, str(store.path))
    _refuse_other_objects(store, found)
    if kind is None:
        raise damage(store.path, "without a kind")
    return True


def create(store: Store, *, packed: bool = True) -> None:
    """Make the tables of an empty store inside the current transaction; long lists row by row unless `packed`."""
    store.connection.execute(f"PRAGMA {store.schema}.application_id = {APPLICATION_ID}")
    store.connection.execute(f"PRAGMA {store.schema}.user_version = {SCHEMA_VERSION}")
    for table in TABLES_OF_KIND[store.kind]:
        store.connection.execute((table.in_file if packed else table).ddl(store.schema))
    store.insert(META, [("kind", store.kind)])


def content_sums(store: Store) -> ContentSums:
    """Return the checksums of a store that is present."""
    rows = store.connection.execute(CHECKSUM.select(store.schema)).fetchall() if store.present else []
    if any(tuple(map(type, row)) != (str, str, int, str) for row in rows):
        raise damage(store.path, "its checksums are illegible")
    return ContentSums(
        summed_tables(store.kind), {(table, part): Sum(count, digest) for table, part, count, digest in rows}
    )


def _pragma(store: Store, name: str) -> int:
    return int(store.connection.execute(f"PRAGMA {store.schema}.{name}").fetchone()[0])


def _objects(store: Store) -> _Objects:
    """Return what the schema has; indexes that SQLite makes for keys have no statement of their own."""
    query = f"SELECT type, name, sql FROM {store.schema}.sqlite_schema WHERE NOT (type = 'index' AND sql IS NULL)"
    return {(str(kind), str(name)): str(sql) for kind, name, sql in store.connection.execute(query)}


def _statement(table: StoreTable) -> str:
    """Return how a schema quotes the statement that makes a table."""
    return table.ddl("main").replace("main.", "", 1)


@cache
def _own_objects(kind: str) -> _Objects:
    return {("table", table.name): _statement(table.in_file) for table in TABLES_OF_KIND[kind]}


def _refuse_other_objects(store: Store, found: _Objects) -> None:
    """Refuse triggers, views and tables that orip has not made: they could change what is read and written."""
    own = _own_objects(store.kind)
    missing = [name for _table, name in own if ("table", name) not in found]
    if missing:
        raise damage(store.path, f"without {', '.join(missing)}")
    strange = [key for key in found if key not in own]
    if strange:
        kind, name = strange[0]
        raise damage(store.path, f"the {shown_token(kind)} '{shown_token(name)}' was not made by orip")
    changed = [name for (_table, name), sql in own.items() if found["table", name] != sql]
    if changed:
        raise damage(store.path, f"table {changed[0]} was not made by orip")


def _refuse_strangers(store: Store, application: int, version: int) -> None:
    if application != APPLICATION_ID:
        message = "this SQLite file belongs to another program, it is not a record store; move it away"
        raise InputError.single(message, str(store.path))
    if version > SCHEMA_VERSION:
        message = (
            f"this store was written by a newer orip (schema {version}; this one knows up to {SCHEMA_VERSION}); "
            f"update orip, or take the store there with 'orip dump'"
        )
        raise InputError.single(message, str(store.path))
    if version < SCHEMA_VERSION:
        raise older_stores_refused([store.path])


def _kind(store: Store) -> str | None:
    query = f"SELECT value FROM {store.schema}.meta WHERE key = 'kind'"
    row = store.connection.execute(query).fetchone()
    return None if row is None else str(row[0])
