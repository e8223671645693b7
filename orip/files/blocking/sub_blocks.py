"""A folder with the arrays of each sub-block in a file of its own (NumPy's .npz), named by what is in all of them.

A folder that is complete is never changed; its marker is written last.
"""

from __future__ import annotations

import hashlib
import shutil
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orip.files.text.atomic import reporting_failure

FOLDER = ".orip-sub-blocks"
"""Within the folder of a project."""

Arrays = Mapping[str, NDArray[np.generic]]


def marker_of(folder: Path) -> Path:
    """Return the file that says that a folder is complete."""
    return folder / "complete"


def write_sub_blocks(within: Path, sub_blocks: Sequence[Arrays]) -> Path:
    """Write sub-blocks unless they are there, and return their folder; others that are there are removed.

    Parameters
    ----------
    within : Path
        The folder of a project.
    sub_blocks : sequence of mappings of name to array

    Raises
    ------
    OripError
        If the files cannot be written.
    """
    root = within / FOLDER
    folder = root / _digest(sub_blocks)
    if marker_of(folder).exists():
        return folder
    with reporting_failure(root, "remove the cause, then repeat the command"):
        with suppress(FileNotFoundError):
            shutil.rmtree(root)
        folder.mkdir(parents=True)
        for number, arrays in enumerate(sub_blocks):
            with _file(folder, number).open("wb") as file:
                np.savez(file, allow_pickle=False, **arrays)
        marker_of(folder).touch()
    return folder


def read_sub_block(folder: Path, number: int) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of a sub-block.

    Raises
    ------
    OSError
        If its file is not there.
    ValueError
        If it is damaged.
    """
    path = _file(folder, number)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return dict(arrays)
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError) as error:
        message = f"{path} is damaged ({error}); remove {folder}, then repeat the command"
        raise ValueError(message) from None


def _file(folder: Path, number: int) -> Path:
    return folder / f"{number:06d}.npz"


def _digest(sub_blocks: Sequence[Arrays]) -> str:
    found = hashlib.sha256()
    for arrays in sub_blocks:
        for name, array in arrays.items():
            found.update(f"{name} {array.dtype.str} {array.shape} ".encode())
            found.update(np.ascontiguousarray(array).data)
    return found.hexdigest()[:32]
