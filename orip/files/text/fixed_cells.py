"""Cells of a long table's column of numbers: texts with equal decimals, made when they are printed and all at once.

The digits of many numbers are taken apart together, as arrays of characters. A number whose last digit depends on more
than its double tells here (a tie, as far as one can see) is left to Python's own formatting, so that every cell is what
`orip.number_text.fixed` makes of its number.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orip.arrays import FloatArray
from orip.number_text import CONSTANT, HUGE, MISSING, SINGULAR, fixed

Characters = NDArray[np.uint32]
"""One code point each, rows one under the other."""

_BLANK, _POINT, _ZERO, _MINUS = map(ord, " .0-")
_EXACT_PRODUCTS = 1e15
"""Scaled numbers from here on have too few binary places left to tell a tie."""
_ROUNDING = 2.0**-52
"""Twice the relative error of one product."""


class FixedCells(Sequence[str]):
    """Numbers as cells.

    Parameters
    ----------
    values : array (m,)
    decimals : int
    missing : str
        Stands for NaN.
    infinite : str
        Stands for positive infinity.
    rows : array (n,) of int or None
        Where each cell's number is among the values, -1 for a missing one; None: n = m, in their order.
    """

    def __init__(
        self,
        values: ArrayLike,
        decimals: int,
        missing: str = MISSING,
        infinite: str = "inf",
        rows: NDArray[np.int64] | None = None,
    ) -> None:
        self._values = np.asarray(values, dtype=np.float64)
        self._decimals = decimals
        self._missing = missing
        self._infinite = infinite
        self._rows = rows

    def __len__(self) -> int:
        return len(self._values if self._rows is None else self._rows)

    @overload
    def __getitem__(self, at: int) -> str: ...

    @overload
    def __getitem__(self, at: slice) -> list[str]: ...

    def __getitem__(self, at: int | slice) -> str | list[str]:
        if isinstance(at, slice):
            return self._texts(self._numbers(at))
        return self._texts(self._numbers(slice(None))[[at]])[0]

    @property
    def longest(self) -> int:
        """Return the length of the longest cell."""
        numbers = self._numbers(slice(None))
        is_usual = np.abs(numbers) < HUGE
        usual = numbers[is_usual]
        extremes = [float(usual.min()), float(usual.max())] if usual.size else []
        return max(map(len, self._texts([*extremes, *np.unique(numbers[~is_usual]).tolist()])), default=0)

    def justified(self, part: slice, width: int) -> list[str]:
        """Return some cells, right-aligned in a width that is that of the longest at least."""
        numbers = self._numbers(part)
        if not len(numbers):
            return []
        texts: list[str] = self._characters(numbers, width).view(f"U{width}").ravel().tolist()
        return texts

    def _numbers(self, part: slice) -> FloatArray:
        if self._rows is None:
            return self._values[part]
        rows = self._rows[part]
        return np.where(rows < 0, np.nan, self._values[rows]) if self._values.size else np.full(len(rows), np.nan)

    def _characters(self, values: FloatArray, width: int) -> Characters:
        with np.errstate(invalid="ignore", over="ignore"):  # NaN and infinity
            scaled = np.abs(values) * 10.0**self._decimals
            whole = np.floor(scaled)
            tie = np.abs(scaled - whole - 0.5) <= scaled * _ROUNDING
        plain = (np.abs(values) < HUGE) & (scaled < _EXACT_PRODUCTS) & ~tie
        number = np.rint(np.where(plain, scaled, 0.0)).astype(np.int64)
        room = max(width, self._decimals + 2)  # where no number is printed, its decimals may not fit
        digits = _digits(number, (values < 0.0) & (number > 0), self._decimals, room)
        result = np.ascontiguousarray(digits[:, room - width :])
        missing = np.isnan(values)
        if missing.any():
            result[missing] = _code_points(self._missing.rjust(width))
        others = np.flatnonzero(~plain & ~missing)
        for row, text in zip(others.tolist(), self._texts(values[others]), strict=True):
            result[row] = _code_points(text.rjust(width))
        return result

    def _texts(self, values: ArrayLike) -> list[str]:
        texts = fixed(np.asarray(values), self._decimals, self._missing)
        return [self._infinite if text == "inf" else text for text in texts]


def deviation_cells(values: ArrayLike, decimals: int) -> FixedCells:
    """Return what `orip.number_text.deviations` makes of standard deviations."""
    return FixedCells(values, decimals, CONSTANT, SINGULAR)


def _code_points(text: str) -> Characters:
    return np.array([text]).view(np.uint32)


def _digits(number: NDArray[np.int64], negative: NDArray[np.bool_], decimals: int, width: int) -> Characters:
    """Return whole numbers as characters (n, width), with a decimal point before the last so many digits."""
    result = np.full((len(number), width), _BLANK, dtype=np.uint32)
    place = width
    for _ in range(decimals):
        place -= 1
        rest = number // 10
        result[:, place] = number - 10 * rest + _ZERO
        number = rest
    if decimals:
        place -= 1
        result[:, place] = _POINT
    first = True
    while place > 0 and (first or number.any() or negative.any()):
        place -= 1
        rest = number // 10
        digit = number - 10 * rest + _ZERO
        if first:
            result[:, place] = digit
        else:
            ended = number == 0
            result[:, place] = np.where(ended, np.where(negative, _MINUS, _BLANK), digit)
            negative = negative & ~ended
        number, first = rest, False
    return result
