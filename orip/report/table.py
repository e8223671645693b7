"""A table of the page: text cells under headings, and numbers as the page shows them."""

from __future__ import annotations

import math
from collections.abc import Sequence

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
    at_most : int
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


_BETWEEN = "\0"


class PageColumn(Struct, frozen=True):
    """One column.

    Parameters
    ----------
    heading : str
    unit : str
    key : str
        Path of its figure in a record of result.json, e.g. ``X.sd``; empty where it shows none.
    cells : sequence of str
        One a row.
    words : bool
        The cells are names or words; else numbers, which are aligned to the right.
    """

    heading: str
    cells: Sequence[str]
    unit: str = ""
    key: str = ""
    words: bool = False


class PageTable(Struct, frozen=True):
    """A table whose first column names the rows.

    Parameters
    ----------
    records : str
        List or mapping of result.json that the rows come from, e.g. ``points``; empty where there is none.
    caption : str
    columns : sequence of PageColumn
        All with the same number of cells.
    note : str
        Printed below the table: what was left out, what the figures mean.
    emphasised : set of int
        Rows that need attention.
    """

    records: str
    caption: str
    columns: Sequence[PageColumn]
    note: str = ""
    emphasised: frozenset[int] = frozenset()

    @property
    def body(self) -> Markup:
        """Return the rows as HTML; the first cell of each is its heading."""
        first, *others = self.columns
        starts = ['<tr class="emphasised">' if row in self.emphasised else "<tr>" for row in range(len(self))]
        cells = [_cells(first, "th", ' scope="row"'), *(_cells(column, "td") for column in others)]
        return Markup("".join(["".join((*row, "</tr>\n")) for row in zip(starts, *cells, strict=True)]))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.columns[0].cells)


def _cells(column: PageColumn, tag: str, attributes: str = "") -> list[str]:
    """Return the cells of a column as elements."""
    opening = f'<{tag}{attributes} class="words">' if column.words else f"<{tag}{attributes}>"
    # one call for all cells, parted by a character that no text has
    texts = str(escape(_BETWEEN.join(column.cells))).split(_BETWEEN) if column.cells else []
    return [f"{opening}{text}</{tag}>" for text in texts]
