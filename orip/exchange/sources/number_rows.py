"""Rows of plain numbers, many at once: files of a million lines are sound as a rule, and that is quickly seen.

Where a line may have a fault nothing is returned, and the reader goes through the lines one by one to name it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.files.text.decimal_numbers import LARGEST_NUMBER

_PLAIN = re.compile(r"[0-9+\-.eE \t\r\n]*")
"""Words of these letters that Python reads as numbers are those that orip takes for numbers."""

_LINES = 50_000
_MOST_DIGITS = 15


def sound_rows(lines: Sequence[str], fields: int, whole: int = 0) -> FloatArray | None:
    """Return the numbers (n, fields) of n lines; None if one of them may have a fault.

    Parameters
    ----------
    lines : sequence of str
    fields : int
        Numbers in a line, with blanks between them.
    whole : int
        So many of them, the first ones, are whole numbers from 0 on.
    """
    found = np.empty((len(lines), fields))
    for first in range(0, len(lines), _LINES):
        part = lines[first : first + _LINES]
        text = " ".join(part)
        if _PLAIN.fullmatch(text) is None or set(map(len, map(str.split, part))) != {fields}:
            return None
        words = text.split()
        for column in range(whole):
            own = words[column::fields]
            if not all(map(str.isdigit, own)) or max(map(len, own)) > _MOST_DIGITS:
                return None
        try:
            numbers = np.fromiter(map(float, words), dtype=np.float64, count=len(words))
        except ValueError:
            return None
        if not (np.abs(numbers) <= LARGEST_NUMBER).all():
            return None
        found[first : first + _LINES] = numbers.reshape(-1, fields)
    return found
