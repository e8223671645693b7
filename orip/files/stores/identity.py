"""Is this file a store, of which kind and version? And how a new one begins."""

from __future__ import annotations

from orip.errors import InputError
from orip.files.stores.explain import opened
from orip.files.stores.provenance import META
from orip.files.stores.schema import APPLICATION_ID, SCHEMA_VERSION, TABLES_OF_KIND
from orip.files.stores.store import Store, damage
from orip.files.stores.table import StoreTable


def is_present(store: Store) -> bool:
    """Return whether the attached file is a store of its kind; False if it is empty.

    Raises
    ------
    InputError
        If it is something else, of another kind, of a version that cannot be read or damaged.
    """
    with opened(store.path):
        application = _pragma(store, "application_id")
        version = _pragma(store, "user_version")
        query = f"SELECT name FROM {store.schema}.sqlite_schema WHERE type = 'table'"
        tables = {name for (name,) in store.connection.execute(query)}
        if application == version == 0 and not tables:
            return False
        _refuse_strangers(store, application, version)
        missing = [
            table.name for table in TABLES_OF_KIND[store.kind]
            if table.name not in tables or (version < SCHEMA_VERSION and not _has_columns(store, table))
        ]  # fmt: skip
        kind = _kind(store) if META.name in tables else None
    if kind is not None and kind != store.kind:
        message = f"this store was made as .{kind} and is no .{store.kind}; give it back its extension"
        raise InputError.single(message, str(store.path))
    if missing and META.name in tables and 0 < version < SCHEMA_VERSION:
        message = (
            f"this store was written by an older orip (schema {version}; this one writes {SCHEMA_VERSION}) and has no "
            f"{', '.join(missing)} as they are now; move it away, then 'orip run' creates a new one"
        )
        raise InputError.single(message, str(store.path))
    if missing or kind is None or version < 1:
        raise damage(store.path, f"without {', '.join(missing) or 'a kind'}")
    return True


def create(store: Store) -> None:
    """Make the tables of an empty store inside the current transaction."""
    store.connection.execute(f"PRAGMA {store.schema}.application_id = {APPLICATION_ID}")
    store.connection.execute(f"PRAGMA {store.schema}.user_version = {SCHEMA_VERSION}")
    for table in TABLES_OF_KIND[store.kind]:
        store.connection.execute(table.ddl(store.schema))
    store.insert(META, [("kind", store.kind)])


def _has_columns(store: Store, table: StoreTable) -> bool:
    rows = store.connection.execute(f"PRAGMA {store.schema}.table_info({table.name})")
    return {column.name for column in table.columns} <= {row[1] for row in rows}


def _pragma(store: Store, name: str) -> int:
    return int(store.connection.execute(f"PRAGMA {store.schema}.{name}").fetchone()[0])


def _refuse_strangers(store: Store, application: int, version: int) -> None:
    if application != APPLICATION_ID:
        message = "this SQLite file belongs to another program, it is no record store; move it away"
        raise InputError.single(message, str(store.path))
    if version > SCHEMA_VERSION:
        message = (
            f"this store was written by a newer orip (schema {version}; this one knows up to {SCHEMA_VERSION}); "
            f"update orip, or take the store there with 'orip dump'"
        )
        raise InputError.single(message, str(store.path))


def _kind(store: Store) -> str | None:
    query = f"SELECT value FROM {store.schema}.meta WHERE key = 'kind'"
    row = store.connection.execute(query).fetchone()
    return None if row is None else str(row[0])
