"""Parts of a band as full matrices: panels of consecutive columns.

Row j of a band (n, w + 1) has the elements (j, j) to (j + w, j) of a symmetric or a lower triangular matrix. A panel of
`count` columns has rows from its first column on to w rows beyond its last one; it is kept transposed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.threads import by_threads

PANEL = 64
"""Columns of a panel."""

_PANELS_OF_A_THREAD = 16
"""Panels of some thousand elements for which a thread pays."""


def columns_of(band: FloatArray) -> FloatArray:
    """Return columns of a band (count, w + 1) as a panel (count, count + w), zero above the diagonal."""
    count, stored = band.shape
    panel = np.zeros((count, count + stored - 1))
    stored_part(panel)[:] = band
    return panel


def stored_part(panel: FloatArray) -> FloatArray:
    """Return what a band stores of a panel (count, count + w), as a view (count, w + 1)."""
    count, rows = panel.shape
    row, column = panel.strides
    return np.lib.stride_tricks.as_strided(panel, (count, rows - count + 1), (row + column, column))


def from_the_end(band: FloatArray, count: int) -> FloatArray:
    """Return a view (count, w + 1) of the band of a matrix whose rows and columns run backwards.

    Its last column is the one that is w before the first one of the band, at most.
    """
    stored = band.shape[1]
    row, column = band.strides
    return np.lib.stride_tricks.as_strided(band[-1:], (count, stored), (-row, column - row))


def add_product(band: FloatArray, left: FloatArray, right: FloatArray, reach: IntArray | None = None) -> None:
    """Add L R^T, a symmetric matrix of factors (n, k), to a band (n, w + 1), as far as its columns reach (n,)."""
    left = np.vstack([left, np.zeros((band.shape[1] - 1, left.shape[1]))])

    def add_to_panel(panel: tuple[int, FloatArray]) -> None:
        start, part = panel
        count, stored = part.shape
        np.add(part, stored_part(right[start : start + count] @ left[start : start + count + stored - 1].T), out=part)

    by_panels(add_to_panel, band, reach)


def by_panels(task: Callable[[tuple[int, FloatArray]], None], band: FloatArray, reach: IntArray | None) -> None:
    """Do a task for each of `parts_of` a band, on several threads where it has many."""
    by_threads(task, parts_of(band, reach), _PANELS_OF_A_THREAD)


def parts_of(band: FloatArray, reach: IntArray | None) -> Iterator[tuple[int, FloatArray]]:
    """Yield panels of a band (n, w + 1) as views (count, h), and their first columns; h is how far the columns reach.

    `reach` (n,) has the place after the last one of each column, ascending; None: all have the width of the band.
    """
    for start in range(0, len(band), PANEL):
        part = band[start : start + PANEL]
        yield start, part if reach is None else part[:, : reach[start + len(part) - 1] - start]


def times(band: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return a symmetric matrix, given by its band (n, w + 1), times vectors (n, k)."""
    result = np.zeros_like(vectors)
    for start in range(0, len(band), PANEL):
        panel = columns_of(band[start : start + PANEL])[:, : len(band) - start]
        count, rows = panel.shape
        result[start : start + rows] += panel.T @ vectors[start : start + count]
        np.fill_diagonal(panel, 0.0)
        result[start : start + count] += panel @ vectors[start : start + rows]
    return result
