"""A folder under a temporary name, that takes its own when all that belongs into it is there."""

from __future__ import annotations

import errno
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from orip.errors import UsageError
from orip.files.text.atomic import remove_leftovers, reporting_failure, temporary_beside, was_left, write_new_folder
from orip.files.text.own_files import make_named_folder, remove_folder, rename, replace_empty_folder
from orip.files.text.regular_file import file_of

_REMEDY = "name another folder"
_CANNOT_GIVE_WAY = {errno.EBUSY, errno.EXDEV, errno.EACCES, errno.EPERM, errno.EROFS}
"""A folder in which a disk is mounted, or beside which nothing may be made."""


@contextmanager
def folder_in_the_making(folder: Path) -> Iterator[Path]:
    """Give a path beside a folder that does not exist yet, or is empty; what is made there then takes its place.

    If anything goes wrong, nothing is left behind.

    Raises
    ------
    UsageError
        If the folder has something in it.
    OripError
        If it cannot be made.
    """
    target = file_of(folder)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        message = f"{folder} has something in it already; name a new or empty folder"
        raise UsageError(message)
    with reporting_failure(str(folder), _REMEDY):
        make_named_folder(target.parent)
        remove_leftovers(target.parent)
        temporary = temporary_beside(target)
    try:
        yield temporary
        with reporting_failure(str(folder), _REMEDY):
            _put_in_place(temporary, target)
    except BaseException:  # an interrupt must not leave the temporary folder behind either
        with suppress(OSError):
            remove_folder(temporary)
        raise


def _put_in_place(temporary: Path, target: Path) -> None:
    """Give a folder its name; an empty one that has it gives way, and there is one of them at any instant."""
    if target.exists():
        replace_empty_folder(temporary, target)
    else:
        rename(temporary, target)


def write_whole_folder(folder: Path, texts: Mapping[str, str | bytes], rule: str) -> None:
    """Write files into a folder that does not exist yet, or is empty: all of them at one instant, or none.

    A folder that somebody works in, or where a disk is mounted, stays the same folder: its files arrive one after the
    other, and when that was interrupted the same command goes on from there.

    Parameters
    ----------
    texts : mapping of file name to text or bytes
        The one that makes sense of the others last.
    rule : str
        What is said of a folder that has something in it.

    Raises
    ------
    UsageError
        If the folder has something in it.
    OSError
        If it cannot be written.
    """
    target = file_of(folder)
    if target.is_dir():
        remove_leftovers(target)
    if target.exists() and (not target.is_dir() or any(not was_left(path, texts) for path in target.iterdir())):
        message = f"{folder} has something in it already; {rule}"
        raise UsageError(message)
    if target.is_dir() and (any(target.iterdir()) or _is_worked_in(target)):
        write_new_folder(target, texts)
        return
    make_named_folder(target.parent)
    temporary = temporary_beside(target)
    try:
        write_new_folder(temporary, texts)
        _put_in_place(temporary, target)
    except BaseException as error:  # an interrupt must not leave the temporary folder behind either
        with suppress(OSError):
            remove_folder(temporary)
        if not isinstance(error, OSError) or error.errno not in _CANNOT_GIVE_WAY or not target.is_dir():
            raise
        write_new_folder(target, texts)


def _is_worked_in(folder: Path) -> bool:
    """Tell whether it is the folder of this process, and so of the shell that has started it."""
    try:
        return folder.samefile(Path.cwd())
    except OSError:
        return False
