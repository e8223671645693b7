"""A project folder under a temporary name, that takes its own when all that belongs into it is there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from orip.errors import UsageError
from orip.files.text.atomic import reporting_failure
from orip.files.text.leftovers import remove_leftovers, temporary_beside
from orip.files.text.own_files import make_named_folder, remove_empty_folder, remove_folder, rename
from orip.files.text.regular_file import file_of


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
    with reporting_failure(str(folder), "name another folder"):
        make_named_folder(target.parent)
        remove_leftovers(target.parent)
        temporary = temporary_beside(target)
    try:
        yield temporary
        with reporting_failure(str(folder), "name another folder"):
            if target.exists():
                remove_empty_folder(target)
            rename(temporary, target)
    except BaseException:  # an interrupt must not leave the temporary folder behind either
        with suppress(OSError):
            remove_folder(temporary)
        raise
