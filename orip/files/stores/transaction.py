"""Transactions over several stores: all of them change, or none."""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import partial
from pathlib import Path

from msgspec import Struct

from orip.errors import OripError, UsageError
from orip.files.stores.identity import content_sums, create, is_present, kind_of
from orip.files.stores.joint_commit import commit_jointly, has_undo, identity_of, put_back_killed, remove_orphaned_pact
from orip.files.stores.store import Store
from orip.files.stores.store_files import explained, opened, remove_orphans, require_own_store
from orip.files.text.own_files import remove_file
from orip.files.text.regular_file import file_of
from orip.structs import replace

_LONGEST_VALUE = 100_000_000
_LONGEST_STATEMENT = 100_000
"""Bytes of a value and of a statement: the recommendations of SQLite for files of others, and room for any record."""

OLDEST_SQLITE = (3, 37, 0)
"""The first SQLite with STRICT tables."""


class Stores(Struct, frozen=True):
    """The stores of one transaction, by file, and by the path that the transaction was begun with."""

    by_path: dict[Path, Store]

    def __getitem__(self, path: Path) -> Store:
        """Return the store of a file that the transaction was begun with."""
        return self.by_path.get(path) or self.by_path[file_of(path)]


@contextmanager
def writing(paths: Iterable[Path], *, timeout: float = 10.0) -> Iterator[Stores]:
    """Lock stores for writing, and commit them as one when the block ends, or roll all back if it raises.

    Missing and empty stores are created with their tables.

    Parameters
    ----------
    paths : iterable of Path
        At least one.
    timeout : float
        Seconds to wait for another process that holds a store.

    Raises
    ------
    LockedError
        If a store is still locked after `timeout`.
    InputError
        If a file is no store of its kind, newer or damaged, or what is written breaks a rule of the store.
    OripError
        If disk or permissions are in the way.
    """
    files = _files(paths, writes=True)
    if not files:
        message = "a transaction that writes needs at least one store"
        raise ValueError(message)
    _require_folders(files)
    with explained(list(files.values())), ExitStack() as locked:
        stores = _locked(locked, files, timeout)
        remove_orphans(files)
        remove_orphaned_pact(list(files))
        present = [_present_or_created(store) for store in stores]
        yield _by_path(files, dict(zip(files, present, strict=True)))
        for store in present:
            store.seal()
        connections = list(dict.fromkeys(store.connection for store in present))
        commit_jointly(connections, list(files), partial(_single, timeout=timeout))


def remove_empty(path: Path, is_empty: Callable[[Store], bool]) -> bool:
    """Remove a store that was never filled, or whose content has gone elsewhere; tell whether that was done.

    Parameters
    ----------
    path : Path
        It stays if another process holds it, or if it is no sound store.
    is_empty : function of a Store
        Tells whether a store with its tables has nothing in it.
    """
    with suppress(OripError, OSError, sqlite3.Error):
        file = require_own_store(path, writes=True)
        with closing(connected(_uri(file, "rw"), timeout=0.0)) as connection:
            store = _store(path, connection, "main")
            with _transaction(connection, "BEGIN IMMEDIATE"):
                if has_undo(file):
                    return False
                if not is_present(store) or is_empty(_with_sums(replace(store, present=True))):
                    remove_file(
                        path
                    )  # a process that waits for the lock finds that its file has gone, and makes a new one
                    return True
    return False


def _locked(locked: ExitStack, files: Mapping[Path, Path], timeout: float) -> list[Store]:
    """Return stores that are open and locked for as long as `locked` is; files that are missing are made."""
    while True:
        with ExitStack() as attempt:
            stores = _opened_for_writing(attempt, files, timeout)
            before = list(map(identity_of, files))
            for connection in dict.fromkeys(store.connection for store in stores):
                attempt.enter_context(_transaction(connection, "BEGIN IMMEDIATE"))
            if None not in before and before == list(map(identity_of, files)) and not any(map(has_undo, files)):
                locked.enter_context(attempt.pop_all())
                return stores
        # another process has removed an empty store while this one waited for its lock, or was killed
        put_back_killed(files, partial(_single, timeout=timeout))


def _opened_for_writing(attempt: ExitStack, files: Mapping[Path, Path], timeout: float) -> list[Store]:
    """Open stores with as many connections as it takes; all processes lock them in the same order."""
    stores, rest = list[Store](), list(files.items())
    while rest:
        # The main database is one of the stores: with ':memory:' in its place SQLite commits file by file.
        file, main = rest[0]
        with opened(main):
            connection = attempt.enter_context(closing(connected(_uri(file, "rwc"), timeout)))
        most = 1 + connection.getlimit(sqlite3.SQLITE_LIMIT_ATTACHED)
        together = [_store(main, connection, "main"), *_attached(connection, rest[1:most], "rwc")]
        for store in together:
            _prepare(store, is_alone=len(together) == 1)
        stores += together
        rest = rest[most:]
    return stores


def _single(file: Path, timeout: float) -> sqlite3.Connection:
    """Return a connection to one store alone, which is not made where it is missing."""
    connection = connected(_uri(require_own_store(file, writes=True), "rw"), timeout)
    connection.execute("PRAGMA synchronous = EXTRA")
    return connection


@contextmanager
def reading(paths: Iterable[Path], *, timeout: float = 10.0) -> Iterator[Stores]:
    """Read stores in one consistent state; missing and empty ones count as absent and are not created.

    Writers wait while the block lasts.

    Raises
    ------
    LockedError
        If a store is still being committed after `timeout` seconds.
    InputError
        If a file is no store of its kind, newer or damaged.
    OripError
        If disk or permissions are in the way.
    """
    files = _files(paths, writes=False)
    with explained(list(files.values())), ExitStack() as held:
        while True:
            with ExitStack() as attempt:
                stores = _shared(attempt, files, timeout)
                if not any(map(has_undo, files)):
                    held.enter_context(attempt.pop_all())
                    remove_orphans(file for file, store in stores.items() if store.present)
                    break
            put_back_killed(files, partial(_single, timeout=timeout))
        yield _by_path(files, stores)


def _by_path(files: Mapping[Path, Path], stores: dict[Path, Store]) -> Stores:
    return Stores({**{path: stores[file] for file, path in files.items()}, **stores})


def _shared(attempt: ExitStack, files: Mapping[Path, Path], timeout: float) -> dict[Path, Store]:
    """Return stores that nobody can commit to for as long as `attempt` lasts."""
    rest, found = [file for file in files if _size(file) > 0], dict[Path, Store]()
    if len(rest) < len(files):
        nothing = attempt.enter_context(closing(connected(":memory:", timeout)))
        found = {file: _store(path, nothing, "main") for file, path in files.items()}
    while rest:
        connection = attempt.enter_context(closing(connected(":memory:", timeout)))
        most = connection.getlimit(sqlite3.SQLITE_LIMIT_ATTACHED)
        # Opened for writing where permissions allow: SQLite rolls back what a killed run left half done.
        stores = _attached(connection, [(file, files[file]) for file in rest[:most]], "rw")
        attempt.enter_context(_transaction(connection, "BEGIN"))
        for file, store in zip(rest, stores, strict=False):
            found[file] = _with_sums(replace(store, present=is_present(store)))
        rest = rest[most:]
    return {file: found[file] for file in files}


def _files(paths: Iterable[Path], *, writes: bool) -> dict[Path, Path]:
    """Return the paths by the file that they lead to, each file once, in the order in which all processes lock them."""
    files = {}
    for path in paths:
        kind_of(path)
        files[require_own_store(path, writes=writes)] = path
    return dict(sorted(files.items()))


def _size(file: Path) -> int:
    return file.stat().st_size if file.is_file() else 0


def _require_folders(files: Mapping[Path, Path]) -> None:
    for file, path in files.items():
        if not file.parent.is_dir():
            message = f"the folder of '{path}' does not exist; make it first"
            raise UsageError(message)


def connected(database: str, timeout: float) -> sqlite3.Connection:
    """Return a connection to a file or private database, in which transactions begin and end explicitly."""
    if sqlite3.sqlite_version_info < OLDEST_SQLITE:
        message = (
            f"record stores need SQLite 3.37 or newer, this Python has {sqlite3.sqlite_version}; "
            f"install a Python with a newer SQLite"
        )
        raise OripError(message)
    # isolation_level None: transactions begin and end where this module says so.
    connection = sqlite3.connect(database, timeout=timeout, isolation_level=None, uri=True)
    connection.execute("PRAGMA foreign_keys = ON")
    _defend(connection)
    return connection


def _defend(connection: sqlite3.Connection) -> None:
    """Let SQLite trust no file: it may come from anywhere."""
    connection.execute("PRAGMA trusted_schema = OFF")  # no functions in what a schema defines
    connection.execute("PRAGMA cell_size_check = ON")  # pages are looked at as they are read
    connection.execute("PRAGMA mmap_size = 0")  # a disk error is an error, not a signal
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST_VALUE)
    connection.setlimit(sqlite3.SQLITE_LIMIT_SQL_LENGTH, _LONGEST_STATEMENT)
    if sys.version_info >= (3, 12):
        connection.setconfig(sqlite3.SQLITE_DBCONFIG_DEFENSIVE, True)


def _attached(connection: sqlite3.Connection, files: Sequence[tuple[Path, Path]], mode: str) -> list[Store]:
    stores = []
    for number, (file, path) in enumerate(files, start=1):
        with opened(path):
            connection.execute(f"ATTACH ? AS store{number}", (_uri(file, mode),))
        stores.append(_store(path, connection, f"store{number}"))
    return stores


def _store(path: Path, connection: sqlite3.Connection, schema: str) -> Store:
    return Store(path, kind_of(path), connection, schema, present=False)


def _uri(file: Path, mode: str) -> str:
    return f"{file.as_uri()}?mode={mode}"


def _prepare(store: Store, *, is_alone: bool) -> None:
    """Set what makes a commit over several files atomic and durable; possible outside a transaction only.

    A commit of one file is durable once the removal of its journal is, which EXTRA sees to. One of several is durable
    with the removal of the journal that names them all, which SQLite brings to the disk anyway; their own ones are
    of no effect from then on, and wait for the disk without being waited for.
    """
    synchronous = "EXTRA" if is_alone else "FULL"
    # before a foreign file is touched; in one transaction, since another process may be making it at this moment
    with explained([store.path]), _transaction(store.connection, "BEGIN"):
        is_present(store)
    with explained([store.path]):
        for setting in ("journal_mode = DELETE", f"synchronous = {synchronous}", "cache_spill = OFF"):
            # Without spilling, readers wait during the commit only, not for as long as a large store is being filled.
            store.connection.execute(f"PRAGMA {store.schema}.{setting}")


def _present_or_created(store: Store) -> Store:
    if is_present(store):
        return _with_sums(replace(store, present=True))
    made = _with_sums(store)
    create(made)
    return replace(made, present=True)


def _with_sums(store: Store) -> Store:
    return replace(store, sums=content_sums(store))


@contextmanager
def _transaction(connection: sqlite3.Connection, begin: str) -> Iterator[None]:
    """Begin a transaction; what is not committed at the end of the block is rolled back, locks are given up."""
    connection.execute(begin)
    try:
        yield
    finally:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
