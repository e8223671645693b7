"""A folder with the arrays of each sub-block in a file of its own (NumPy's .npz), named by what is in all of them.

The marker of a folder that is complete is written last. The folder of a project may come from elsewhere: what is there
is replaced by equal files, and none is removed through a link.
"""

from __future__ import annotations

import errno
import hashlib
import shutil
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orip.files.text.atomic import reporting_failure
from orip.files.text.leftovers import remove_leftovers, temporary_beside

FOLDER = ".orip-sub-blocks"
"""Within the folder of a project."""

Arrays = Mapping[str, NDArray[np.generic]]


def marker_of(folder: Path) -> Path:
    """Return the file that says that a folder is complete."""
    return folder / "complete"


def write_sub_blocks(within: Path, sub_blocks: Iterable[Arrays]) -> Path:
    """Write sub-blocks, one after the other, and return their folder; others that are there are removed.

    Parameters
    ----------
    within : Path
        The folder of a project.
    sub_blocks : iterable of mappings of name to array

    Raises
    ------
    OripError
        If the files cannot be written.
    """
    root, digest = within / FOLDER, hashlib.sha256()
    with reporting_failure(root, "remove the cause, then repeat the command"):
        if root.is_symlink():
            raise OSError(errno.ELOOP, "it is a link, and what it leads to would be cleared")
        root.mkdir(parents=True, exist_ok=True)
        remove_leftovers(root)
        made = temporary_beside(root / "sub-blocks")
        try:
            made.mkdir()
            for number, arrays in enumerate(sub_blocks):
                _add(digest, arrays)
                with _file(made, number).open("wb") as file:
                    np.savez(file, allow_pickle=False, **arrays)
            folder = root / digest.hexdigest()[:32]
            if folder.is_dir() and not folder.is_symlink():
                for path in made.iterdir():
                    path.replace(folder / path.name)
            else:
                _remove_others(root)
                made.rename(folder)
            marker_of(folder).touch()
        finally:
            shutil.rmtree(made, ignore_errors=True)
    return folder


def _remove_others(root: Path) -> None:
    """Remove the sub-blocks that were adjusted before; temporary files are those of runs that go on."""
    for path in root.iterdir():
        if not path.name.startswith("."):
            shutil.rmtree(path)


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


def _add(digest: hashlib._Hash, arrays: Arrays) -> None:
    for name, array in arrays.items():
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        digest.update(np.ascontiguousarray(array).data)
