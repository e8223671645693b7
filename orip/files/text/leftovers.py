"""Temporary files: their names say whose they are, so that those of killed runs can be told from those in use.

A process number alone is not enough: another host that shares the folder has the same numbers, and numbers are reused.
The name therefore also has the host and the start time of the process.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import secrets
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

from orip.files.text.own_files import remove_file, remove_folder

_NAME = re.compile(r"\.orip-(?P<host>[0-9a-f]{8})-(?P<process>[0-9]{1,18})-(?P<began>[0-9]{1,20})-[0-9a-f]{16}\.tmp")
_FOREIGN_AGE_SECONDS = 86400.0
"""Whether a process of another host still runs cannot be asked; no text takes a day to write."""

_PLACE_OF_BEGIN = 19
"""Place of the start time (clock ticks since the machine's start) among the fields of /proc/PID/stat after the name."""


def temporary_beside(target: Path) -> Path:
    """Return the name under which a file or folder may be made before it takes its own, in the same folder."""
    process = os.getpid()
    return target.with_name(f".orip-{_host()}-{process}-{_began(process) or 0}-{secrets.token_hex(8)}.tmp")


def remove_leftovers(folder: Path) -> list[str]:
    """Remove the temporary files and folders that killed runs have left in a folder, and return their names.

    Those of this host go when their process is gone; those of other hosts when they are a day old.
    """
    removed = []
    for path in sorted(folder.iterdir()):
        match = _NAME.fullmatch(path.name)
        if match is None:
            continue
        with suppress(OSError):  # another run may have removed it first
            if _is_leftover(path, match):
                (remove_folder if path.is_dir() else remove_file)(path)
                removed.append(path.name)
    return removed


def _is_leftover(path: Path, name: re.Match[str]) -> bool:
    if name["host"] != _host() or os.name != "posix":  # elsewhere a signal of 0 is not harmless
        return path.lstat().st_mtime < time.time() - _FOREIGN_AGE_SECONDS
    process = int(name["process"])
    return not _is_running(process) or (_began(process) or 0) != int(name["began"])


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def _began(process: int) -> int | None:
    """Return when a process began, as the system counts; None where it does not tell."""
    try:
        fields = Path(f"/proc/{process}/stat").read_bytes().rpartition(b")")[2].split()
        return int(fields[_PLACE_OF_BEGIN])
    except (OSError, IndexError, ValueError):
        return None


@cache
def _host() -> str:
    """Return what tells hosts apart; containers of one name and different process numbers are different hosts."""
    numbers = ""
    with suppress(OSError):
        numbers = os.readlink("/proc/self/ns/pid")  # noqa: PTH115  # the text of the link is what counts
    return hashlib.blake2b(f"{platform.node()}\0{numbers}".encode(), digest_size=4).hexdigest()
