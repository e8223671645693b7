"""Files that tie the journals of several stores together, left by a run killed in the first instant of a commit.

SQLite names such a file in the journal of each store, and commits by removing it. If no journal names it, the commit
had not begun, and nobody will ever remove it. While a journal names it, it must stay: without it that journal would
count as one of a finished commit.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from orip.files.text.regular_file import open_regular

_ENDING = re.compile(r"-mj[0-9A-F]{8,9}")
_NAME_AT_END = 4096
"""Bytes at the end of a journal that hold the name."""


def remove_orphans(stores: Iterable[Path]) -> None:
    """Remove the orphans of stores.

    Parameters
    ----------
    stores : iterable of Path
        Files that this process has locked for writing: no other process can be committing from them.
    """
    for store in stores:
        for path in _super_journals(store):
            journals = {*store.parent.glob("*-journal"), *_journals_in(path)}
            if not any(_names(journal, path.name) for journal in journals):
                with suppress(OSError):
                    path.unlink()


def _super_journals(store: Path) -> list[Path]:
    with suppress(OSError):
        found = [path for path in store.parent.iterdir() if path.name.startswith(f"{store.name}-mj")]
        return [path for path in found if _ENDING.fullmatch(path.name.removeprefix(store.name))]
    return []


def _journals_in(path: Path) -> list[Path]:
    """Return the journals that a super-journal lists; some may be in other folders."""
    with suppress(OSError, ValueError), open_regular(path) as file:
        names = file.read().decode("utf-8", "surrogateescape").split("\0")
        return [Path(name) for name in names if name.endswith("-journal")]
    return []


def _names(journal: Path, name: str) -> bool:
    try:
        with open_regular(journal) as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - _NAME_AT_END))
            return name.encode() in file.read()
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True  # what cannot be read may name it
