"""A table of the page: text cells under headings, and numbers as the page shows them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from markupsafe import Markup, escape
from msgspec import Struct
from numpy.typing import ArrayLike

from orip.number_text import COEFFICIENT_PRECISION, CONSTANT, decimals_of_two_digits, known_precisions
from orip.wording import agreeing

MISSING = "–"
SINGULAR = "not determined"

_HUGE = 1e9


def decimals_of_most(precision: ArrayLike, at_most: int = 6) -> int:
    """Return the decimals with which the smaller ones of these precisions have two significant digits.

    Parameters
    ----------
    precision : array of any shape
        Standard deviations, for instance; those that are not finite and positive do not count. The smallest twentieth
        does not decide, so that one outstanding point does not lengthen the numbers of all.
    """
    known = known_precisions(precision)
    return decimals_of_two_digits(float(np.quantile(known, 0.05)), 0, at_most) if known.size else min(3, at_most)


def fixed(value: float, decimals: int) -> str:
    """Return a number with decimals; a dash for NaN."""
    if math.isnan(value):
        return MISSING
    return f"{value:z.{decimals}f}" if abs(value) < _HUGE else f"{value:.4g}"


def deviation(value: float, decimals: int) -> str:
    """Return a standard deviation: words for NaN, a constant, and infinity, an unknown that nothing determines."""
    if math.isnan(value):
        return CONSTANT
    return SINGULAR if math.isinf(value) else fixed(value, decimals)


def parameter(value: float, sd: float) -> tuple[str, str]:
    """Return the value and the sd of a camera parameter; each parameter has its own number of decimals."""
    if not (math.isfinite(sd) and sd > 0.0):
        return f"{value:.6g}", deviation(sd, 3)
    if sd >= COEFFICIENT_PRECISION:
        decimals = decimals_of_most(sd)
        return fixed(value, decimals), fixed(sd, decimals)
    digits = max(math.floor(math.log10(abs(value) / sd)) + 1, 1) if value and math.isfinite(value) else 1
    return f"{value:z.{min(digits, 9)}e}", f"{sd:.1e}"


def significant(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, without an exponent where that is readable; a dash for NaN."""
    if math.isnan(value):
        return MISSING
    if math.isinf(value):
        return SINGULAR
    if value == 0.0 or not 1e-4 <= abs(value) < _HUGE:
        return f"{value:.{digits}g}"
    return f"{value:z.{max(digits - 1 - math.floor(math.log10(abs(value))), 0)}f}"


def probability(p: float) -> str:
    """Return what follows ``p``: the sign (=, <) and the probability."""
    if p < 1e-4:
        return "< 0.0001"
    return "> 0.999" if p > 0.999 else f"= {p:.3f}" if p < 0.01 else f"= {p:.2f}"


def counted(number: int, noun: str) -> str:
    """Return ``1 photo`` or ``3 000 photos``."""
    return f"{number:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") + f" {agreeing(number, noun)}"


class LengthUnit(Struct, frozen=True):
    """The unit in which some lengths on the ground are read best, and how many of it a ground unit has."""

    name: str
    factor: float

    def of(self, value: float) -> str:
        """Return a length given in ground units with its unit; a dash for NaN."""
        text = significant(value * self.factor)
        return text if text in {MISSING, SINGULAR} else f"{text} {self.name}"


_SMALLER_UNITS = {"m": ("mm", 1000.0), "mm": ("µm", 1000.0)}
_SMALL = 0.2
"""Of the ground unit: the usual size below which lengths are given in the smaller unit, with two or three figures."""


def length_unit(sizes: ArrayLike, ground_unit: str) -> LengthUnit:
    """Return the unit in which most of these lengths (ground units) have two or three figures before many decimals."""
    known = np.abs(np.asarray(sizes, dtype=np.float64))
    known = known[np.isfinite(known) & (known > 0.0)]
    if ground_unit in _SMALLER_UNITS and known.size and np.median(known) < _SMALL:
        return LengthUnit(*_SMALLER_UNITS[ground_unit])
    return LengthUnit(ground_unit, 1.0)


NO_LINKS: Mapping[str, str] = MappingProxyType({})

_BETWEEN = "\0"


class PageColumn(Struct, frozen=True):
    """One column.

    Parameters
    ----------
    key : str
        Path of its figure in a record of result.json, e.g. ``X.sd``; empty where it shows none.
    cells : sequence of str
        One a row.
    words : bool
        The cells are names or words; else numbers, which are aligned to the right.
    foot : str
        Below the last row, where the table has a foot.
    links : mapping of str to str
        Cells that lead to another part of the page, or to another page, and its address.
    """

    heading: str
    cells: Sequence[str]
    unit: str = ""
    key: str = ""
    words: bool = False
    foot: str = ""
    links: Mapping[str, str] = NO_LINKS


class PageTable(Struct, frozen=True):
    """A table whose first column names the rows.

    Parameters
    ----------
    records : str
        List or mapping of result.json that the rows come from, e.g. ``points``; empty where there is none.
    columns : sequence of PageColumn
        All with the same number of cells.
    note : str
        Printed below the table: what was left out, what the figures mean.
    emphasised : set of int
        Rows that need attention.
    on_paper : int
        Rows that are printed, of longer tables; a browser shows all of them.
    """

    records: str
    caption: str
    columns: Sequence[PageColumn]
    note: str = ""
    emphasised: frozenset[int] = frozenset()
    on_paper: int = 60

    @property
    def body(self) -> Markup:
        """Return the rows as HTML; the first cell of each is its heading."""
        first, *others = self.columns
        starts = ['<tr class="emphasised">' if row in self.emphasised else "<tr>" for row in range(len(self))]
        starts[self.on_paper :] = [start.replace("<tr", '<tr data-screen=""', 1) for start in starts[self.on_paper :]]
        cells = [_cells(first, "th", ' scope="row"'), *(_cells(column, "td") for column in others)]
        return Markup("".join(["".join((*row, "</tr>\n")) for row in zip(starts, *cells, strict=True)]))

    @property
    def left_out(self) -> str:
        """Return what is said on paper of the rows that are not printed; empty where all are."""
        if len(self) <= self.on_paper:
            return ""
        return f"The first {self.on_paper} of {len(self)} rows are printed; the page has all."

    @property
    def foot(self) -> Markup:
        """Return the row below all others as HTML; empty where no column has one."""
        first, *others = self.columns
        if not any(column.foot for column in self.columns):
            return Markup("")
        cells = [*_cells(first, "th", ' scope="row"', [first.foot])]
        cells += [text for column in others for text in _cells(column, "td", "", [column.foot])]
        return Markup(f"<tfoot><tr>{''.join(cells)}</tr></tfoot>\n")

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.columns[0].cells)


def _cells(column: PageColumn, tag: str, attributes: str = "", cells: Sequence[str] | None = None) -> list[str]:
    """Return the cells of a column, or others in their place, as elements."""
    given = column.cells if cells is None else cells
    opening = f'<{tag}{attributes} class="words">' if column.words else f"<{tag}{attributes}>"
    # one call for all cells, parted by a character that no text has
    texts = str(escape(_BETWEEN.join(given))).split(_BETWEEN) if given else []
    if column.links:
        addresses = (column.links.get(cell) for cell in given)
        texts = [
            f'<a href="{escape(at)}">{text}</a>' if at else text for text, at in zip(texts, addresses, strict=True)
        ]
    return [f"{opening}{text}</{tag}>" for text in texts]
