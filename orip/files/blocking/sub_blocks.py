"""A folder with the arrays of each sub-block in a file of its own (NumPy's .npz), named by what is in all of them.

A folder that is complete is never changed; its marker is written last. The folder of a project may come from anybody: a
folder that does not hold what its name says is made again, and whoever reads a file compares it with its digest.
"""

from __future__ import annotations

import hashlib
import re
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from io import BufferedReader
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.files.text.atomic import remove_leftovers, reporting_failure, temporary_beside
from orip.files.text.own_files import make_file, make_folder, new_file, remove_folder, rename
from orip.files.text.regular_file import open_regular

FOLDER = ".orip-sub-blocks"
"""Within the folder of a project."""

_DIGITS = 32
_NAME = re.compile(rf"[0-9a-f]{{{_DIGITS}}}")

Arrays = Mapping[str, NDArray[np.generic]]


class WrittenSubBlocks(Struct, frozen=True):
    """Sub-blocks in files.

    Parameters
    ----------
    folder : Path
    digests : tuple of str
        SHA-256 of the file of each of them.
    """

    folder: Path
    digests: tuple[str, ...]


def marker_of(folder: Path) -> Path:
    """Return the file that says that a folder is complete."""
    return folder / "complete"


def write_sub_blocks(within: Path, sub_blocks: Iterable[Arrays]) -> WrittenSubBlocks:
    """Write sub-blocks, one after the other; others that are there are removed.

    Parameters
    ----------
    within : Path
        The folder of a project.
    sub_blocks : iterable of mappings of name to array

    Raises
    ------
    OripError
        If the files cannot be written, or a link stands in the place of their folder.
    """
    root, digests = within / FOLDER, list[str]()
    with reporting_failure(root, "remove the cause, then repeat the command"):
        make_folder(root)
        remove_leftovers(root)
        made = temporary_beside(root / "sub-blocks")
        try:
            make_folder(made)
            for number, arrays in enumerate(sub_blocks):
                with new_file(_file(made, number)) as file:
                    np.savez(file, allow_pickle=False, **arrays)
                with _file(made, number).open("rb") as file:
                    digests.append(_digest(file))
            folder = root / hashlib.sha256(" ".join(digests).encode()).hexdigest()[:_DIGITS]
            if not _holds(folder, digests):
                _remove_others(root)
                rename(made, folder)
                make_file(marker_of(folder))
        finally:
            with suppress(OSError):
                remove_folder(made)
    return WrittenSubBlocks(folder, tuple(digests))


def _holds(folder: Path, digests: Iterable[str]) -> bool:
    """Tell whether a folder is complete, and holds these sub-blocks."""
    if folder.is_symlink() or not marker_of(folder).is_file():
        return False
    try:
        for number, digest in enumerate(digests):
            with open_regular(_file(folder, number)) as file:
                if _digest(file) != digest:
                    return False
    except OSError:
        return False
    return True


def _remove_others(root: Path) -> None:
    """Remove the sub-blocks that were adjusted before; temporary files are those of runs that go on."""
    for path in root.iterdir():
        if _NAME.fullmatch(path.name):
            remove_folder(path)


def read_sub_block(folder: Path, number: int, digest: str) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of a sub-block.

    Parameters
    ----------
    folder : Path
    number : int
    digest : str
        SHA-256 of what was written.

    Raises
    ------
    OSError
        If its file is not there, or is no regular file.
    ValueError
        If it does not hold what was written.
    """
    path = _file(folder, number)
    try:
        with open_regular(path) as file:
            if _digest(file) != digest:  # nothing is made of what somebody else has written
                raise _damaged(path, "it does not hold what was written")
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                return dict(arrays)
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError) as error:
        raise _damaged(path, str(error)) from None


def _damaged(path: Path, finding: str) -> ValueError:
    return ValueError(f"{path} is damaged ({finding}); repeat the command, which writes it again")


def _file(folder: Path, number: int) -> Path:
    return folder / f"{number:06d}.npz"


def _digest(file: BufferedReader) -> str:
    return hashlib.file_digest(file, "sha256").hexdigest()
