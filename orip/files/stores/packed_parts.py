"""The parts of a packed column: a block of bytes for each place of the bytes of its numbers, and its different names.

They are taken apart without arrays, which take longer to load than a digest of some thousand rows to compute.
"""

from __future__ import annotations

import struct
import sys
import zlib
from array import array
from collections.abc import Sequence

import msgspec

from orip.files.stores.table import StoreColumn

WIDTH = 8
"""Bytes of a number, the least one first."""

HEAD = struct.Struct("<BQ")
"""How a part is kept, and the number of bytes that follow; of one byte the number of its repetitions."""

AS_IT_IS, DEFLATED, ONE_BYTE = range(3)
"""Ways to keep a part; the last one: all of its bytes are the one that follows."""

LENGTH = "it has other values than its length says"

Place = bytes | memoryview


def unpacked_parts(column: StoreColumn, data: bytes, count: int) -> tuple[list[str], list[Place]]:
    """Return the different names of a column of text, and the bytes of all `count` numbers for each of their places.

    Raises
    ------
    ValueError
        If the bytes are not those of so many values.
    """
    rest = memoryview(data)
    distinct: list[str] = []
    if column.type == "TEXT":
        words, rest = _taken(rest, None)
        distinct = _names(words)
    places = []
    for _ in range(WIDTH):
        part, rest = _taken(rest, count)
        places.append(part)
    if len(rest):
        raise ValueError(LENGTH)
    return distinct, places


def interleaved(columns: Sequence[Sequence[Place]], count: int) -> bytearray:
    """Return the numbers of several columns, row by row, from the places of each."""
    stride = WIDTH * len(columns)
    numbers = bytearray(stride * count)
    for first, places in zip(range(0, stride, WIDTH), columns, strict=True):
        for place, part in enumerate(places, first):
            numbers[place::stride] = part
    return numbers


def whole_numbers(places: Sequence[Place], count: int) -> array[int]:
    """Return the whole numbers of a column from their places."""
    numbers = array("q", bytes(interleaved([places], count)))
    if sys.byteorder == "big":
        numbers.byteswap()
    return numbers


def _names(words: Place) -> list[str]:
    try:
        return msgspec.json.decode(words, type=list[str])
    except msgspec.DecodeError as error:
        raise ValueError(str(error)) from error


def _taken(data: memoryview, size: int | None) -> tuple[Place, memoryview]:
    """Return the content of the first part, and what comes after it."""
    if len(data) < HEAD.size:
        raise ValueError(LENGTH)
    way, length = HEAD.unpack(data[: HEAD.size])
    end = HEAD.size + (1 if way == ONE_BYTE else length)
    kept, rest = data[HEAD.size : end], data[end:]
    if len(data) < end or way > ONE_BYTE or (way == ONE_BYTE and length != size):
        raise ValueError(LENGTH)
    content: Place = kept
    if way != AS_IT_IS:
        content = _inflated(kept, size) if way == DEFLATED else bytes(kept) * length
    if size not in (None, len(content)):
        raise ValueError(LENGTH)
    return content, rest


def _inflated(data: memoryview, size: int | None) -> bytes:
    """Return compressed bytes as they were; no more than expected of a damaged store."""
    reader = zlib.decompressobj()
    try:
        return reader.decompress(data, 0 if size is None else size + 1)
    except zlib.error as error:
        raise ValueError(str(error)) from error
