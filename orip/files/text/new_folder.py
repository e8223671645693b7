"""A new folder of files, created as a whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from orip.files.text.atomic import replace_bytes, replace_text
from orip.files.text.leftovers import remove_leftovers, temporary_beside
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
