"""Routines of LAPACK and BLAS for triangles and bands, and the factorisation of a wide band by its envelope."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct
from scipy.linalg import cython_blas, cython_lapack, lapack

from orip.arrays import FloatArray, IntArray
from orip.threads import by_threads

# Small blocks have hundreds of systems of some unknowns, which take less time than the checks of SciPy's
# `solve_triangular`.


def solve_lower(lower: FloatArray, right: FloatArray, *, transposed: bool = False) -> FloatArray:
    """Return L^-1 or L^-T times vectors.

    Parameters
    ----------
    lower : array (m, m)
        L; what stands above its diagonal is not read, and need not be finite.
    right : array (m,) or (m, k)
    transposed : bool
        Whether L^-T is wanted.

    Raises
    ------
    ValueError
        If a vector is not finite.
    numpy.linalg.LinAlgError
        If an element of the diagonal is zero.
    """
    finite = np.asarray_chkfinite(right)
    if not finite.size:
        return np.zeros(finite.shape)
    if lower.flags.f_contiguous:
        found, info = lapack.dtrtrs(lower, finite, lower=1, trans=int(transposed))
    else:  # LAPACK has columns where NumPy has rows
        found, info = lapack.dtrtrs(lower.T, finite, lower=0, trans=int(not transposed))
    if info != 0:
        message = f"element {info} of the diagonal is zero"
        raise np.linalg.LinAlgError(message)
    return np.asarray(found)


# SciPy's own wrappers keep the lock, and copy parts of a band; SciPy offers the routines themselves to compiled code in
# `scipy.linalg.cython_lapack` and `scipy.linalg.cython_blas`.
#
# A band (n, w + 1) has column j from its element j on. So the columns of a panel, from any row below its diagonal on,
# are a matrix whose columns lie w numbers apart.

_name_of_capsule = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", ctypes.pythonapi))
_pointer_in_capsule = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", ctypes.pythonapi)
)


def _routine(name: str, arguments: int, library: Any = cython_lapack) -> Callable[..., None]:
    """Return a routine of LAPACK, or of BLAS, with so many arguments, all of which are pointers."""
    capsule = library.__pyx_capi__[name]
    address = _pointer_in_capsule(capsule, _name_of_capsule(capsule))
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(address)


_FACTORISE, _SOLVE, _FACTORISE_FULL = _routine("dpbtrf", 6), _routine("dtbtrs", 11), _routine("dpotrf", 5)
_SOLVE_FULL, _SUBTRACT_SQUARE = _routine("dtrsm", 11, cython_blas), _routine("dsyrk", 10, cython_blas)
_MULTIPLY, _MULTIPLY_SYMMETRIC = _routine("dgemm", 13, cython_blas), _routine("dsymm", 12, cython_blas)
_SOLVE_VECTOR, _MULTIPLY_VECTOR = _routine("dtrsv", 8, cython_blas), _routine("dgemv", 11, cython_blas)

_INTEGER = ctypes.c_int if b", int *" in _name_of_capsule(cython_lapack.__pyx_capi__["dpbtrf"]) else ctypes.c_int64
"""SciPy may have been built with a LAPACK of long integers; the name of a routine's capsule has its types."""

# A panel of some hundred columns takes less time than NumPy takes for the addresses of a dozen arguments. `byref` is
# quick, and keeps what it points to; `from_buffer` takes none but arrays that are whole and may be written.

_Pointer = Any

_LOWER, _TRANSPOSED, _NOT, _LEFT, _RIGHT = (ctypes.byref(ctypes.c_char(letter)) for letter in b"LTNLR")
_ZERO, _ONE, _MINUS_ONE = (ctypes.byref(ctypes.c_double(value)) for value in (0.0, 1.0, -1.0))


def _number(value: int) -> _Pointer:
    return ctypes.byref(_INTEGER(value))


_STEP = _number(1)


def _element(array: FloatArray, place: int = 0) -> _Pointer:
    """Return a pointer to an element of an array, counted through its rows."""
    return ctypes.byref(ctypes.c_double.from_buffer(array.data, array.itemsize * place))


def _part(band: FloatArray, row: int, column: int) -> _Pointer:
    """Return what a routine takes as the part of a band from an element (row, column) on."""
    return _element(band, column * (band.shape[1] - 1) + row)


def factorise_in_place(band: FloatArray) -> int:
    """Replace a band (n, w + 1), in LAPACK's lower storage by columns, by its factor L; return LAPACK's `info`."""
    count, stored = band.shape
    info = _INTEGER(0)
    _FACTORISE(_LOWER, _number(count), _number(stored - 1), _element(band), _number(stored), ctypes.byref(info))
    return info.value


def reduce_in_place(band: FloatArray, vectors: FloatArray) -> None:
    """Replace vectors (k, n) by L^-1 of them, with L in a band (n, w + 1); zeros that all begin with stay zeros."""
    places = np.flatnonzero(vectors.any(axis=0))
    if places.size:
        _solve(band, vectors, int(places[0]), _NOT)


def substitute_in_place(band: FloatArray, vectors: FloatArray) -> None:
    """Replace vectors (k, n) by L^-T of them, with L in a band (n, w + 1)."""
    if vectors.size:
        _solve(band, vectors, 0, _TRANSPOSED)


def _solve(band: FloatArray, vectors: FloatArray, first: int, trans: _Pointer) -> None:
    """Replace the elements of vectors (k, n) from a first one on, with what a band has from its column there on."""
    count, stored = band.shape
    _SOLVE(
        _LOWER, trans, _NOT, _number(count - first), _number(stored - 1), _number(len(vectors)),
        _element(band, first * stored), _number(stored), _element(vectors, first), _number(vectors.shape[1]),
        _number(0),
    )  # fmt: skip


def eliminate_panel(band: FloatArray, start: int, end: int, reach: int) -> int:
    """Factorise a panel of columns, and subtract its product from the columns after it; return LAPACK's `info`.

    Its columns, from `start` on to that before `end`, reach down to the row before `reach`.
    """
    stride, count, info = _number(band.shape[1] - 1), _number(end - start), _INTEGER(0)
    _FACTORISE_FULL(_LOWER, count, _part(band, start, start), stride, ctypes.byref(info))
    if not info.value and reach > end:
        by_threads(lambda rows: _divide(band, start, end, *rows), _two_strips(end, reach, 0.5), 1)
        strips = _two_strips(end, reach, _FIRST_STRIP)
        by_threads(lambda strip: _subtract_square(band, start, end, reach, *strip), strips, 1)
    return info.value


_FROM_TWO_STRIPS = 512
"""Columns after a panel from which two threads pay; more of them take longer on one thread."""

_FIRST_STRIP = 1.0 - 0.5**0.5
"""Part of the columns of a triangle that has half of its elements."""


def _two_strips(end: int, reach: int, first: float) -> Iterable[tuple[int, int]]:
    """Return the borders of what comes after a panel: of two strips, the first one with so large a part, or of one."""
    between = [end + 32 * round(first * (reach - end) / 32)] if reach - end > _FROM_TWO_STRIPS else []
    return pairwise([end, *between, reach])


def _divide(band: FloatArray, start: int, end: int, first: int, last: int) -> None:
    """Replace the rows of a panel from `first` on to that before `last` by their product with L^-T of its diagonal."""
    stride = _number(band.shape[1] - 1)
    _SOLVE_FULL(
        _RIGHT, _LOWER, _TRANSPOSED, _NOT, _number(last - first), _number(end - start), _ONE,
        _part(band, start, start), stride, _part(band, first, start), stride,
    )  # fmt: skip


def _subtract_square(band: FloatArray, start: int, end: int, reach: int, first: int, last: int) -> None:
    """Subtract the product of a panel from the columns from `first` on to that before `last`."""
    stride, count, columns = _number(band.shape[1] - 1), _number(end - start), _number(last - first)
    own = _part(band, first, start)
    _SUBTRACT_SQUARE(
        _LOWER, _NOT, columns, count, _MINUS_ONE, own, stride, _ONE, _part(band, first, first), stride
    )  # fmt: skip
    if reach > last:
        _MULTIPLY(
            _NOT, _TRANSPOSED, _number(reach - last), columns, count, _MINUS_ONE, _part(band, last, start), stride,
            own, stride, _ONE, _part(band, last, first), stride,
        )  # fmt: skip


def solve_panel(band: FloatArray, start: int, end: int, reach: int, vectors: FloatArray) -> None:
    """Replace the panel's part of vectors (k, n) by that of L^-1 of them, and subtract what it takes off the rest."""
    _solve_in_panel(band, start, end, vectors, _NOT)
    if reach > end:
        _subtract_product(band, Panel(start, end, reach), vectors, _NOT)


def transposed_solve_panel(band: FloatArray, start: int, end: int, reach: int, vectors: FloatArray) -> None:
    """Replace the panel's part of vectors (k, n) by that of L^-T of them; that of the rows after it has been."""
    if reach > end:
        _subtract_product(band, Panel(start, end, reach), vectors, _TRANSPOSED)
    _solve_in_panel(band, start, end, vectors, _TRANSPOSED)


def _subtract_product(band: FloatArray, panel: Panel, vectors: FloatArray, trans: _Pointer) -> None:
    """Subtract the rows of a panel below its diagonal, times its part of vectors (k, n), from the part of the rows.

    Transposed: the other way round.
    """
    if not vectors.size:
        return
    start, end, reach = panel
    stride, below = _number(band.shape[1] - 1), _part(band, end, start)
    source, target = (start, end) if trans is _NOT else (end, start)
    if len(vectors) == 1:  # a product of matrices would first copy the panel
        _MULTIPLY_VECTOR(
            trans, _number(reach - end), _number(end - start), _MINUS_ONE, below, stride, _element(vectors, source),
            _STEP, _ONE, _element(vectors, target), _STEP,
        )  # fmt: skip
        return
    rows, columns = (reach - end, end - start) if trans is _NOT else (end - start, reach - end)
    size = _number(vectors.shape[1])
    _MULTIPLY(
        trans, _NOT, _number(rows), _number(len(vectors)), _number(columns), _MINUS_ONE, below, stride,
        _element(vectors, source), size, _ONE, _element(vectors, target), size,
    )  # fmt: skip


def symmetric_times(band: FloatArray, start: int, factor: FloatArray) -> FloatArray:
    """Return the symmetric matrix of n rows and columns of a band from a first one on times a matrix (n, k)."""
    result = np.zeros(factor.shape[::-1])
    if factor.size:
        size, columns = factor.shape
        _MULTIPLY_SYMMETRIC(
            _LEFT, _LOWER, _number(size), _number(columns), _ONE, _part(band, start, start),
            _number(band.shape[1] - 1), _element(np.array(factor.T, order="C")), _number(size), _ZERO,
            _element(result), _number(size),
        )  # fmt: skip
    return result.T


def _solve_in_panel(band: FloatArray, start: int, end: int, vectors: FloatArray, trans: _Pointer) -> None:
    if not vectors.size:
        return
    size, diagonal, stride = _number(end - start), _part(band, start, start), _number(band.shape[1] - 1)
    if len(vectors) == 1:
        _SOLVE_VECTOR(_LOWER, trans, _NOT, size, diagonal, stride, _element(vectors, start), _STEP)
        return
    _SOLVE_FULL(
        _LEFT, _LOWER, trans, _NOT, size, _number(len(vectors)), _ONE, diagonal, stride, _element(vectors, start),
        _number(vectors.shape[1]),
    )  # fmt: skip


# Elimination fills no column beyond the last place that it, or one before it, is coupled with (Jennings 1966). Columns
# go panel by panel; all within a panel reach equally far, so that each panel is a full matrix.

COLUMNS = 128
"""Columns of a panel: with so many a product of matrices takes far longer than fetching them from memory."""


class Panel(NamedTuple):
    """Columns from `start` on to that before `end`, whose rows go on to that before `reach`."""

    start: int
    end: int
    reach: int


def panels_of(reach: IntArray) -> list[Panel]:
    """Return the panels of columns that reach (n,) down to the place before a given one each."""
    borders = [*range(0, len(reach), COLUMNS), len(reach)]
    return [Panel(start, end, int(reach[end - 1])) for start, end in pairwise(borders)]


def reach_of_panels(last: IntArray) -> IntArray:
    """Return how far columns (n,) reach in panels.

    Parameters
    ----------
    last : array (n,) of int
        Last place that each column is coupled with.
    """
    count = len(last)
    farthest = np.maximum.accumulate(np.maximum(last, np.arange(count))) + 1
    ends = np.minimum(np.arange(count) // COLUMNS * COLUMNS + COLUMNS, count)
    return np.asarray(farthest[ends - 1])


def width_of(reach: IntArray) -> int:
    """Return the width of a band in whose storage the panels are matrices of LAPACK, with columns so far apart."""
    return max(panel.reach - panel.start for panel in panels_of(reach))


def effort_of(reach: IntArray) -> float:
    """Return the multiplications that the factorisation takes; a full matrix takes a sixth of its size cubed."""
    effort = 0.0
    for start, end, last in panels_of(reach):
        columns, below = end - start, last - end
        effort += columns**3 / 6.0 + columns * below * (columns + below) / 2.0
    return effort


class EnvelopeFactor(Struct, frozen=True):
    """The Cholesky factor of a band (n, w + 1).

    Parameters
    ----------
    band : array (n, w + 1)
        L by columns, as far as these reach.
    reach : array (n,) of int
        The place after the last one of each column.
    """

    band: FloatArray
    reach: IntArray

    @property
    def diagonal(self) -> FloatArray:
        """Return the diagonal (n,) of the factor."""
        return self.band[:, 0]

    def reduce(self, right: FloatArray) -> FloatArray:
        """Return c = L^-1 right for right-hand sides (n,) or (n, k)."""
        vectors = _rows_of(right)
        for panel in panels_of(self.reach):
            solve_panel(self.band, *panel, vectors)
        return vectors.T.reshape(right.shape)

    def back_substitute(self, reduced_right: FloatArray) -> FloatArray:
        """Return the solution (n,) or (n, k) of L^T x = c."""
        vectors = _rows_of(reduced_right)
        for panel in reversed(panels_of(self.reach)):
            transposed_solve_panel(self.band, *panel, vectors)
        return vectors.T.reshape(reduced_right.shape)

    def inverse(self) -> FloatArray:
        """Return the inverse (n, w + 1) as far as columns reach.

        Takahashi's recursion (1973), panel by panel from the last one: below a panel with L = (D; E) the inverse is
        Z G with G = -E D^-1 and the part Z that is known already, and the panel's own is D^-T D^-1 + G^T Z G.
        """
        result = np.zeros_like(self.band)
        for start, end, reach in reversed(panels_of(self.reach)):
            inverse, _ = lapack.dtrtri(_rectangle(self.band, start, end, start, end).T, lower=1)
            inverse = np.tril(inverse)
            multiplier = -_rectangle(self.band, start, end, end, reach).T @ inverse
            below = symmetric_times(result, end, multiplier)
            own = inverse.T @ inverse + multiplier.T @ below
            _rectangle(result, start, end, end, reach)[:] = below.T
            square = _rectangle(result, start, end, start, end)
            np.copyto(square, own, where=np.triu(np.ones(own.shape, dtype=bool)))
        return result


def factorise_envelope(band: FloatArray, reach: IntArray) -> EnvelopeFactor | None:
    """Return the factor of a band (n, w + 1) in LAPACK's lower storage by columns; None if it has none.

    Parameters
    ----------
    band : array (n, w + 1)
        Its width is that of `width_of`, or larger.
    reach : array (n,) of int
        As `reach_of_panels` returns it.
    """
    factor, panels = np.empty_like(band), panels_of(reach)

    def copy(panel: Panel) -> None:
        start, end, last = panel
        factor[start:end, : last - start] = band[start:end, : last - start]

    by_threads(copy, panels)
    for panel in panels:
        if eliminate_panel(factor, *panel):
            return None
    # not every LAPACK stops at a pivot that is not a number
    return EnvelopeFactor(factor, reach) if np.isfinite(factor[:, 0]).all() else None


def _rows_of(vectors: FloatArray) -> FloatArray:
    """Return a copy (k, n) of vectors (n,) or (n, k)."""
    return np.array(np.atleast_2d(vectors.T), order="C")


def _rectangle(band: FloatArray, start: int, end: int, first: int, last: int) -> FloatArray:
    """Return a view (end - start, last - first) of columns of a band from row `first` on to that before `last`.

    What stands above the diagonal belongs to other columns.
    """
    stride = band.shape[1] - 1
    elements = band.reshape(-1)[start * stride + first :]
    return np.lib.stride_tricks.as_strided(elements, (end - start, last - first), (8 * stride, 8))
