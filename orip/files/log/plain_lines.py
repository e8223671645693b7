"""Lines of a measurement log that are a name and two ordinary numbers, many at a time.

Nearly all lines of a large log are such lines: they are read together, and without the fields with columns that
messages need. What is no such line, keywords among them, ends a run.
"""

from __future__ import annotations

import re
from array import array
from typing import NamedTuple

from orip.files.log.blocks import KEYWORDS
from orip.files.text.decimal_numbers import LARGEST_NUMBER
from orip.records.names import RESERVED_NAMES

try:
    from orip.files.log import _plain_lines as compiled
except ImportError:  # the extension is built where there is a compiler
    compiled = None  # type: ignore[assignment]

LINES_AT_A_TIME = 1000
"""Most lines of a run, after which to tell how far reading is."""

_NOT_NAMES = tuple(sorted(word.encode("ascii") for word in KEYWORDS | RESERVED_NAMES))
_NOT_PLAIN = b"|".join(map(re.escape, _NOT_NAMES))
_NUMBER = rb"[+-]?+(?:\d++(?:\.\d*+)?+|\.\d++)(?:[eE][+-]?+\d++)?+"
_LINE = (
    rb"[ \t]*+(?![!#]|(?i:" + _NOT_PLAIN + rb")[ \t])[!-~]++[ \t]++" + _NUMBER + rb"[ \t]++" + _NUMBER + rb"[ \t]*+\n"
)
_RUN = re.compile(rb"(?:" + _LINE + rb"){1,%d}+" % LINES_AT_A_TIME)


def is_compiled() -> bool:
    """Tell whether the extension was built."""
    return compiled is not None


class PlainLines(NamedTuple):
    """A run of lines.

    Attributes
    ----------
    end : int
        Of the run in the text.
    names : list of str
    coordinates : array of float
        x and y of each name in turn.
    """

    end: int
    names: list[str]
    coordinates: array[float]


def plain_lines(text: bytes, place: int) -> PlainLines | None:
    """Return the run of plain lines that begins at a place of a text; None where there is none.

    Parameters
    ----------
    text : bytes
        UTF-8, lines that end in newlines.
    place : int
        Where a line begins.
    """
    if is_compiled():
        end, names, coordinates = compiled.plain_lines(text, place, LINES_AT_A_TIME, _NOT_NAMES, LARGEST_NUMBER)
        return PlainLines(end, names, array("d", coordinates)) if names else None
    run = _RUN.match(text, place)
    if run is None:
        return None
    fields = run.group().decode("ascii").split()
    measured = array("d", bytes(16 * (len(fields) // 3)))
    measured[::2], measured[1::2] = (array("d", map(float, fields[axis::3])) for axis in (1, 2))
    if max(map(abs, measured)) <= LARGEST_NUMBER:
        return PlainLines(run.end(), fields[::3], measured)
    # up to the line with a number that is refused
    rows = next(row for row, size in enumerate(map(abs, measured)) if size > LARGEST_NUMBER) // 2
    end = place + sum(len(line) + 1 for line in run.group().split(b"\n")[:rows])
    return PlainLines(end, fields[: 3 * rows : 3], measured[: 2 * rows]) if rows else None
