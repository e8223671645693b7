"""The one place where files are made, renamed and removed, and which of them may be; and locks on texts."""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from orip.errors import LockedError
from orip.files.text.regular_file import open_regular

# A project may come from anybody: its files name others, and links, pipes or files of somebody else may stand where
# orip keeps its own. So nothing is removed but regular files and folders under names that orip gives, and never through
# a link; nothing is made through a link either. What is written for the user goes through `orip.files.text.atomic`,
# which puts a whole new file in the place of an old one.

STORE_NAME = r"[^/]+\.(?i:CAM|TIK|PHO|TEM|EXT|EXO)"
TEMPORARY_NAME = r"\.orip-[0-9a-f]{8}-[0-9]{1,18}-[0-9]{1,20}-[0-9a-f]{16}\.tmp"

_OWN_NAME = re.compile(
    "|".join(
        (
            rf"{STORE_NAME}(?:-undo|-pact|-mj[0-9A-F]{{8,9}})?",
            TEMPORARY_NAME,
            r"(?:.+_)?(?:result\.json|residuals\.csv|residuals\.npz|report\.html)",
            r"[^/]+_(?:RESULT|ERROR)\.OUT",
            r"[^/]+\.(?:PRE|DRV)",
            r"before_update\.json",
            r"[0-9a-f]{24}(?:-[0-9]+-[0-9]+-[0-9]+\.jpg|\.grey)",  # tiles of images, and their grey values
            r"[0-9a-f]{32}",  # the sub-blocks of a divided block
        )
    )
)


class NotOwnFileError(OSError):
    """What is to be removed or made is not what orip makes under that name."""

    def __init__(self, path: Path, finding: str) -> None:
        super().__init__(errno.EPERM, f"{path.name!a} {finding}")


def remove_file(path: Path, within: Path | None = None) -> None:
    """Remove a file that orip has made, if it is there.

    Parameters
    ----------
    within : Path or None
        A folder above it, which the user has named: between the two there is no link. None: its own folder.

    Raises
    ------
    NotOwnFileError
        If orip gives no such name, or it is no regular file, or a link leads to its folder.
    OSError
        If it cannot be removed.
    """
    _require_own_name(path)
    require_no_link_between(path.parent, within or path.parent)
    discard(path)


def discard(path: Path) -> None:
    """Remove a regular file that this process has just made itself, if it is there.

    Raises
    ------
    NotOwnFileError
        If something else has taken its place.
    OSError
        If it cannot be removed.
    """
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISREG(mode):
        raise NotOwnFileError(path, "is no regular file")
    path.unlink(missing_ok=True)


def remove_folder(path: Path) -> None:
    """Remove a folder that orip has made under a name of its own, and all that is in it; links in it are not followed.

    Raises
    ------
    NotOwnFileError
        If orip gives no such name, or it is no folder.
    OSError
        If it cannot be removed.
    """
    _require_own_name(path)
    if not stat.S_ISDIR(path.lstat().st_mode):
        raise NotOwnFileError(path, "is no folder")
    shutil.rmtree(path)


def make_folder(path: Path, within: Path | None = None) -> None:
    """Make a folder of orip's own where there is none.

    Parameters
    ----------
    within : Path or None
        A folder above it, which the user has named: those between the two are made too. None: its own folder.

    Raises
    ------
    NotOwnFileError
        If a link or something else has one of the names.
    OSError
        If it cannot be made.
    """
    if within is not None and path != within:
        make_folder(path.parent, within)
    if path != within and path.is_symlink():
        finding = f"is a link to {path.readlink()}; put the folder itself in the place of the link"
        raise NotOwnFileError(path, finding)
    path.mkdir(exist_ok=True)


def make_named_folder(path: Path) -> None:
    """Make a folder that the user has named, and those above it, where there are none; they may be links to folders.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    path.mkdir(exist_ok=True, parents=True)


def make_file(path: Path) -> None:
    """Make an empty file where there is none.

    Raises
    ------
    NotOwnFileError
        If a link or something else has its name.
    OSError
        If it cannot be made.
    """
    try:
        with new_file(path):
            pass
    except FileExistsError:
        if not stat.S_ISREG(path.lstat().st_mode):
            raise NotOwnFileError(path, "is no regular file") from None


def new_file(path: Path, buffering: int = -1) -> BinaryIO:
    """Open a file that does not exist yet, for bytes.

    Raises
    ------
    OSError
        If it exists, also as a link to nothing, or cannot be made.
    """
    return path.open("xb", buffering=buffering)


def rename(source: Path, target: Path) -> None:
    """Give a file or folder another name, in the place of what has it; a link there is replaced, not followed.

    Raises
    ------
    OSError
        If that cannot be.
    """
    os.replace(source, target)  # noqa: PTH105  # the tests of crashes count the steps of os


def replace_empty_folder(source: Path, target: Path) -> None:
    """Give a folder the name and the permissions of an empty one; at any instant one of them has the name.

    Raises
    ------
    OSError
        If there is something in the folder, or it cannot give way.
    """
    source.chmod(stat.S_IMODE(target.lstat().st_mode))
    if os.name != "posix":  # elsewhere no folder is replaced
        target.rmdir()
    rename(source, target)


def require_no_link_between(folder: Path, within: Path) -> None:
    """Refuse a folder to which a link leads from one above it.

    Raises
    ------
    NotOwnFileError
    """
    while folder != within and folder != folder.parent:
        if folder.is_symlink():
            finding = f"is a link to {folder.readlink()}"
            raise NotOwnFileError(folder, finding)
        folder = folder.parent


def _require_own_name(path: Path) -> None:
    if not _OWN_NAME.fullmatch(path.name):
        raise NotOwnFileError(path, "is no name that orip gives a file")


_PAUSE_SECONDS = 0.05


@contextmanager
def locked(path: Path, shown: str, *, timeout: float = 10.0) -> Iterator[None]:
    """Let one process at a time into the block; whoever is killed leaves no lock behind.

    Where the operating system or the disk knows no such locks, the block runs without one.

    Parameters
    ----------
    path : Path
        A file that is there; it is not changed.
    shown : str
        As the user would name it.
    timeout : float
        Seconds to wait for another process.

    Raises
    ------
    LockedError
        If another process holds the lock after `timeout`.
    OSError
        If the file cannot be opened, or is no regular file.
    """
    with open_regular(path) as file:
        deadline = time.monotonic() + timeout
        while not _taken(file):
            if time.monotonic() > deadline:
                message = f"{shown} is locked by another run of orip; wait for it, or end it, and repeat the command"
                raise LockedError(message)
            time.sleep(_PAUSE_SECONDS)
        yield  # closing the file releases the lock


def _taken(file: BinaryIO) -> bool:
    """Take the lock; tell whether nobody else holds it."""
    if sys.platform != "win32":
        import fcntl

        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a disk without locks
            return True
    return True
