"""SQLite's errors in the user's words: which file, what is wrong, what to do."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from orip.errors import InputError, LockedError, OripError
from orip.files.stores.store import damage

BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
NO_ACCESS = {
    sqlite3.SQLITE_CANTOPEN: "cannot be opened; check that the folder is there and may be read and written",
    sqlite3.SQLITE_PERM: "may not be opened; check its permissions",
    sqlite3.SQLITE_READONLY: "may not be written, nor repaired after an interrupted run; check the permissions of the "
    "file and its folder",
    sqlite3.SQLITE_FULL: "cannot be written: the disk is full; make room and repeat the command",
    sqlite3.SQLITE_IOERR: "cannot be read or written: the disk reports an error; check disk and network drive",
    sqlite3.SQLITE_TOOBIG: "cannot be written: a text is too long for the store",
}

DAMAGE = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_FORMAT, sqlite3.SQLITE_MISMATCH)
"""What SQLite says of a file that it cannot make sense of: the statements are sound, as tables are looked at first."""


@contextmanager
def explained(paths: Sequence[Path]) -> Iterator[None]:
    """Turn errors of sqlite3 into those of orip, naming the files concerned.

    Raises
    ------
    LockedError
        If another process holds one of the files.
    InputError
        If a file is damaged or no store, or a record breaks a rule of the store.
    OripError
        If the disk or its permissions are in the way.
    """
    try:
        yield
    except sqlite3.Error as error:
        explanation = _explanation(error, paths)
        if explanation is None:
            raise
        raise explanation from error


@contextmanager
def opened(path: Path) -> Iterator[None]:
    """Do what `explained` does while a file is being attached and its schema read."""
    try:
        with explained([path]):
            yield
    except UnicodeDecodeError as error:
        # SQLite quotes what it cannot make out of a damaged schema, and sqlite3 cannot make text of that.
        raise damage(path, "the schema is illegible") from error


def _explanation(error: sqlite3.Error, paths: Sequence[Path]) -> OripError | None:
    code = getattr(error, "sqlite_errorcode", None)
    primary = None if code is None else code & 0xFF
    names = _named(paths)
    if primary in BUSY:
        which = "is locked" if len(paths) == 1 else "(one of them) is locked"
        return LockedError(f"{names} {which} by another run of orip; wait for it, or end it, and repeat the command")
    if primary == sqlite3.SQLITE_NOTADB:
        return InputError.single("this is not a record store; move it away, or name another file", names)
    if isinstance(error, sqlite3.IntegrityError):
        return InputError.single(f"a record breaks a rule of the store ({error}); correct it", names)
    if primary in NO_ACCESS:
        return OripError(f"{names} {NO_ACCESS[primary]} ({error})")
    # sqlite3 gives text that is not UTF-8 no code of its own.
    if primary in DAMAGE or str(error).startswith("Could not decode"):
        return damage(Path(names), str(error).partition(":")[0])
    return None


def _named(paths: Sequence[Path]) -> str:
    return ", ".join(map(str, paths))
