"""A symmetric matrix of reduced unknowns as a band with a border: photos in the band, cameras in the border."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.sparse import coo_array, csr_array

from orip.adjustment.factorisation.band_panels import add_product, times
from orip.arrays import BoolArray, FloatArray, IntArray

_LEAST_UNKNOWNS = 400
"""Number of unknowns below which a full matrix is as fast."""
_LARGEST_SHARE = 0.4
"""Largest width of a band that pays, as a part of all unknowns."""
_BORDER_SHARE = 0.25
"""Part of all groups of unknowns; a group that is coupled with more of them goes to the border."""
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
    """

    places: IntArray
    banded: int
    width: int

    @property
    def columns(self) -> IntArray:
        """Return the unknowns (m,) in the order of their places."""
        return np.argsort(self.places)


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
        if (in_band & (i - j > self.arrangement.width)).any():
            message = "these unknowns have no observation in common: their cofactor is not computed"
            raise IndexError(message)
        found = np.empty(i.shape)
        found[in_band] = self.band[j[in_band], (i - j)[in_band]]
        found[~in_band] = self.border[i[~in_band] - banded, j[~in_band]]
        return found

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
        self.band[:] *= np.lib.stride_tricks.sliding_window_view(padded, width + 1)
        self.band[:] *= ordered[:banded, None]
        self.border[:] *= ordered
        self.border[:] *= ordered[banded:, None]

    def add_to_diagonal(self, number: float) -> None:
        """Add a number to all elements of the diagonal."""
        self.band[:, 0] += number
        own = np.arange(len(self.border))
        self.border[own, self.arrangement.banded + own] += number

    def copy(self) -> BandMatrix:
        """Return the same matrix, to be changed."""
        return BandMatrix(self.arrangement, self.band.copy(), self.border.copy())

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
        add_product(self.band, left[:banded], -right[:banded])
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
    """Return an arrangement that makes a narrow band, or None where a full matrix is better.

    The order is that of Cuthill and McKee (1969), reversed, or the given one where that is narrower.

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
    count = pattern.shape[0]
    is_border = np.diff(pattern.indptr) > _BORDER_SHARE * count
    if central is not None:
        is_border |= central
    inner = np.flatnonzero(~is_border)
    if not len(inner):
        return None
    graph = pattern[inner][:, inner]
    sizes = np.bincount(groups, minlength=count)
    from scipy.sparse.csgraph import reverse_cuthill_mckee  # takes its time to import; small blocks do without

    orders = [inner, inner[reverse_cuthill_mckee(graph, symmetric_mode=True)]]
    widths = [_width(graph.tocoo(), inner, order, sizes) for order in orders]
    best = orders[int(np.argmin(widths))]
    width, banded = min(widths), int(sizes[best].sum())
    if width > _LARGEST_SHARE * len(groups) or banded < 2 or _effort(banded, width, len(groups)) > len(groups) ** 3 / 3:
        return None
    order = np.concatenate([best, np.flatnonzero(is_border)])
    place_of_group = np.empty(count, dtype=np.int64)
    place_of_group[order] = np.cumsum(sizes[order]) - sizes[order]
    first = np.searchsorted(groups, np.arange(count))
    return Arrangement(place_of_group[groups] + np.arange(len(groups)) - first[groups], banded, width)


def _effort(banded: int, width: int, size: int) -> float:
    """Return the multiplications that a band with a border takes, where a full matrix takes a third of size cubed."""
    border = size - banded
    return banded * (width**2 + 2.0 * _BORDER_EFFORT * width * border + border**2) + border**3 / 3


def _width(graph: coo_array, inner: IntArray, order: IntArray, sizes: IntArray) -> int:
    """Return the largest distance of coupled unknowns in an order of their groups."""
    begins = np.zeros(len(sizes), dtype=np.int64)
    begins[order] = np.cumsum(sizes[order]) - sizes[order]
    ends = begins + sizes - 1
    return int((ends[inner[graph.row]] - begins[inner[graph.col]]).max(initial=1))
