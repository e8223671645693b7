"""Columns of a long list as blocks of bytes: numbers by their bytes' places, names once with a number for each row.

A million rows take SQLite longer than the adjustment; a column is one value. Of 64-bit numbers the first bytes of all
come first, then the second ones and so on: those of sign and exponent compress well, the last digits of measured and
adjusted values not at all, and what does not compress is left as it is.
"""

from __future__ import annotations

import zlib
from itertools import repeat
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from orip.files.stores.packed_parts import AS_IT_IS, DEFLATED, HEAD, LENGTH, ONE_BYTE, WIDTH, unpacked_parts
from orip.files.stores.table import StoreColumn
from orip.records.coded_names import CodedNames, coded

_LEVEL = 1
_SAMPLE = 1 << 12
"""Bytes by which it is judged whether a part compresses."""

_GAIN = 0.25
"""To which part it has to: first bytes of measured numbers lose two thirds, which takes longer than to write them."""
_AT_A_TIME = 4096
"""Numbers whose places are taken apart at once."""

_TYPES = {"REAL": np.dtype("<f8"), "INTEGER": np.dtype("<i8"), "TEXT": np.dtype("<i8")}


def packed_column(column: StoreColumn, values: Any) -> bytes:
    """Return the values of a column as bytes; the same values always give the same bytes.

    Raises
    ------
    UnicodeEncodeError
        If a text has half a surrogate pair.
    """
    if column.type == "TEXT":
        names = coded(values)
        words = msgspec.json.encode(names.distinct)
        return _judged_part(words) + _numbers(names.codes.astype("<i4", copy=False))
    return _numbers(np.ascontiguousarray(values, dtype=_TYPES[column.type]))


def unpacked_column(column: StoreColumn, data: bytes, count: int) -> Any:
    """Return the `count` values of a column: float64, int64 or bool arrays, `CodedNames` of text.

    Raises
    ------
    ValueError
        If the bytes are not those of so many values.
    """
    distinct, parts = unpacked_parts(column, data, count)
    kind = _TYPES[column.type]
    numbers: NDArray[Any] = np.empty(count, dtype=kind)
    places = numbers.view(np.uint8).reshape(count, kind.itemsize)
    for place, part in enumerate(parts):
        places[:, place] = np.frombuffer(part, dtype=np.uint8)
    if column.type == "TEXT":
        if len(numbers) and not 0 <= numbers.min() <= numbers.max() < len(distinct):
            raise ValueError(LENGTH)
        return CodedNames(distinct, numbers)
    return numbers.astype(np.bool_) if column.flag else numbers


def _numbers(values: NDArray[Any]) -> bytes:
    """Return numbers of 64 bits, or those of 32 bits that are not negative as if they had 64."""
    count, size = len(values), values.dtype.itemsize
    places = np.empty((size, count), dtype=np.uint8)
    of_numbers = values.view(np.uint8).reshape(count, size)
    for start in range(0, count, _AT_A_TIME):  # a few lines of the processor's cache
        places[:, start : start + _AT_A_TIME] = of_numbers[start : start + _AT_A_TIME].T
    return b"".join((*map(_part, places), *repeat(_constant_part(b"\0", count), WIDTH - size)))


def _part(place: NDArray[np.uint8]) -> bytes:
    # codes, flags and equal a-priori errors: most places have one byte throughout
    if not len(place) or place.min() == place.max():
        return _constant_part(place[:1].tobytes() or b"\0", len(place))
    return _judged_part(place.data)


def _constant_part(byte: bytes, count: int) -> bytes:
    return HEAD.pack(ONE_BYTE, count) + byte


def _judged_part(data: bytes | memoryview) -> bytes:
    sample = data[:_SAMPLE]
    is_deflated = len(_compressed(sample)) < _GAIN * len(sample)
    kept = _compressed(data) if is_deflated else data
    return b"".join((HEAD.pack(DEFLATED if is_deflated else AS_IT_IS, len(kept)), kept))


def _compressed(data: bytes | memoryview) -> bytes:
    return zlib.compress(data, _LEVEL)
