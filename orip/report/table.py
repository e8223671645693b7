"""A table of the page: text cells under headings, which name the figure of result.json that they show."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup, escape
from msgspec import Struct

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
