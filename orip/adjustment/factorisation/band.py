"""A symmetric matrix of reduced unknowns as a band with a border: photos in the band, cameras in the border."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array

from orip.adjustment.factorisation.lapack import effort_of, reach_of_panels, width_of
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.threads import by_threads

# Row j of a band (n, w + 1) has the elements (j, j) to (j + w, j) of a symmetric or a lower triangular matrix. A panel
# of `count` columns has rows from its first column on to w rows beyond its last one; it is kept transposed.

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


_LEAST_UNKNOWNS = 400
"""Number of unknowns below which a full matrix is as fast."""
_LARGEST_SHARE = 0.4
"""Largest width of a band that pays, as a part of all unknowns."""
_BORDER_SHARE = 0.25
"""Part of all groups of unknowns; a group that is coupled with more of them goes to the border."""
_WIDE_BORDER_SHARE = 0.75
"""The same in a wide band."""
_WIDE_GAIN = 0.7
"""Part of the multiplications of a full matrix up to which a wide band pays."""
_BORDER_EFFORT = 8.0
"""Time of a multiplication where the border is divided by the band's factor, row by row, over that of a product of full
matrices."""


class Arrangement(Struct, frozen=True):
    """Places of m reduced unknowns: the first `banded` are coupled over at most `width` places, the others with all.

    Parameters
    ----------
    places : array (m,) of int
    banded : int
    width : int
    reach : array (banded,) of int, or None
        Of a wide band, the place after the last one of those that each place, or one before it, is coupled with; the
        same for all of a panel (`reach_of_panels`). None: the band is narrow.
    """

    places: IntArray
    banded: int
    width: int
    reach: IntArray | None = None

    @property
    def columns(self) -> IntArray:
        """Return the unknowns (m,) in the order of their places."""
        columns = np.empty_like(self.places)
        columns[self.places] = np.arange(len(columns))
        return columns


class BandMatrix(Struct, frozen=True):
    """The lower triangle of a symmetric matrix (m, m) in an arrangement.

    Parameters
    ----------
    arrangement : Arrangement
    band : array (banded, width + 1)
        Row j has the elements (j, j) to (j + width, j): LAPACK's lower band storage by columns.
    border : array (m - banded, m)
        Full rows of the other places.
    """

    arrangement: Arrangement
    band: FloatArray
    border: FloatArray

    def __len__(self) -> int:
        return len(self.arrangement.places)

    def __getitem__(self, key: tuple[IntArray | int, ...]) -> FloatArray:
        """Return elements of the matrix by rows and columns, which are broadcast; each must be stored.

        Raises
        ------
        IndexError
            For an element outside the band.
        """
        places = self.arrangement.places
        one, other = np.broadcast_arrays(places[key[0]], places[key[1]])
        i, j = np.maximum(one, other), np.minimum(one, other)
        banded = self.arrangement.banded
        in_band = i < banded
        if (in_band & ~self._is_stored(i, j)).any():
            message = "these unknowns have no observation in common: their cofactor is not computed"
            raise IndexError(message)
        found = np.empty(i.shape)
        found[in_band] = self.band[j[in_band], (i - j)[in_band]]
        found[~in_band] = self.border[i[~in_band] - banded, j[~in_band]]
        return found

    def _is_stored(self, i: IntArray, j: IntArray) -> BoolArray:
        """Return whether elements (i, j), i >= j, that are not in the border are in the band."""
        arrangement = self.arrangement
        if arrangement.reach is None:
            return np.asarray(i - j <= arrangement.width)
        return np.asarray(i < arrangement.reach[np.minimum(j, arrangement.banded - 1)])

    def diagonal(self) -> FloatArray:
        """Return the diagonal (m,)."""
        every = np.arange(len(self))
        return self[every, every]

    def add(self, matrix: csr_array) -> None:
        """Add a sparse symmetric matrix (m, m) that fits into the band."""
        elements = matrix.tocoo()
        i, j = self.arrangement.places[elements.row], self.arrangement.places[elements.col]
        banded = self.arrangement.banded
        in_band, in_border = (i >= j) & (i < banded), (i >= j) & (i >= banded)
        np.add.at(self.band, (j[in_band], (i - j)[in_band]), elements.data[in_band])
        np.add.at(self.border, (i[in_border] - banded, j[in_border]), elements.data[in_border])

    def scale(self, factors: FloatArray) -> None:
        """Multiply rows and columns by factors (m,)."""
        banded, width = self.arrangement.banded, self.arrangement.width
        ordered = factors[self.arrangement.columns]
        # elements of the band beyond the last row are not part of the matrix
        padded = np.append(ordered[:banded], np.zeros(width))
        of_rows = np.lib.stride_tricks.sliding_window_view(padded, width + 1)

        def scale_panel(panel: tuple[int, FloatArray]) -> None:
            start, part = panel
            count, stored = part.shape
            np.multiply(part, of_rows[start : start + count, :stored], out=part)
            np.multiply(part, ordered[start : start + count, None], out=part)

        by_panels(scale_panel, self.band, self.arrangement.reach)
        self.border[:] *= ordered
        self.border[:] *= ordered[banded:, None]

    def add_to_diagonal(self, number: float) -> None:
        """Add a number to all elements of the diagonal."""
        self.band[:, 0] += number
        own = np.arange(len(self.border))
        self.border[own, self.arrangement.banded + own] += number

    def times(self, vectors: FloatArray) -> FloatArray:
        """Return the matrix times vectors (m, k)."""
        banded = self.arrangement.banded
        ordered = vectors[self.arrangement.columns]
        result = np.zeros_like(ordered)
        result[:banded] = times(self.band, ordered[:banded])
        lower = np.tril(self.border, banded)
        result[banded:] += lower @ ordered
        result += np.tril(self.border, banded - 1).T @ ordered[banded:]
        return np.asarray(result[self.arrangement.places])

    def subtract_product(self, left: FloatArray, right: FloatArray) -> None:
        """Subtract L R^T, a symmetric matrix of factors (m, k), where the matrix has its band and border."""
        banded = self.arrangement.banded
        left, right = left[self.arrangement.columns], right[self.arrangement.columns]
        add_product(self.band, left[:banded], -right[:banded], self.arrangement.reach)
        self.border[:] -= left[banded:] @ right.T

    def toarray(self) -> FloatArray:
        """Return the full matrix (m, m) in the unknowns' own order."""
        size, banded, width = len(self), self.arrangement.banded, self.arrangement.width
        lower = np.zeros((size, size))
        elements = lower.ravel()
        for below in range(min(width + 1, banded)):
            elements[below * size :: size + 1][: banded - below] = self.band[: banded - below, below]
        lower[banded:] = np.tril(self.border, banded)
        return np.asarray((lower + np.tril(lower, -1).T)[np.ix_(self.arrangement.places, self.arrangement.places)])


def zero_matrix(arrangement: Arrangement) -> BandMatrix:
    """Return a matrix of zeros."""
    size, banded = len(arrangement.places), arrangement.banded
    return BandMatrix(arrangement, np.zeros((banded, arrangement.width + 1)), np.zeros((size - banded, size)))


def band_of(matrix: csr_array, arrangement: Arrangement) -> BandMatrix:
    """Return a sparse symmetric matrix (m, m) as a band with a border."""
    result = zero_matrix(arrangement)
    result.add(matrix)
    return result


def arranged(groups: IntArray, touched: csr_array, central: BoolArray | None = None) -> Arrangement | None:
    """Return an arrangement that makes a band, or None where a full matrix is better.

    The order is that of Cuthill and McKee (1969), reversed, or the given one where that is narrower. Where both make a
    wide band, it is the spectral one (Barnard, Pothen and Simon 1993) if that takes less.

    Parameters
    ----------
    groups : array (m,) of int
        Group of each unknown, ascending from 0; unknowns of a group stay together.
    touched : sparse array (r, g)
        Not zero where an observation, or an eliminated block, touches a group.
    central : array (g,) of bool, optional
        Groups that go to the border whatever they are coupled with: cofactors between all of them are asked for.
    """
    if len(groups) < _LEAST_UNKNOWNS:
        return None
    pattern = (touched.T @ touched).tocsr()
    of_border = np.zeros(pattern.shape[0], dtype=bool) if central is None else central
    sizes = np.bincount(groups, minlength=pattern.shape[0])
    return _narrow(groups, pattern, sizes, of_border) or _wide(groups, pattern, sizes, of_border)


def in_order(order: IntArray, in_band: BoolArray, touching: IntArray, touched: IntArray) -> Arrangement:
    """Return the arrangement of unknowns in a given order, those in the border last.

    Parameters
    ----------
    order : array (m,) of int
    in_band : array (m,) of bool
        Unknowns that are not in the border.
    touching, touched : arrays (k,) of int
        Pairs of an observation, or eliminated block, and the first unknown of a group that it touches.
    """
    order = np.concatenate([order[in_band[order]], order[~in_band[order]]])
    places = np.empty_like(order)
    places[order] = np.arange(len(order))
    mine = in_band[touched]
    number, place = touching[mine], places[touched[mine]]
    count = int(number.max(initial=-1)) + 1
    first, last = np.full(count, len(order)), np.full(count, -1)
    np.minimum.at(first, number, place)
    np.maximum.at(last, number, place)
    # groups have six unknowns at most
    width = min(int((last - first).max(initial=0)) + 5, max(int(in_band.sum()) - 1, 0))
    return Arrangement(places, int(in_band.sum()), width)


def _narrow(groups: IntArray, pattern: csr_array, sizes: IntArray, central: BoolArray) -> Arrangement | None:
    """Return the arrangement as a narrow band; None if there is none."""
    is_border = central | (np.diff(pattern.indptr) > _BORDER_SHARE * len(sizes))
    inner = np.flatnonzero(~is_border)
    if not len(inner):
        return None
    graph = pattern[inner][:, inner]
    orders = [np.arange(len(inner)), _neighbours_together(graph)]
    lasts = [_last_places(graph, order, sizes[inner]) for order in orders]
    widths = [int((last - np.arange(len(last))).max(initial=1)) for last in lasts]
    best = int(np.argmin(widths))
    width, banded = widths[best], len(lasts[best])
    if width > _LARGEST_SHARE * len(groups) or banded < 2 or _effort(banded, width, len(groups)) > len(groups) ** 3 / 3:
        return None
    return Arrangement(_places(groups, sizes, inner[orders[best]], is_border), banded, width)


def _wide(groups: IntArray, pattern: csr_array, sizes: IntArray, central: BoolArray) -> Arrangement | None:
    """Return the arrangement as a wide band whose columns reach differently far; None if a full matrix is better."""
    is_border = central | (np.diff(pattern.indptr) > _WIDE_BORDER_SHARE * len(sizes))
    inner = np.flatnonzero(~is_border)
    border = int(sizes[is_border].sum())
    if len(inner) < 2:
        return None
    graph = pattern[inner][:, inner]
    orders = [_neighbours_together(graph), _spectral_order(graph)]
    reaches = [reach_of_panels(_last_places(graph, order, sizes[inner])) for order in orders]
    efforts = [effort_of(reach) for reach in reaches]
    best = int(np.argmin(efforts))
    reach, banded = reaches[best], len(reaches[best])
    width = width_of(reach)
    if efforts[best] + banded * border * (2.0 * width + border) > _WIDE_GAIN * len(groups) ** 3 / 6:
        return None
    return Arrangement(_places(groups, sizes, inner[orders[best]], is_border), banded, width, reach)


def _neighbours_together(graph: csr_array) -> IntArray:
    """Return the order of nodes of Cuthill and McKee, reversed."""
    from scipy.sparse.csgraph import reverse_cuthill_mckee  # takes its time to import; small blocks do without

    return np.asarray(reverse_cuthill_mckee(graph, symmetric_mode=True))


def _spectral_order(graph: csr_array) -> IntArray:
    """Return the order of nodes by the smoothest function on a graph that is not constant.

    It is the second eigenvector of the normalised Laplace matrix: neighbours differ least.
    """
    from scipy.linalg import eigh  # takes its time to import; narrow bands do without

    adjacent = (graph.toarray() != 0.0).astype(np.float64)
    np.fill_diagonal(adjacent, 0.0)
    scale = 1.0 / np.sqrt(np.maximum(adjacent.sum(axis=1), 1.0))
    laplace = np.eye(len(adjacent)) - scale[:, None] * adjacent * scale
    _, vectors = eigh(laplace, subset_by_index=[1, 1])
    return np.argsort(vectors[:, 0] * scale, kind="stable")


def _places(groups: IntArray, sizes: IntArray, order: IntArray, is_border: BoolArray) -> IntArray:
    """Return the places (m,) of unknowns whose groups come in an order, and then those of the border."""
    every = np.concatenate([order, np.flatnonzero(is_border)])
    place_of_group = np.empty(len(sizes), dtype=np.int64)
    place_of_group[every] = np.cumsum(sizes[every]) - sizes[every]
    first = np.searchsorted(groups, np.arange(len(sizes)))
    return np.asarray(place_of_group[groups] + np.arange(len(groups)) - first[groups])


def _effort(banded: int, width: int, size: int) -> float:
    """Return the multiplications that a band with a border takes, where a full matrix takes a third of size cubed."""
    border = size - banded
    return banded * (width**2 + 2.0 * _BORDER_EFFORT * width * border + border**2) + border**3 / 3


def _last_places(graph: csr_array, order: IntArray, sizes: IntArray) -> IntArray:
    """Return the last place that each place is coupled with, of unknowns whose groups come in an order."""
    begins = np.zeros(len(sizes), dtype=np.int64)
    begins[order] = np.cumsum(sizes[order]) - sizes[order]
    last = begins + sizes - 1
    elements = graph.tocoo()
    np.maximum.at(last, elements.col, begins[elements.row] + sizes[elements.row] - 1)
    return np.repeat(last[order], sizes[order])
