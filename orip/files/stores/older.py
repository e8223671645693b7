"""Stores that an older orip wrote: this one refuses them, and they can be set aside so that new ones are made."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from orip.errors import InputError
from orip.files.stores.schema import APPLICATION_ID, SCHEMA_VERSION
from orip.files.text.own_files import make_folder, rename
from orip.files.text.regular_file import kind_of_no_file

OLDER_STORES = "older-stores"
"""The folder, beside the stores, into which they are moved."""

_VERSION, _APPLICATION, _END = 60, 68, 72
"""Where the header of an SQLite file has user_version and application_id, four bytes each (sqlite.org/fileformat)."""


def is_older_store(path: Path) -> bool:
    """Return whether a file is a store of orip with an earlier schema."""
    # a file of the running system may keep its reader waiting
    if not path.is_file() or kind_of_no_file(path.stat()) is not None:
        return False
    with path.open("rb") as file:
        header = file.read(_END)
    application = int.from_bytes(header[_APPLICATION:_END], "big", signed=True)
    return application == APPLICATION_ID and int.from_bytes(header[_VERSION : _VERSION + 4], "big") < SCHEMA_VERSION


def refuse_older_stores(paths: Iterable[Path]) -> None:
    """Refuse all of the stores that an older orip wrote at once.

    Raises
    ------
    InputError
        If there is one.
    """
    older = list[Path]()
    for path in paths:
        with suppress(OSError):  # whoever opens the store tells what is in the way
            older += [path] if is_older_store(path) else []
    if older:
        raise older_stores_refused(older)


def older_stores_refused(paths: Sequence[Path]) -> InputError:
    """Return the error that names stores which an older orip wrote, and says what to do."""
    these, them, new = (
        ("this store was", "it", "a new one") if len(paths) == 1 else ("these stores were", "them", "new ones")
    )
    message = (
        f"{these} written by an older orip (this one writes schema {SCHEMA_VERSION}); bring what was edited in {them} "
        f"into the text with that orip ('orip export-toml'), and move {them} away: 'orip run' creates {new}"
    )
    return InputError.single(message, ", ".join(map(str, paths)))


def set_older_stores_aside(paths: Iterable[Path]) -> list[Path]:
    """Move those of the stores that an older orip wrote into a folder of their own, and return where they are.

    What is there from an earlier time stays.

    Raises
    ------
    OSError
        If they cannot be moved.
    """
    moved = []
    for path in filter(is_older_store, paths):
        folder = path.parent / OLDER_STORES
        make_folder(folder)
        target = folder / path.name
        number = 1
        while os.path.lexists(target):
            number += 1
            target = folder / f"{path.name}.{number}"
        rename(path, target)
        moved.append(target)
    return moved
