"""A new folder of files, created as a whole or not at all, with names that are made of names in the data."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path, PurePath

from orip.files.text.atomic import remove_leftovers, replace_bytes, replace_text, temporary_beside
from orip.files.text.own_files import discard, make_folder, make_named_folder, remove_folder, rename
from orip.files.text.regular_file import file_of, regular_bytes


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
