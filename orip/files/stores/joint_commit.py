"""One commit over more stores than one SQLite connection can attach.

SQLite commits all files of one connection as one. Larger sets are committed connection by connection, and are tied
together by two kinds of files:

    STORE-undo     beside each store: its bytes before the transaction, and where the pact is
    FIRST-pact     beside the first store: the names of all stores; while it is there, nothing is committed

The pact is made first, then the copies, then the connections commit; removing the pact is the commit of the whole, and
the copies go last. Whoever finds a copy beside a store looks for its pact: if it is gone, the transaction was completed
and the copy goes too; if it is there, its process was killed (it would hold the pact's lock), and all stores are put
back. Both may have come with a project from somebody else: a pact counts only if it lists the store whose copy names
it, and a copy is touched only if it names the pact, so that neither reaches other files.

A reader looks for copies once it has its locks: no store can be committed under them, and no copy goes before all
stores are committed, so that a reader who finds none has a state from before or from after the whole.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sqlite3
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from pathlib import Path

from orip.files.stores.store import damage
from orip.files.text.atomic import flush_folder, replace_bytes
from orip.files.text.own_files import STORE_NAME, locked, remove_file
from orip.files.text.regular_file import NoRegularFileError, open_regular, regular_bytes
from orip.files.text.shown import shown_token

_STORE = re.compile(STORE_NAME)
_PACT = re.compile(rf"{STORE_NAME}-pact")
_LONGEST_LIST = 1 << 20
"""Bytes of a pact: the names of some thousand stores."""

Connect = Callable[[Path], sqlite3.Connection]
"""Opens one store by itself, for reading and writing."""


def commit_jointly(connections: Sequence[sqlite3.Connection], files: Sequence[Path], connect: Connect) -> None:
    """Commit the transactions of connections as one.

    Parameters
    ----------
    connections : sequence of sqlite3.Connection
        Each in a transaction that holds the write locks of its files.
    files : sequence of Path
        All of their files.

    Raises
    ------
    sqlite3.Error
        If one of them cannot be committed; then none is.
    OSError
        If the copies cannot be written; then nothing is committed.
    LockedError
        If another process restores an older transaction at this moment.
    """
    if len(connections) == 1:
        connections[0].execute("COMMIT")
        return
    pact = _pact_of(files[0])
    replace_bytes(pact, json.dumps([_from(pact, file) for file in files]).encode())
    with locked(pact, pact.name):
        try:
            for file in files:
                _write_undo(file, pact, connect)
            for connection in connections:
                connection.execute("COMMIT")
        except (sqlite3.Error, OSError):
            for connection in connections:
                if connection.in_transaction:
                    connection.execute("ROLLBACK")
            _put_back(pact, connect)
            raise
        _end(pact, files)


def put_back_killed(files: Iterable[Path], connect: Connect) -> bool:
    """Put stores back that a killed process had committed in part; tell whether there was something to do.

    Parameters
    ----------
    files : iterable of Path
        Stores that are not locked by this process.

    Raises
    ------
    LockedError
        If a process is committing, and does not come to its end.
    InputError
        If a copy is damaged.
    sqlite3.Error, OSError
        If a store cannot be written.
    """
    found = [file for file in files if has_undo(file)]
    for file in found:
        _put_back_with(file, connect)
    return bool(found)


def has_undo(file: Path) -> bool:
    """Tell whether a transaction over a store is not completed, or its copy is still there."""
    return os.path.lexists(_undo_of(file))


def remove_orphaned_pact(files: Sequence[Path]) -> None:
    """Remove the pact of a process that was killed before its first copy.

    Parameters
    ----------
    files : sequence of Path
        Locked by this process and without copies, so that nobody else writes the pact of the first one.
    """
    pact = _pact_of(files[0])
    with suppress(OSError, ValueError):
        if pact.exists() and not any(has_undo(file) for file in _listed(pact)):
            remove_file(pact)


def _put_back_with(file: Path, connect: Connect) -> None:
    """Put back all stores of the transaction that has left a copy of this one; only the copy goes if it is complete."""
    while has_undo(file):
        try:
            pact, _ = _read_undo(file)
            before = identity_of(pact)
            if before is None:
                remove_file(_undo_of(file))
                return
            if file not in _listed(pact):
                raise damage(_undo_of(file), f"it names '{shown_token(str(pact))}', which does not list this store")
            with locked(pact, file.name):
                if identity_of(pact) == before:  # else that transaction has ended while its lock was waited for
                    _put_back(pact, connect)
                    return
        except FileNotFoundError:
            continue  # it has ended between two looks


def _put_back(pact: Path, connect: Connect) -> None:
    files = [file for file in _listed(pact) if has_undo(file) and _read_undo(file)[0] == pact]
    for file in files:
        _restore(file, _read_undo(file)[1], connect)
    _end(pact, files)


def _end(pact: Path, files: Iterable[Path]) -> None:
    """Remove the pact, and then the copies that name it."""
    remove_file(pact)
    flush_folder(pact.parent)
    for file in files:
        remove_file(_undo_of(file))


def _restore(file: Path, content: bytes, connect: Connect) -> None:
    """Give a store its bytes of before, in a transaction of its own; one that has them may be held by readers."""
    with closing(sqlite3.connect(":memory:")) as source, closing(connect(file)) as store:
        if _bytes_of(file, store) == content:
            return
        if content:
            source.deserialize(content)
        source.backup(store)


def _write_undo(file: Path, pact: Path, connect: Connect) -> None:
    """Copy a store as others see it: a connection of its own reads what is committed, whatever is being written."""
    with closing(connect(file)) as store:
        content = _bytes_of(file, store)
    head = {"pact": _from(file, pact), "sha256": hashlib.sha256(content).hexdigest()}
    replace_bytes(_undo_of(file), json.dumps(head).encode() + b"\n" + content)


def _bytes_of(file: Path, store: sqlite3.Connection) -> bytes:
    """Return what is committed of a store; an empty file cannot be serialised."""
    return store.serialize() if file.stat().st_size else b""


def _read_undo(file: Path) -> tuple[Path, bytes]:
    """Return the pact of a copy, and the bytes that the store had."""
    if _undo_of(file).is_symlink():  # also one that leads nowhere, for which a missing copy would be waited for
        raise damage(_undo_of(file), "it is a link, and no copy of a store")
    head, _, content = regular_bytes(_undo_of(file)).partition(b"\n")
    try:
        found = json.loads(head)
        pact, digest = _at(file, found["pact"]), found["sha256"]
    except (ValueError, KeyError, TypeError, RecursionError):
        pact, digest = file, ""
    if hashlib.sha256(content).hexdigest() != digest or not _PACT.fullmatch(pact.name):
        raise damage(_undo_of(file), "it is not a copy of a store")
    return pact, content


def _listed(pact: Path) -> list[Path]:
    try:
        with open_regular(pact) as file:
            listed = [_at(pact, name) for name in json.loads(file.read(_LONGEST_LIST))]
    except NoRegularFileError as error:
        raise damage(pact, f"it is {error.kind}, and no list of stores") from None
    except (ValueError, TypeError, RecursionError):
        listed = [pact]
    if pact.is_symlink() or not all(_STORE.fullmatch(path.name) for path in listed):
        raise damage(pact, "it is not a list of stores")
    return listed


def _undo_of(file: Path) -> Path:
    return file.with_name(f"{file.name}-undo")


def _pact_of(file: Path) -> Path:
    return file.with_name(f"{file.name}-pact")


def _from(here: Path, file: Path) -> str:
    """Return a file as seen from the folder of another one: stores may be moved together."""
    return os.path.relpath(file, here.parent)


def _at(here: Path, name: str) -> Path:
    return Path(os.path.normpath(here.parent / name))


def identity_of(file: Path) -> tuple[int, int] | None:
    """Return what tells a file from another one of the same name; None if there is none."""
    with suppress(OSError):
        status = file.stat()
        return status.st_dev, status.st_ino
    return None
