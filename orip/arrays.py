"""The types of bulk data: arrays whose shape and unit the docstring of their owner gives."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Number = TypeVar("Number", float, FloatArray)
"""One coordinate of one point, or of n points as an array (n,)."""


def rows_of_groups(group: IntArray, count: int) -> list[IntArray]:
    """Return for each of `count` groups the rows in it, ascending; `group` (n,) is that of each row, -1 for none.

    In one pass: to look for the rows of every group takes as many passes as there are groups.
    """
    order = np.argsort(group, kind="stable")
    return list(np.split(order, np.searchsorted(group[order], np.arange(count + 1)))[1:-1])
