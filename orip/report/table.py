"""A table of the page: text cells under headings, which name the figure of result.json that they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PageColumn:
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


@dataclass(frozen=True, slots=True)
class PageTable:
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
    def rows(self) -> list[tuple[tuple[PageColumn, str], ...]]:
        """Return the rows, each as its columns and cells."""
        return [
            tuple(zip(self.columns, cells, strict=True))
            for cells in zip(*(column.cells for column in self.columns), strict=True)
        ]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.columns[0].cells)
