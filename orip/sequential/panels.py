"""Panels of rows of the triangle, and the triangle as it was before a change."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray, IntArray


class Panel(NamedTuple):
    """Rows `first` to `last` of R, and the end of the columns in which they are not zero."""

    first: int
    last: int
    end: int


class Replaced(NamedTuple):
    """The triangle from a row on, before a change."""

    first: int
    panels: list[tuple[Panel, FloatArray, FloatArray]]
    reach: IntArray
    square_sums: FloatArray
    residual_square_sum: float
    rounding: float


def pivotal(block: FloatArray) -> FloatArray:
    """Return a diagonal block of R, with 1 as the pivot of rows that are zero."""
    empty = np.diagonal(block) == 0.0
    return np.where(np.diag(empty), 1.0, block) if empty.any() else block
