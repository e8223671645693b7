"""Text files that are replaced as a whole: a reader sees the old text or the new one, never a part."""

from __future__ import annotations

import itertools
import os
import re
import secrets
import shutil
import stat
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from orip.errors import OripError

_LEFTOVER = re.compile(r"\.orip-([0-9]{1,18})-[0-9a-f]{16}\.tmp")
_PROCESS_START = time.time()
# A file's time may lag behind the clock by its system's tick, on network disks by more.
_CLOCK_MARGIN_SECONDS = 2.0
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
        message = f"{shown} cannot be written: {error.strerror or error}; {consequence}"
        raise OripError(message) from error


def replace_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 so that it is whole at any instant, even if the process is killed.

    The text goes to a temporary file in the same folder, to the disk, and only then takes the name. A link is
    followed. An existing file's permissions are kept; a new one has those of any new file.

    Raises
    ------
    OSError
        If the folder or the disk refuses; the old file is then unchanged, and no temporary file is left behind.
    UnicodeEncodeError
        If the text has half a surrogate pair; the old file is then unchanged too.
    """
    replace_text_in_pieces(path, [text])


def replace_text_in_pieces(path: Path, pieces: Iterable[str]) -> None:
    """Do what `replace_text` does with a text that is too large to be in memory as a whole.

    Raises
    ------
    OSError, UnicodeEncodeError
        As `replace_text`.
    """
    target = Path(os.path.realpath(path))
    temporary = temporary_beside(target)
    try:
        _write_through(temporary, pieces, _mode_of(target))
        temporary.replace(target)
    except BaseException:  # an interrupt must not leave the temporary file behind either
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
    _flush_folder(target.parent)


def temporary_beside(target: Path) -> Path:
    """Return the name under which a file or folder may be made before it takes its own, in the same folder."""
    return target.with_name(f".orip-{os.getpid()}-{secrets.token_hex(8)}.tmp")


def lines_in_pieces(lines: Iterable[str]) -> Iterator[str]:
    """Yield lines without newlines as text, many of them at a time."""
    left = iter(lines)
    while some := list(itertools.islice(left, _LINES_AT_A_TIME)):
        yield "\n".join(some) + "\n"


def remove_leftovers(folder: Path) -> list[str]:
    """Remove the temporary files and folders that killed runs have left in a folder, and return their names.

    One is a leftover if its writer is gone, or if it is older than this process: a process number may by now
    belong to another program.
    """
    removed = []
    for path in sorted(folder.iterdir()):
        match = _LEFTOVER.fullmatch(path.name)
        if match is None:
            continue
        with suppress(OSError):  # another run may have removed it first
            if _is_leftover(path, int(match.group(1))):
                _remove(path)
                removed.append(path.name)
    return removed


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _mode_of(target: Path) -> int | None:
    """Return the permissions of an existing file, None of a new one."""
    try:
        return stat.S_IMODE(target.stat().st_mode)
    except FileNotFoundError:
        return None


def _write_through(temporary: Path, pieces: Iterable[str], mode: int | None) -> None:
    with temporary.open("xb", buffering=_BUFFER_BYTES) as stream:
        for piece in pieces:
            stream.write(piece.encode("utf-8"))
        stream.flush()
        if mode is not None:
            temporary.chmod(mode)
        os.fsync(stream.fileno())


def _flush_folder(folder: Path) -> None:
    """Bring the new name to the disk; some systems cannot, but the text is in place nevertheless."""
    if os.name != "posix":
        return
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _is_leftover(path: Path, writer: int) -> bool:
    older = path.stat().st_mtime < _PROCESS_START - _CLOCK_MARGIN_SECONDS
    return older or not _is_running(writer)


def _is_running(process: int) -> bool:
    if os.name != "posix" or process == os.getpid():
        return True  # elsewhere a signal of 0 is not harmless: age alone decides
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True
