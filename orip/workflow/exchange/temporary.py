"""A project folder under a temporary name, that takes its own when all that belongs into it is there."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from orip.errors import UsageError
from orip.files.text.atomic import reporting_failure
from orip.files.text.leftovers import remove_leftovers, temporary_beside
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
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_leftovers(target.parent)
        temporary = temporary_beside(target)
    try:
        yield temporary
        with reporting_failure(str(folder), "name another folder"):
            if target.exists():
                target.rmdir()
            os.replace(temporary, target)  # noqa: PTH105  # as new folders are made
    except BaseException:  # an interrupt must not leave the temporary folder behind either
        shutil.rmtree(temporary, ignore_errors=True)
        raise
