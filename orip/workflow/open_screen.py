"""One `orip screen` at a time has a project: its lock, and the address of its page for other commands."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from orip.errors import LockedError
from orip.files.text.own_files import locked, make_file, make_folder
from orip.images import TILE_FOLDER

_MEANWHILE_S = 0.5
"""Seconds to wait for the lock: commands that look whether a screen is open have it for an instant."""


@contextmanager
def only_screen(folder: Path) -> Iterator[None]:
    """Keep other screens from a project meanwhile.

    Raises
    ------
    LockedError
        If another one has it.
    """
    path = _lock(folder)
    with ExitStack() as held:
        try:
            make_folder(path.parent)
            make_file(path)
            held.enter_context(locked(path, "the project", timeout=_MEANWHILE_S))
        except LockedError:
            message = (
                "the project is on another screen: measure on that page ('orip status' has its address), or end the "
                "'orip screen' that serves it (Ctrl-C) and repeat the command"
            )
            raise LockedError(message) from None
        except OSError:  # a project that cannot be written to: what is measured there will say so
            pass
        yield


def open_screen(folder: Path) -> str:
    """Return the address of the page of the `orip screen` that this user has open on a project; empty without one."""
    path = _lock(folder)
    if not path.is_file():
        return ""
    try:
        with locked(path, "the project", timeout=0.0):
            return ""  # it was left by one that has ended
    except LockedError:
        from orip.web.access import stored_page  # it takes time to import

        return stored_page(folder) or ""
    except OSError:
        return ""


def _lock(folder: Path) -> Path:
    return folder / TILE_FOLDER / "screen"
