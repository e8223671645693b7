"""Binary models of COLMAP (.bin): little-endian, every count checked against what is left of the file."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from orip.arrays import BoolArray, IntArray
from orip.errors import Complaint
from orip.exchange.colmap.model import CAMERA_MODELS, MODEL_NAMES, ColmapCamera, ColmapImage, ColmapPoints, no_points
from orip.files.text.shown import Parsed, printable

T = TypeVar("T")

_KEYPOINT = np.dtype([("at", "<f8", 2), ("point", "<i8")])
_HEAD = np.dtype(
    [("id", "<i8"), ("at", "<f8", 3), ("colour", "u1", 3), ("error", "<f8"), ("length", "<u8")], align=False
)
_TRACK_BYTES = 8


class _DamagedError(Exception):
    """What is wrong with the bytes, and where."""


class Bytes:
    """The bytes of a file, taken one after the other."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def fields(self, form: str, what: str) -> tuple[int | float, ...]:
        """Return numbers of a format of `struct`."""
        layout = struct.Struct("<" + form)
        self.require(layout.size, what)
        found: tuple[int | float, ...] = layout.unpack_from(self.data, self.at)
        self.at += layout.size
        return found

    def whole(self, form: str, what: str) -> int:
        """Return one whole number."""
        return int(self.fields(form, what)[0])

    def count(self, size: int, what: str) -> int:
        """Return a number of things that need at least `size` bytes each."""
        number = self.whole("Q", f"the number of {what}")
        left = len(self.data) - self.at
        if number * size > left:
            message = f"at byte {self.at - 8} it announces {number} {what}, but {left} bytes follow"
            raise _DamagedError(message)
        return number

    def require(self, size: int, what: str) -> None:
        """Complain unless so many bytes are left."""
        if self.at + size > len(self.data):
            message = f"it ends at byte {len(self.data)}, within {what} that begins at byte {self.at}"
            raise _DamagedError(message)

    def require_end(self) -> None:
        """Complain if bytes are left."""
        if self.at < len(self.data):
            message = f"{len(self.data) - self.at} bytes follow after its end at byte {self.at}"
            raise _DamagedError(message)

    def text(self, what: str) -> str:
        """Return a text up to its zero byte."""
        end = self.data.find(b"\0", self.at)
        if end < 0:
            message = f"{what} that begins at byte {self.at} has no end"
            raise _DamagedError(message)
        raw, start = self.data[self.at : end], self.at
        self.at = end + 1
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError:
            message = f"{what} at byte {start} is not UTF-8"
            raise _DamagedError(message) from None


def cameras_from_bytes(data: bytes, shown: str) -> Parsed[tuple[ColmapCamera, ...]]:
    """Read cameras.bin."""
    return guarded(_cameras, data, shown, ())


def images_from_bytes(data: bytes, shown: str) -> Parsed[tuple[ColmapImage, ...]]:
    """Read images.bin."""
    return guarded(_images, data, shown, ())


def points_from_bytes(data: bytes, shown: str) -> Parsed[ColmapPoints]:
    """Read points3D.bin."""
    return guarded(_points, data, shown, no_points())


def guarded(read: Callable[[Bytes], T], data: bytes, shown: str, nothing: T) -> Parsed[T]:
    """Return what is read from bytes; `nothing`, and a complaint, if they are damaged."""
    source = Bytes(data)
    try:
        found = read(source)
        source.require_end()
    except _DamagedError as fault:
        return Parsed(nothing, (Complaint(f"the file is damaged, or not of COLMAP: {fault}", shown),))
    return Parsed(found)


def _cameras(source: Bytes) -> tuple[ColmapCamera, ...]:
    cameras = []
    for _ in range(source.count(24, "cameras")):
        at = source.at
        identity, number, columns, rows = map(int, source.fields("IiQQ", "a camera"))
        name = MODEL_NAMES.get(number)
        if name is None:
            message = f"the camera at byte {at} has the unknown model {number}; known are 0 to {len(CAMERA_MODELS) - 1}"
            raise _DamagedError(message)
        parameters = source.fields(f"{len(CAMERA_MODELS[name].parameters)}d", "the parameters of a camera")
        cameras.append(ColmapCamera(identity, name, columns, rows, tuple(map(float, parameters))))
    return tuple(cameras)


def _images(source: Bytes) -> tuple[ColmapImage, ...]:
    images = []
    for _ in range(source.count(73, "images")):
        identity = source.whole("I", "an image")
        pose = tuple(map(float, source.fields("7d", "the pose of an image")))
        camera = source.whole("I", "an image")
        name = source.text("the name of an image")
        count = source.count(_KEYPOINT.itemsize, f"keypoints of image {printable(name)}")
        keypoints = np.frombuffer(source.data, _KEYPOINT, count, source.at)
        source.at += count * _KEYPOINT.itemsize
        images.append(
            ColmapImage(
                identity,
                pose,
                camera,
                name,
                keypoints["at"].astype(np.float64),
                keypoints["point"].astype(np.int64),
            )
        )
    return tuple(images)


def _points(source: Bytes) -> ColmapPoints:
    starts = np.array(list(_starts_of_points(source)), dtype=np.int64)
    data = np.frombuffer(source.data, np.uint8, source.at)
    is_head = _heads(starts, len(data))
    head, tracks = data[is_head].view(_HEAD), data[8:][~is_head[8:]].view("<u4")
    return ColmapPoints(
        head["id"].astype(np.int64),
        head["at"].astype(np.float64),
        head["colour"].copy(),
        head["error"].astype(np.float64),
        head["length"].astype(np.int64),
        tracks.reshape(-1, 2).astype(np.int64),
    )


def _starts_of_points(source: Bytes) -> Iterator[int]:
    """Yield where each point begins; the length of its track tells where the next one does."""
    number, at, end = source.count(_HEAD.itemsize, "points"), source.at, len(source.data)
    length_at, before_track = struct.Struct("<Q").unpack_from, _HEAD.itemsize - 8
    for _ in range(number):
        source.at = at
        if at + _HEAD.itemsize > end:
            source.require(_HEAD.itemsize, "a point")
        (length,) = length_at(source.data, at + before_track)
        yield at
        at += _HEAD.itemsize + length * _TRACK_BYTES
        if at > end:
            source.at += before_track
            source.count(_TRACK_BYTES, "rays of a point")
    source.at = at


def _heads(starts: IntArray, size: int) -> BoolArray:
    """Return which of so many bytes are of heads of points, which begin at `starts` (m,); the others are tracks."""
    is_head = np.zeros(size, dtype=np.bool_)
    is_head[starts[:, None] + np.arange(_HEAD.itemsize)] = True
    return is_head


def bytes_of_points(points: ColmapPoints) -> bytes:
    """Return points3D.bin."""
    head = np.empty(len(points.ids), _HEAD)
    head["id"], head["at"], head["colour"] = points.ids, points.coordinates, points.colours
    head["error"], head["length"] = points.errors, points.lengths
    sizes = _HEAD.itemsize + _TRACK_BYTES * points.lengths
    is_head = _heads(np.cumsum(sizes) - sizes, int(sizes.sum()))
    found = np.empty(len(is_head), np.uint8)
    found[is_head] = head.view(np.uint8)
    found[~is_head] = points.tracks.astype("<u4").view(np.uint8).ravel()
    return struct.pack("<Q", len(head)) + found.tobytes()
