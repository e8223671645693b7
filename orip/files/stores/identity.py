"""Whether a file is a store, of which kind and version; and the creation of a new one."""

from __future__ import annotations

from functools import cache

from orip.errors import InputError
from orip.files.stores.checksum import CHECKSUM, ContentSums, Sum
from orip.files.stores.explain import opened
from orip.files.stores.older import older_stores_refused
from orip.files.stores.provenance import META
from orip.files.stores.schema import APPLICATION_ID, SCHEMA_VERSION, TABLES_OF_KIND, summed_tables
from orip.files.stores.store import Store, damage
from orip.files.stores.table import StoreTable
from orip.files.text.shown import shown_token

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
