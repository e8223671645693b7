"""Texts and new folders that are written as a whole or not at all, under temporary names."""

from __future__ import annotations

import errno
import hashlib
import itertools
import os
import platform
import re
import secrets
import stat
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path, PurePath

from orip.errors import OripError
from orip.files.text.own_files import (
    discard,
    make_folder,
    make_named_folder,
    new_file,
    remove_file,
    remove_folder,
    rename,
)
from orip.files.text.regular_file import NoRegularFileError, file_of, kind_of_no_file, regular_bytes

# A process number alone is not enough: another host that shares the folder has the same numbers, and numbers are
# reused. The name therefore also has the host and the start time of the process.

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


def write_output(path: Path, data: str | bytes, consequence: str = "name another file") -> None:
    """Write an output of a command that no project vouches for, and remove what a killed run has left beside it.

    Raises
    ------
    OripError
        If it cannot be written, with what to do.
    """
    with reporting_failure(str(path), consequence):
        with suppress(OSError):
            remove_leftovers(path.parent)
        replace_bytes(path, data.encode() if isinstance(data, str) else data)


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


def write_new_folder(folder: Path, texts: Mapping[str, str | bytes]) -> None:
    """Write files into a folder that does not exist yet, or has none of them.

    A new folder is made under a temporary name beside its place, and only then takes its own: killed at any instant,
    there is no folder or a whole one. An empty folder that exists stays the same folder (somebody may be working in
    it): its texts arrive in their order, so that the one that makes sense of the others should be the last.

    Parameters
    ----------
    folder : Path
        Folders above it are made.
    texts : mapping of file name to text or bytes
        In the order of writing.

    Raises
    ------
    OSError
        If the folder or the disk refuses; what was written is removed.
    """
    folder = file_of(folder)
    if folder.exists():
        _fill(folder, texts)
        return
    make_named_folder(folder.parent)
    remove_leftovers(folder.parent)
    temporary = temporary_beside(folder)
    try:
        make_folder(temporary)
        _fill(temporary, texts)
        rename(temporary, folder)
    except BaseException:  # an interrupt must not leave the temporary folder behind either
        with suppress(OSError):
            remove_folder(temporary)
        raise


def was_left(path: Path, texts: Mapping[str, str | bytes]) -> bool:
    """Tell whether a killed run has written this file into a folder: one of the texts, except the last."""
    *first, _ = texts
    if path.name not in first or path.is_symlink():
        return False
    text = texts[path.name]
    try:
        return regular_bytes(path) == (text if isinstance(text, bytes) else text.encode("utf-8"))
    except OSError:
        return False


def _fill(folder: Path, texts: Mapping[str, str | bytes]) -> None:
    written = []
    try:
        for name, text in texts.items():
            written.append(folder / name)
            if isinstance(text, bytes):
                replace_bytes(folder / name, text)
            else:
                replace_text(folder / name, text)
    except BaseException:
        for path in written:
            with suppress(OSError):
                discard(path)
        raise


_UNFIT = frozenset('/\\:*?"<>|')
_LONGEST = 200
"""Bytes; file systems take 255."""
_DEVICES = frozenset({"CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"}) | {
    f"{port}{number}" for port in ("COM", "LPT") for number in "0123456789¹²³"
}
"""What Windows takes for a device, whatever follows after a dot."""


def exported_file_names(pattern: str, names: Sequence[str], taken: Iterable[str] = ()) -> list[str]:
    """Return names of files that an export makes of names in the data: each a file of its own in the export's folder.

    What no file name can have on any system becomes ``_``, a name that is too long is cut, and what is then the same
    as another, on systems where case does not count, gets a number.

    Parameters
    ----------
    pattern : str
        Of the files, such as ``Orientation-{}.xml``.
    names : sequence of str
        From the data: they may be anything.
    taken : iterable of str
        Other files of the export.
    """
    used = {name.casefold() for name in taken}
    found = []
    for name in names:
        base, number = _fit_exported(name, _LONGEST - len(pattern.encode()) - 8), 1
        fit = pattern.format(base)
        while fit.casefold() in used:
            number += 1
            fit = pattern.format(f"{base}_{number}")
        used.add(fit.casefold())
        found.append(fit)
    return found


def is_one_file_name(name: str) -> bool:
    """Tell whether a name is that of a file in the folder that it is put into, and leads nowhere else."""
    is_windows_path = os.name == "nt" and (":" in name or "\\" in name)
    return PurePath(name).name == name and name not in {"", ".", ".."} and "\0" not in name and not is_windows_path


def is_device(name: str) -> bool:
    """Tell whether Windows takes a name of a file for a device; what follows after a dot does not count."""
    return name.partition(".")[0].rstrip().upper() in _DEVICES


def _fit_exported(name: str, longest: int) -> str:
    fit = "".join(c if (c.isprintable() or c == " ") and c not in _UNFIT else "_" for c in name)
    while len(fit.encode("utf-8")) > longest:
        fit = fit[: longest if len(fit) > longest else -1]
    fit = fit.rstrip(". ") or "_"  # Windows drops dots and blanks at the end
    return f"_{fit}" if is_device(fit) else fit
