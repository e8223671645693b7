"""The files of a store as SQLite will find them, looked at first; and SQLite's errors in the user's words."""

from __future__ import annotations

import os
import re
import sqlite3
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from orip.errors import InputError, LockedError, OripError
from orip.files.stores.store import damage
from orip.files.text.own_files import STORE_NAME, remove_file
from orip.files.text.regular_file import file_of, kind_of_no_file, open_regular
from orip.files.text.shown import shown_token

# SQLite follows links to a store, and plays back a journal beside it that nobody holds: that is how a killed run is
# undone. A journal may name a super-journal, which ties the journals of several stores together; SQLite removes that
# file once it has played back, whatever file it is. So a store is opened only if the super-journal that its journal
# names is one: under a name that SQLite gives, and with a list of journals of stores that has this one in it. Nobody
# but the run that made that journal can have written such a list (sqlite.org/fileformat, section 3;
# sqlite.org/atomiccommit, 5).
#
# If no journal names a super-journal, the commit had not begun, and nobody will ever remove it. While a journal names
# it, it must stay: without it that journal would count as one of a finished commit.


_SUPER_JOURNAL = re.compile(rf"{STORE_NAME}-mj[0-9A-F]{{8,9}}")
_JOURNAL = re.compile(rf"{STORE_NAME}-journal")
_MAGIC = bytes((0xD9, 0xD5, 0x05, 0xF9, 0x20, 0xA1, 0x63, 0xD7))
"""Stands at the beginning of a journal, and at its end if it names a super-journal."""

_LONGEST_LIST = 1 << 20
"""Bytes of a super-journal: the names of some thousand journals."""

_NAME_AT_END = 4096
"""Bytes at the end of a journal that hold the name, with four of length and four of checksum after it."""


def require_own_store(path: Path, *, writes: bool) -> Path:
    """Return the file of a store, as `file_of`; refuse one that SQLite should not open.

    It would wait for a pipe, and change or remove files of somebody else.

    Parameters
    ----------
    path : Path
        A store, which need not be there.
    writes : bool
        It is opened to be changed.

    Raises
    ------
    InputError
        If it, or a file that SQLite keeps beside it, is no file of its own; or if its journal names another one.
    """
    _require_no_link(path)
    file = file_of(path)
    for beside in ("", "-journal", "-wal", "-shm"):
        found = Path(f"{file}{beside}")  # of '/' too, which has no name
        try:
            kind = kind_of_no_file(found.stat())
            status = found.lstat()
        except OSError:
            continue  # what is absent is made, and of the rest SQLite tells
        if kind is None and stat.S_ISLNK(status.st_mode):
            kind = "a link"
        if kind is not None:
            message = f"this is {kind}, not a file; a record store is one file"
            raise InputError.single(message, f"{path}{beside}")
        if writes and os.name == "posix" and status.st_mode & (stat.S_ISUID | stat.S_ISGID):
            message = "whoever runs this file does so as its owner (a set-ID bit); take that away with 'chmod ug-s'"
            raise InputError.single(message, f"{path}{beside}")
        if status.st_nlink > 1 and (writes or beside):
            message = "this file has a second name (a hard link) and would change there too; put a copy in its place"
            raise InputError.single(message, f"{path}{beside}")
    _require_own_journal(file, path)
    return file


def _require_no_link(path: Path) -> None:
    if not path.is_symlink():
        return
    target = path.readlink()
    if not path.exists():
        message = f"this link points to {target}, which does not exist; repair or remove the link"
    elif kind_of_no_file(path.stat()) is None:
        own = {".CAM": "camera_file", ".TIK": "temtick_file"}.get(path.suffix.upper())
        other = "" if own is None else f", or name that file as {own} in orip.toml"
        message = f"this is a link to {target}; put the store itself in the place of the link{other}"
    else:
        return  # what it leads to is no file, and is named
    raise InputError.single(message, str(path))


def _require_own_journal(store: Path, shown: Path) -> None:
    """Refuse a store, given without links, whose journal names a file that is no super-journal of it."""
    journal = store.with_name(f"{store.name}-journal")
    name = _named_by(journal)
    if not name:
        return
    super_journal = Path(os.fsdecode(name))
    if not os.path.lexists(super_journal):
        return  # that commit is finished, or had its files elsewhere: nothing is removed
    if not _SUPER_JOURNAL.fullmatch(super_journal.name) or journal not in _sound_list(super_journal):
        message = (
            f"the journal beside this store names the file '{shown_token(str(super_journal))}', which no interrupted "
            f"run of this project has left; playing the journal back would remove that file. If the project comes from "
            f"somebody else, remove '{journal.name}'; if it was copied after an interrupted run, run 'orip status' in "
            f"the original and copy it again"
        )
        raise InputError.single(message, str(shown))


def remove_orphans(stores: Iterable[Path]) -> None:
    """Remove the super-journals of stores that no journal names.

    Parameters
    ----------
    stores : iterable of Path
        Files that this process has locked, so that no other process can be committing from them.
    """
    by_folder: dict[Path, set[str]] = {}
    for store in stores:
        by_folder.setdefault(store.parent, set()).add(store.name)
    for folder, names in by_folder.items():
        for path in _super_journals(folder):
            if path.name.rpartition("-mj")[0] not in names:
                continue
            journals = {*folder.glob("*-journal"), *_journals_in(path)}
            if not any(_may_name(journal, path.name) for journal in journals):
                with suppress(OSError):
                    remove_file(path)


def _super_journals(folder: Path) -> list[Path]:
    with suppress(OSError):
        return [folder / name for name in os.listdir(folder) if _SUPER_JOURNAL.fullmatch(name)]  # noqa: PTH208
    return []


def _named_by(journal: Path) -> bytes:
    """Return the name of the super-journal at the end of a journal; none if SQLite would find none there."""
    try:
        end = _end_of(journal)
    except (OSError, ValueError):
        return b""
    head, length = end[:-16], int.from_bytes(end[-16:-12], "big")
    if len(end) < 16 or end[-8:] != _MAGIC or not 0 < length <= len(head):
        return b""
    return head[-length:].partition(b"\0")[0]


def _sound_list(super_journal: Path) -> list[Path]:
    """Return the journals that a super-journal lists; none if there is anything else in it."""
    if super_journal.is_symlink():
        return []
    listed = _journals_in(super_journal)
    if not all(_JOURNAL.fullmatch(path.name) and (path.is_file() or not os.path.lexists(path)) for path in listed):
        return []
    return [file_of(path.parent) / path.name for path in listed]


def _journals_in(path: Path) -> list[Path]:
    """Return the journals that a super-journal lists; some may be in other folders."""
    with suppress(OSError, ValueError), open_regular(path) as file:
        content = file.read(_LONGEST_LIST + 1)
        if len(content) <= _LONGEST_LIST:
            return [Path(os.fsdecode(name)) for name in content.split(b"\0") if name]
    return []


def _may_name(journal: Path, name: str) -> bool:
    """Tell whether a journal that SQLite would play back has a name; one that begins with 0 it leaves alone."""
    try:
        with open_regular(journal) as file:
            is_played_back = file.read(1) not in {b"", b"\0"}
        return is_played_back and name.encode() in _end_of(journal)
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True  # what cannot be read may name it


def _end_of(journal: Path) -> bytes:
    with open_regular(journal) as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _NAME_AT_END))
        return file.read()


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
