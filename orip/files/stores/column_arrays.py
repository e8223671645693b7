"""The columns of long lists as arrays and names: what a store does beside taking and giving rows.

In a module of its own, since arrays take longer to load than `orip status` to answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orip.arrays import IntArray
from orip.files.stores.packed_columns import unpacked_column
from orip.files.stores.table import StoreColumn
from orip.records.coded_names import CodedNames, coded, joined

ColumnValues = Sequence[Any] | NDArray[Any]

_TYPES = {"INTEGER": np.int64, "REAL": np.float64}


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
    array = np.array(values, dtype=_TYPES[column.type])
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
    empty: NDArray[Any] = np.empty(0, dtype=np.bool_ if column.flag else _TYPES[column.type])
    return np.concatenate([empty, *parts])
