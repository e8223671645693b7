"""The partitioned store of photo points: a file for each sub-block, read by the workers that compute it."""

from __future__ import annotations

import hashlib
import re
import threading
import zipfile
import zlib
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from io import BufferedReader
from pathlib import Path
from typing import cast

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.archive.blocking.sub_block import SubBlock, loop_of
from orip.archive.cluster.connection import UnfitWorkerError
from orip.bundle.compiled.photo_loop import PhotoPointLoop, is_compiled
from orip.files.text.atomic import remove_leftovers, reporting_failure, temporary_beside
from orip.files.text.own_files import make_file, make_folder, new_file, remove_folder, rename
from orip.files.text.regular_file import open_regular
from orip.records.camera import AdditionalSet
from orip.version import __version__

# A folder that is complete is never changed; its marker is written last. The folder of a project may come from anybody:
# a folder that does not hold what its name says is made again, and whoever reads a file compares it with its digest.

FOLDER = ".orip-sub-blocks"
"""Within the folder of a project."""

_DIGITS = 32
_NAME = re.compile(rf"[0-9a-f]{{{_DIGITS}}}")

Arrays = Mapping[str, NDArray[np.generic]]


class WrittenSubBlocks(Struct, frozen=True):
    """Sub-blocks in files.

    Parameters
    ----------
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


_MOST_RAYS = 3_000_000
"""Photo points whose loops a worker keeps, some 150 bytes each; it reads the others when it needs them again."""

_loops: OrderedDict[tuple[str, str], PhotoPointLoop] = OrderedDict()
_alone = threading.Lock()


class StoredSubBlock(Struct, frozen=True):
    """A sub-block in a file.

    Parameters
    ----------
    digest : str
        Of its file.
    version : str
        Of the orip that wrote it.
    """

    folder: str
    number: int
    digest: str
    version: str = __version__

    def loop(self) -> PhotoPointLoop:
        """Return the compiled loop over its photo points.

        Raises
        ------
        UnfitWorkerError
            If this process has another orip, lacks the compiled loop, or does not see the file.
        """
        key = (self.folder, self.digest)
        with _alone:  # a worker may have several threads
            found = _loops.pop(key, None) or self._read()
            _loops[key] = found
            while sum(len(loop.points.xy) for loop in _loops.values()) > _MOST_RAYS and len(_loops) > 1:
                _loops.popitem(last=False)
        return found

    def _read(self) -> PhotoPointLoop:
        if self.version != __version__:
            message = f"a worker has orip {__version__}, and this is {self.version}; install the same version on both"
            raise UnfitWorkerError(message)
        if not is_compiled():
            message = "a worker lacks orip's compiled loop; install orip's wheel there, or orip with a C compiler"
            raise UnfitWorkerError(message)
        try:
            return loop_of(_sub_block(read_sub_block(Path(self.folder), self.number, self.digest)))
        except ValueError as error:
            raise UnfitWorkerError(str(error)) from None
        except OSError as error:
            message = f"a worker cannot read {self.folder}, which needs the same path on all machines ({error})"
            raise UnfitWorkerError(message) from None


def store_sub_blocks(project: Path, sub_blocks: Iterable[SubBlock]) -> list[StoredSubBlock]:
    """Write the sub-blocks of a project, one after the other; they stay as they are if they are there already.

    Raises
    ------
    OripError
        If they cannot be written.
    """
    written = write_sub_blocks(project.resolve(), map(_arrays, sub_blocks))
    return [StoredSubBlock(str(written.folder), number, digest) for number, digest in enumerate(written.digests)]


def _arrays(sub_block: SubBlock) -> dict[str, NDArray[np.generic]]:
    rows, names, bases = zip(*sub_block.sets, strict=True) if sub_block.sets else ((), (), ())
    found: dict[str, NDArray[np.generic]] = {
        name: value for name, value in sub_block._asdict().items() if isinstance(value, np.ndarray)
    }
    return found | {
        "front": np.array(sub_block.front),
        "set_cameras": np.array(rows, dtype=np.int64),
        "set_names": np.array(names, dtype=np.str_),
        "set_bases": np.array(bases, dtype=np.float64),
    }


def _sub_block(arrays: dict[str, NDArray[np.generic]]) -> SubBlock:
    sets = tuple(
        (int(row), cast("AdditionalSet", str(name)), float(base))
        for row, name, base in zip(
            *(arrays.pop(name).tolist() for name in ("set_cameras", "set_names", "set_bases")), strict=True
        )
    )
    front = int(arrays.pop("front").item())
    return SubBlock(**arrays, front=front, sets=sets)  # type: ignore[arg-type]
