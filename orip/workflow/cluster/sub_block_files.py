"""Sub-blocks of a project in files, and their loops in the workers that read them."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable
from pathlib import Path
from typing import cast

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.bundle.blocking.sub_block import SubBlock, loop_of
from orip.bundle.compiled.photo_loop import PhotoPointLoop, is_compiled
from orip.files.blocking.sub_blocks import read_sub_block, write_sub_blocks
from orip.records.project.camera import AdditionalSet
from orip.version import __version__
from orip.workflow.cluster.facts import UnfitWorkerError

_MOST_RAYS = 3_000_000
"""Photo points whose loops a worker keeps, some 150 bytes each; it reads the others when it needs them again."""

_loops: OrderedDict[tuple[str, str], PhotoPointLoop] = OrderedDict()
_alone = threading.Lock()


class StoredSubBlock(Struct, frozen=True):
    """A sub-block in a file.

    Parameters
    ----------
    folder : str
    number : int
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
