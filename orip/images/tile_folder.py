"""The folder in which tiles and grey values of images are kept between runs, up to a limit."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orip.files.text.atomic import remove_leftovers, replace_bytes
from orip.files.text.own_files import make_folder, remove_file
from orip.files.text.regular_file import open_regular, regular_bytes
from orip.images import TILE_FOLDER

MOST_BYTES = 4 << 30
"""That are kept: photos of 24 megapixels have 24 MB of grey values and some 15 MB of tiles each."""

_LEFT = 0.75
"""Part of them that stays where there are more: what was written last."""


class TileFolder:
    """Files of a folder, the oldest of which go when they are too many; one thread at a time.

    Where nothing can be written, nothing is kept.

    Parameters
    ----------
    project : Path
        The folder in which it is.
    most : int, optional
        Bytes.
    """

    def __init__(self, project: Path, most: int = MOST_BYTES) -> None:
        self._folder, self._most = project / TILE_FOLDER, most
        with suppress(OSError):
            make_folder(self._folder)
            remove_leftovers(self._folder)
        self._bytes = sum(size for _, size, _ in self._files())
        self._let_go()

    def read(self, name: str) -> bytes | None:
        """Return a file; None where there is none."""
        with suppress(OSError):
            return regular_bytes(self._folder / name)
        return None

    def rows(self, name: str, first: int, last: int, columns: int) -> NDArray[np.uint8] | None:
        """Return rows of a file of bytes, (last - first, columns) or fewer; None where there is no such file."""
        with suppress(OSError), open_regular(self._folder / name) as file:
            file.seek(first * columns)
            found = np.frombuffer(file.read((last - first) * columns), dtype=np.uint8)
            if found.size and found.size % columns == 0:
                return found.reshape(-1, columns)
        return None

    def write(self, name: str, data: bytes) -> bool:
        """Write a file; return whether that could be done."""
        try:
            replace_bytes(self._folder / name, data)
        except OSError:
            return False
        self._bytes += len(data)
        self._let_go()
        return True

    def _files(self) -> list[tuple[int, int, str]]:
        """Return time, size and name of the files."""
        found = []
        with suppress(OSError):
            for path in self._folder.iterdir():
                with suppress(OSError):
                    state = path.lstat()
                    found.append((state.st_mtime_ns, state.st_size, path.name))
        return found

    def _let_go(self) -> None:
        if self._bytes <= self._most:
            return
        there = sorted(self._files())
        self._bytes = sum(size for _, size, _ in there)
        for _, size, name in there:
            if self._bytes <= _LEFT * self._most:
                return
            with suppress(OSError):  # what is not orip's own stays
                remove_file(self._folder / name)
                self._bytes -= size
