"""What matching has found before, kept in a folder of the project: a run that was killed goes on where it was."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.files.text.atomic import remove_leftovers, replace_bytes
from orip.files.text.own_files import make_folder
from orip.files.text.regular_file import regular_bytes
from orip.pictures.matching.features import Features

CACHE_FOLDER = ".orip-matching"
"""In the project folder; it may be deleted at any time."""

_FORMAT = "2"
"""Another one where what is kept would be computed in another way."""
_DIGEST = 16
_IMAGE = 32

T = TypeVar("T")


class _KeptFeatures(Struct, frozen=True):
    place: bytes
    scale: bytes
    angle: bytes
    descriptor: bytes


class _KeptMatches(Struct, frozen=True):
    """Of a photo with others, by the digests of their images."""

    matches: dict[str, bytes]


class MatchingCache:
    """Features of images and matches of pairs of them, by the digests of the image files.

    What is damaged, or was found with other settings, is not used: it is found again.

    Parameters
    ----------
    folder : Path
        Of the project.
    settings : str
        On which what is kept depends.
    """

    def __init__(self, folder: Path, settings: str) -> None:
        self._folder = folder / CACHE_FOLDER
        self._settings = f"{_FORMAT} {settings}"
        make_folder(self._folder)
        remove_leftovers(self._folder)

    def features(self, image: str) -> Features | None:
        """Return the features of an image; None where they are not known.

        Parameters
        ----------
        image : str
            Digest of the file.
        """
        kept = self._read(self._path(image, "features"), _KeptFeatures)
        if kept is None:
            return None
        scale = np.frombuffer(kept.scale)
        place = np.frombuffer(kept.place).reshape(-1, 2)
        descriptor = np.frombuffer(kept.descriptor, dtype=np.uint8).reshape(len(scale), -1)
        return Features(place, scale, np.frombuffer(kept.angle), descriptor)

    def keep_features(self, image: str, found: Features) -> None:
        """Keep the features of an image."""
        arrays = (found.place, found.scale, found.angle, found.descriptor)
        self._write(self._path(image, "features"), _KeptFeatures(*(np.ascontiguousarray(a).tobytes() for a in arrays)))

    def matches(self, image: str) -> dict[str, NDArray[np.intp]]:
        """Return the matches of an image with others, (n, 2) each, by their digests."""
        kept = self._read(self._path(image, "matches"), _KeptMatches)
        found = {} if kept is None else kept.matches
        return {
            other: np.frombuffer(pairs, dtype="<i4").reshape(-1, 2).astype(np.intp) for other, pairs in found.items()
        }

    def keep_matches(self, image: str, found: dict[str, NDArray[np.intp]]) -> None:
        """Keep all that is known of the matches of an image."""
        kept = {other: pairs.astype("<i4").tobytes() for other, pairs in sorted(found.items())}
        self._write(self._path(image, "matches"), _KeptMatches(kept))

    def _path(self, image: str, kind: str) -> Path:
        name = hashlib.blake2b(f"{self._settings} {image}".encode(), digest_size=_IMAGE).hexdigest()
        return self._folder / f"{name}.{kind}"

    def _write(self, path: Path, value: Any) -> None:
        data = msgspec.msgpack.encode(value)
        replace_bytes(path, _checksum(path.name, data) + data)

    def _read(self, path: Path, kind: type[T]) -> T | None:
        try:
            data = regular_bytes(path)
        except OSError:
            return None
        if data[:_DIGEST] != _checksum(path.name, data[_DIGEST:]):
            return None
        try:
            return msgspec.msgpack.decode(data[_DIGEST:], type=kind)
        except (msgspec.MsgspecError, ValueError):
            return None


def _checksum(name: str, data: bytes) -> bytes:
    """Return a digest of what is kept and under which name: a file of another name is not taken for this one."""
    return hashlib.blake2b(name.encode() + data, digest_size=_DIGEST).digest()
