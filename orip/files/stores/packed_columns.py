"""The columns of long lists as blocks of bytes, and as arrays and names."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from itertools import chain, repeat
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from orip.arrays import IntArray
from orip.files.stores.packed_parts import AS_IT_IS, DEFLATED, HEAD, LENGTH, ONE_BYTE, WIDTH, unpacked_parts
from orip.files.stores.table import StoreColumn
from orip.records.coded_names import CodedNames, coded, joined

# A million rows take SQLite longer than the adjustment; a column is one value. Of 64-bit numbers the first bytes of all
# come first, then the second ones and so on: those of sign and exponent compress well, the last digits of measured and
# adjusted values not at all, and what does not compress is left as it is.

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


# In a module of its own, since arrays take longer to load than `orip status` to answer.

ColumnValues = Sequence[Any] | NDArray[Any]

_TYPES_OF_ARRAYS = {"INTEGER": np.int64, "REAL": np.float64}


def positions(first: int, count: int) -> IntArray:
    """Return the positions of so many items of a list."""
    return np.arange(first, first + count)


def unpacked_values(column: StoreColumn, blob: bytes, count: int) -> ColumnValues:
    """Return the values of a packed column.

    Raises
    ------
    ValueError, OverflowError, MemoryError
        If they are not those of the column.
    """
    values: ColumnValues = unpacked_column(column, blob, count)
    if column.type == "REAL":
        _require_numbers(column, np.asarray(values))
    return values


def same_column(one: ColumnValues, other: ColumnValues) -> bool:
    """Tell whether two columns have the same values."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    return one == coded(other)


def part_of_column(values: ColumnValues, first: int, count: int) -> ColumnValues:
    """Return some values of a packed list, which are in one row of the file."""
    part = values[first : first + count]
    return part.without_unused() if isinstance(part, CodedNames) else part


def column_values(column: StoreColumn, values: tuple[Any, ...], known: dict[str, str]) -> ColumnValues:
    """Return the values of a column as SQLite gives them: texts, each kept once in `known`, or an array."""
    if column.type == "TEXT":
        return tuple(map(known.setdefault, values, values))
    array = np.array(values, dtype=_TYPES_OF_ARRAYS[column.type])
    if column.type == "REAL":
        _require_numbers(column, array)
    return array.astype(np.bool_) if column.flag else array


def _require_numbers(column: StoreColumn, values: NDArray[Any]) -> None:
    if column.null == "never" and np.isnan(values).any():
        message = "null, but a number is needed"
        raise ValueError(message)
    if not column.infinite and np.isinf(values).any():
        message = "infinite, but a finite number is needed"
        raise ValueError(message)


def joined_column(column: StoreColumn, parts: list[ColumnValues]) -> ColumnValues:
    """Return a column from its parts."""
    if len(parts) == 1:
        return parts[0]
    if column.type == "TEXT":
        names = [part for part in parts if isinstance(part, CodedNames)]
        return joined(names) if names else tuple(chain.from_iterable(parts))
    empty: NDArray[Any] = np.empty(0, dtype=np.bool_ if column.flag else _TYPES_OF_ARRAYS[column.type])
    return np.concatenate([empty, *parts])
