"""Text files that are replaced as a whole: a reader sees the old text or the new one, never a part."""

from __future__ import annotations

import errno
import itertools
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from orip.errors import OripError
from orip.files.text.leftovers import temporary_beside
from orip.files.text.own_files import discard, new_file, rename
from orip.files.text.regular_file import NoRegularFileError, kind_of_no_file

_BUFFER_BYTES = 1 << 20
_LINES_AT_A_TIME = 1000


@contextmanager
def reporting_failure(shown: str | Path, consequence: str) -> Iterator[None]:
    """Explain to the user why a file cannot be written.

    Parameters
    ----------
    shown : str or Path
        The file, as the user would name it.
    consequence : str
        What this means and what to do, as the message goes on after the reason.

    Raises
    ------
    OripError
        In place of an `OSError` of the block.
    """
    try:
        yield
    except OSError as error:
        reason = "there is no such folder" if error.errno == errno.ENOENT else error.strerror or error
        message = f"{shown} cannot be written: {reason}; {consequence}"
        raise OripError(message) from error


def replace_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 so that it is whole at any instant, even if the process is killed.

    The text goes to a temporary file in the same folder, to the disk, and only then takes the name. A link gives way
    to the text; the file that it leads to stays as it is. An existing file's permissions are kept; a new one has those
    of any new file.

    Raises
    ------
    NoRegularFileError
        If a folder, a device or a pipe has the name, or a link leads to one.
    OSError
        If the folder or the disk refuses; the old file is then unchanged, and no temporary file is left behind.
    UnicodeEncodeError
        If the text has half a surrogate pair; the old file is then unchanged too.
    """
    replace_in_pieces(path, [text])


def replace_in_pieces(path: Path, pieces: Iterable[str | bytes | memoryview]) -> None:
    """Do what `replace_text` does with a text, or bytes, too large to be in memory as a whole.

    Raises
    ------
    OSError, UnicodeEncodeError
        As `replace_text`.
    """
    _replace(path, (piece.encode("utf-8") if isinstance(piece, str) else piece for piece in pieces))


def replace_bytes(path: Path, data: bytes) -> None:
    """Do what `replace_text` does with bytes.

    Raises
    ------
    OSError
        As `replace_text`.
    """
    _replace(path, [data])


def require_no_link(path: Path) -> None:
    """Refuse to edit a text through a link: a new text in place of the link would separate what was shared, unnoticed.

    Raises
    ------
    OSError
        With the place that the link leads to.
    """
    if path.is_symlink():
        reason = f"it is a link to {path.readlink()}; change that file, or put the file itself in the place of the link"
        raise OSError(errno.ELOOP, reason)


def lines_in_pieces(lines: Iterable[str]) -> Iterator[str]:
    """Yield lines without newlines as text, many of them at a time."""
    left = iter(lines)
    while some := list(itertools.islice(left, _LINES_AT_A_TIME)):
        yield "\n".join(some) + "\n"


def _replace(path: Path, pieces: Iterable[bytes | memoryview]) -> None:
    mode = _mode_of(path)
    temporary = temporary_beside(path)
    try:
        _write_through(temporary, pieces, mode)
        rename(temporary, path)
    except BaseException:  # an interrupt must not leave the temporary file behind either
        with suppress(OSError):
            discard(temporary)
        raise
    flush_folder(path.parent)


def _mode_of(path: Path) -> int | None:
    """Return the permissions of an existing file, None of a new one; refuse what is not a file.

    Bits that let others run it as its owner are no permissions: a stranger may have set them.
    """
    try:
        kind = kind_of_no_file(path.stat())
        if kind is not None:
            raise NoRegularFileError(kind)
        status = path.lstat()
        return None if stat.S_ISLNK(status.st_mode) else stat.S_IMODE(status.st_mode) & 0o777
    except FileNotFoundError:
        return None


def _write_through(temporary: Path, pieces: Iterable[bytes | memoryview], mode: int | None) -> None:
    with new_file(temporary, _BUFFER_BYTES) as stream:
        for piece in pieces:
            stream.write(piece)
        stream.flush()
        if mode is not None:
            temporary.chmod(mode)
        os.fsync(stream.fileno())


def flush_folder(folder: Path) -> None:
    """Bring the new name to the disk; some systems cannot, but the text is in place nevertheless."""
    if os.name != "posix":
        return
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
