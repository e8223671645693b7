"""Opening files of the user's: regular files alone, of a size that a text can have; their order and digest."""

from __future__ import annotations

import codecs
import errno
import hashlib
import os
import re
import stat
from functools import cache
from io import BufferedReader
from pathlib import Path

# A pipe keeps its reader waiting, a device may never end, and a file of /proc may do both. All of them are recognised
# by their kind and refused before anything is read.

LARGEST_FILE = 1 << 30
"""Bytes that are read of a file: some ten million lines."""

UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""Byte order marks."""

_OPENING = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)
_SYSTEM_FOLDERS = ("/proc", "/sys")
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe (FIFO)"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class NoRegularFileError(OSError):
    """What has the name of a file is something else; `kind` says what."""

    def __init__(self, kind: str) -> None:
        super().__init__(errno.EINVAL, f"this is {kind}, not a file")
        self.kind = kind


def file_of(path: Path) -> Path:
    """Return the file that a name leads to through all links, as an absolute path; links in a circle stay as they are.

    Raises
    ------
    ValueError
        If the name has a zero character.
    """
    return Path(os.path.realpath(path))


def kind_of_no_file(status: os.stat_result) -> str | None:
    """Say what something is that is no regular file on a disk; None of one that is."""
    for is_kind, name in _KINDS:
        if is_kind(status.st_mode):
            return name
    return "a file of the running system" if status.st_dev in _system_devices() else None


def is_there(path: Path) -> bool:
    """Tell whether there is something of a name that came from data: it may be none that a file can have."""
    try:
        return path.exists()
    except (OSError, ValueError):  # too long, or with a zero character
        return False


def open_regular(path: Path, largest: int = LARGEST_FILE) -> BufferedReader:
    """Open a regular file for reading.

    Parameters
    ----------
    largest : int, optional
        Bytes that it may have.

    Raises
    ------
    NoRegularFileError
        If it is anything else; nothing waits for a pipe.
    OSError
        If it cannot be opened, or is larger than `largest`.
    ValueError
        If the name has a zero character.
    """
    # looked at before it is opened: opening alone may do something to a device
    _require_regular(os.stat(path), largest)  # noqa: PTH116  # the same look at the name as at the descriptor below
    descriptor = os.open(path, _OPENING)
    try:
        _require_regular(os.fstat(descriptor), largest)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def regular_bytes(path: Path) -> bytes:
    """Return the bytes of a regular file.

    Raises
    ------
    OSError, ValueError
        As `open_regular`; also if the file has grown beyond `LARGEST_FILE`.
    """
    with open_regular(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        # room for the file alone: that of the largest one would be asked of the system for each
        data = stream.read(size + 1)
        if len(data) > size:
            data += stream.read(LARGEST_FILE + 1 - len(data))
    if len(data) > LARGEST_FILE:
        raise _too_large(LARGEST_FILE)
    return data


def beginning(path: Path, size: int) -> str:
    """Return the first characters of a text file, at most `size`; none of what is missing or no regular file."""
    try:
        with open_regular(path) as stream:
            data = stream.read(4 * size)
    except (OSError, ValueError):
        return ""
    return data.decode("utf-16" if data.startswith(UTF_16) else "utf-8-sig", errors="replace")[:size]


def _require_regular(status: os.stat_result, largest: int) -> None:
    kind = kind_of_no_file(status)
    if kind is not None:
        raise NoRegularFileError(kind)
    if status.st_size > largest:
        raise _too_large(largest)


def _too_large(largest: int) -> OSError:
    return OSError(errno.EFBIG, f"it is larger than {largest >> 20} MiB")


@cache
def _system_devices() -> frozenset[int]:
    """Return the devices of what the system shows of itself as files, where it does."""
    devices = set()
    for folder in map(Path, _SYSTEM_FOLDERS):
        if folder.is_mount():
            devices.add(folder.stat().st_dev)
    return frozenset(devices)


def text_digest(text: str) -> str:
    """Return the digest that a file with a text has."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


DIGEST_OF_NOTHING = hashlib.sha256().hexdigest()
"""What `file_digest` returns of an empty file."""


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes as 64 hexadecimal digits.

    Raises
    ------
    OSError
        If the file cannot be read, or is no regular file.
    """
    with open_regular(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sort key in which runs of digits count as numbers."""
    parts = re.findall(r"\d+|\D+", name)
    return tuple((0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts)
