"""Text for people: tables whose columns are as wide as their contents, headings, paragraphs, long columns."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, overload

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from orip.arrays import FloatArray
from orip.number_text import CONSTANT, HUGE, MISSING, SINGULAR, fixed

# The digits of many numbers are taken apart together, as arrays of characters. A number whose last digit depends on
# more than its double tells here (a tie, as far as one can see) is left to Python's own formatting, so that every cell
# is what `orip.number_text.fixed` makes of its number.

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


Alignment = Literal["left", "right", "point"]

PAGE_WIDTH = 110
"""Columns that headings are ruled to and paragraphs are wrapped at; tables are as wide as they must be."""

INDENT = 2

ROWS_AT_A_TIME = 8192


class Column(Struct, frozen=True):
    """One column of a table.

    Parameters
    ----------
    cells : sequence of str
        One a row; a cell is one line and is never shortened.
    unit : str
        Stands under the heading, in brackets.
    align : {"left", "right", "point"}
        "point" puts decimal points under one another; cells without a point end where the longest cell ends.
    gap : int
        Blanks between this column and the one before it, at least 1.
    """

    heading: str
    cells: Sequence[str]
    unit: str = ""
    align: Alignment = "right"
    gap: int = 2

    @property
    def unit_text(self) -> str:
        """The unit as it is printed."""
        return f"({self.unit})" if self.unit else ""


class Table:
    """Columns laid out once, so that parts of a long table can be printed apart with the same widths.

    Parameters
    ----------
    columns : sequence of Column
        All with the same number of cells.
    indent : int
        Blanks before the first column.

    Raises
    ------
    ValueError
        When the columns are not equally long.
    """

    def __init__(self, columns: Sequence[Column], indent: int = INDENT) -> None:
        self._columns = columns
        self._indent = indent
        self._cells = [_aligned_cells(column) for column in columns]
        self._widths = [
            max(len(column.heading), len(column.unit_text), _longest(cells))
            for column, cells in zip(columns, self._cells, strict=True)
        ]
        if len({len(cells) for cells in self._cells}) > 1:
            message = f"the columns of a table are equally long, not {[len(cells) for cells in self._cells]}"
            raise ValueError(message)

    def headings(self) -> list[str]:
        """Return the lines of headings and units, and the rule beneath them."""
        lines = [self._line([column.heading for column in self._columns])]
        if any(column.unit for column in self._columns):
            lines.append(self._line([column.unit_text for column in self._columns]))
        # a column without a heading holds marks and remarks, and needs no rule
        spans = [width if column.heading else 0 for column, width in zip(self._columns, self._widths, strict=True)]
        lines.append(self._line(["-" * span for span in spans]))
        return lines

    def rows(self, start: int = 0, stop: int | None = None) -> list[str]:
        """Return the lines of rows `start` to `stop` (excluded)."""
        part = slice(start, stop)
        rest = zip(self._columns, self._cells, self._widths, self._gaps(), strict=True)
        justified = [_justified(cells, part, width, gap, column.align) for column, cells, width, gap in rest]
        return ["".join(row).rstrip() for row in zip(*justified, strict=True)]

    def each_row(self) -> Iterator[str]:
        """Yield the lines of all rows; only a part of a long table is in memory at a time."""
        for start in range(0, max(map(len, self._cells), default=0), ROWS_AT_A_TIME):
            yield from self.rows(start, start + ROWS_AT_A_TIME)

    def lines(self) -> list[str]:
        """Return the whole table."""
        return self.headings() + self.rows()

    def _gaps(self) -> list[int]:
        """Return the blanks before each column."""
        return [self._indent, *(max(column.gap, 1) for column in self._columns[1:])]

    def _line(self, texts: Sequence[str]) -> str:
        rest = zip(texts, self._columns, self._widths, self._gaps(), strict=True)
        return "".join(
            _justified([text], slice(1), width, gap, column.align)[0] for text, column, width, gap in rest
        ).rstrip()


def _aligned_cells(column: Column) -> Sequence[str]:
    cells = column.cells
    if column.align != "point":
        return cells
    tails = [len(cell) - cell.index(".") if "." in cell else 0 for cell in cells]
    longest = max(tails, default=0)
    return [cell + " " * (longest - tail) if tail else cell for cell, tail in zip(cells, tails, strict=True)]


def _longest(cells: Sequence[str]) -> int:
    return cells.longest if isinstance(cells, FixedCells) else max(map(len, cells), default=0)


def _justified(cells: Sequence[str], part: slice, width: int, gap: int, align: Alignment) -> list[str]:
    """Return some cells of a column with the blanks before and after them."""
    if isinstance(cells, FixedCells):
        return cells.justified(part, gap + width)
    if align == "left":
        return [" " * gap + cell.ljust(width) for cell in cells[part]]
    return [cell.rjust(gap + width) for cell in cells[part]]


def table_lines(columns: Sequence[Column], indent: int = INDENT) -> list[str]:
    """Return a whole table; "none" where it has no rows."""
    return list(each_table_line(columns, indent))


def each_table_line(columns: Sequence[Column], indent: int = INDENT) -> Iterator[str]:
    """Yield what `table_lines` returns."""
    if not columns or not columns[0].cells:
        yield " " * indent + "none"
        return
    table = Table(columns, indent)
    yield from table.headings()
    yield from table.each_row()


_RULE = re.compile(r" *-+(?: +-+)+ *")


def fitted_tables(text: str, width: int) -> str:
    """Return printed tables without the columns that do not fit a width, and below each what was left out.

    The first column always stays; what is no table stays as it is.
    """
    lines, found, cut = text.split("\n"), [], 0
    left_out: list[str] = []
    for number, line in enumerate(lines):
        ahead = next((rule for rule in lines[number : number + 3] if _RULE.fullmatch(rule)), None)
        if not line.strip():
            found += _left_out(left_out, width)
            cut, left_out = 0, []
        elif not cut and ahead is not None and len(ahead.rstrip()) > width:
            spans = [match.span() for match in re.finditer("-+", ahead)]
            fitting = max(sum(end <= width for _, end in spans), 1)
            cut = spans[fitting - 1][1]
            left_out = [line[start:end].strip() or "?" for start, end in spans[fitting:]]
        found.append(line[:cut].rstrip() if cut else line)
    return "\n".join([*found, *_left_out(left_out, width)])


def _left_out(columns: Sequence[str], width: int) -> list[str]:
    if not columns:
        return []
    message = f"The window has {width} columns; left out: {', '.join(columns)}. A wider one or '> FILE' has them."
    return textwrap.wrap(message, width)


def xy_columns(heading: str, values: ArrayLike, decimals: int, unit: str = "") -> list[Column]:
    """Return the two columns of a figure that has an x and a y, close together.

    Parameters
    ----------
    heading : str
        With {} where X and Y go.
    values : array (n, 2)
    """
    pairs = np.asarray(values, dtype=np.float64).reshape(-1, 2)
    return xy_pair(heading, [FixedCells(pairs[:, k], decimals) for k in range(2)], unit)


def xy_pair(heading: str, cells: Sequence[Sequence[str]], unit: str = "") -> list[Column]:
    """Return what `xy_columns` returns, from the cells of both columns."""
    pairs = enumerate(zip("XY", cells, strict=True))
    return [Column(heading.format(axis), column_cells, unit, gap=2 - k) for k, (axis, column_cells) in pairs]


def section(title: str, body: Iterable[str]) -> Iterator[str]:
    """Yield a blank line, the ruled title of a section, and its body."""
    yield from ["", "", title, "=" * len(title)]
    yield from body


def one_line(text: str) -> str:
    """Return free text as one line of printable characters, so that it cannot imitate a listing's own lines."""
    return " ".join("".join(character if character.isprintable() else " " for character in text).split())


def paragraph(text: str, indent: int = INDENT, hanging: int = 0) -> list[str]:
    """Return free text wrapped at `PAGE_WIDTH`; words are never broken."""
    return textwrap.wrap(
        one_line(text),
        PAGE_WIDTH,
        initial_indent=" " * indent,
        subsequent_indent=" " * (indent + hanging),
        break_long_words=False,
        break_on_hyphens=False,
    )


def key_lines(pairs: Sequence[tuple[str, str, str]]) -> list[str]:
    """Return lines of ``label  value  remark``, labels and values in columns."""
    label_width = max((len(label) for label, _, _ in pairs), default=0)
    value_width = max((len(value) for _, value, _ in pairs), default=0)
    return [
        f"{' ' * INDENT}{label.ljust(label_width)}  {value.rjust(value_width)}  {remark}".rstrip()
        for label, value, remark in pairs
    ]
