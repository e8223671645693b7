"""Points as rows of R that they have to themselves, what they say about the reduced unknowns, and panels of rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from scipy.linalg.lapack import dgeqp3, dormqr, dtrtrs

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.structs import replace


class Panel(NamedTuple):
    """Rows `first` to `last` of R, and the end of the columns in which they are not zero."""

    first: int
    last: int
    end: int


class Replaced(NamedTuple):
    """The triangle from a row on, before a change."""

    first: int
    panels: list[tuple[Panel, FloatArray, FloatArray]]
    reach: IntArray
    square_sums: FloatArray
    residual_square_sum: float
    rounding: float


def pivotal(block: FloatArray) -> FloatArray:
    """Return a diagonal block of R, with 1 as the pivot of rows that are zero."""
    empty = np.diagonal(block) == 0.0
    return np.where(np.diag(empty), 1.0, block) if empty.any() else block


# From R N^-1 = R^-T, panel by panel from the last one on: what a panel needs of N^-1 has been computed by then
# (Takahashi, Fagan and Chen 1973; Erisman and Tinney 1975, *On computing certain elements of the inverse of a sparse
# matrix*).


def cofactors_in_band(factor: FloatArray, panels: Sequence[Panel], determined: BoolArray) -> FloatArray:
    """Return N^-1 (n, n) for the unknowns that a row of R has in common; elsewhere it is zero.

    Parameters
    ----------
    factor : array (n or more, n or more)
        R.
    panels : sequence of Panel
        All its rows.
    determined : array (n,) of bool
        The unknowns that are not held.
    """
    found, end, reaching = np.zeros((len(determined), len(determined))), 0, []
    for panel in panels:
        # what a row has in common, all rows below it have that have one of both
        end = max(end, panel.end)
        reaching.append(panel._replace(end=end))
    for panel in reversed(reaching):
        own, beyond = slice(panel.first, panel.last), slice(panel.last, panel.end)
        block, across = pivotal(factor[own, own]), factor[own, beyond]
        found[own, beyond] = -dtrtrs(block, across @ found[beyond, beyond])[0]
        found[beyond, own] = found[own, beyond].T
        inverse = dtrtrs(block, np.diag(determined[own].astype(np.float64)), trans=1)[0]
        found[own, own] = dtrtrs(block, inverse - across @ found[beyond, own])[0]
    return found


class ReducedRows(NamedTuple):
    """k observation equations in reduced unknowns alone.

    Attributes
    ----------
    columns : array (c,) of int
        Unknowns that they touch, ascending.
    rows : array (k, c)
        Partials, divided by the a-priori errors.
    right : array (k,)
        Observed minus computed, divided by the a-priori errors.
    """

    columns: IntArray
    rows: FloatArray
    right: FloatArray


def reduced_together(equations: Sequence[ReducedRows]) -> ReducedRows:
    """Return equations in reduced unknowns as those of one."""
    columns, places = np.unique(np.concatenate([one.columns for one in equations]), return_inverse=True)
    rows, row, place = np.zeros((sum(len(one.right) for one in equations), len(columns))), 0, 0
    for one in equations:
        next_row, next_place = row + len(one.right), place + len(one.columns)
        rows[row:next_row, places[place:next_place]] = one.rows
        row, place = next_row, next_place
    return ReducedRows(columns, rows, np.concatenate([one.right for one in equations]))


# The equations of a point touch its three coordinates and some reduced unknowns: [A_p A_e | l]. An orthogonal
# factorisation of the columns A_p gives as many rows as the point has determined coordinates, its hyper-row, which
# tells where the point is once the reduced unknowns are known. All further rows have no coordinate of the point any
# more: they are equations of the reduced unknowns.

_WORK = 32
"""Numbers of LAPACK's work space for each column."""

_ZERO_PIVOT = 1e-8
"""Part of a point's largest column below which a pivot is rounding: its rays are parallel in that coordinate."""


class ObservationRows(Struct, frozen=True):
    """The k linearised equations of one observation, divided by the a-priori errors.

    Parameters
    ----------
    point : str or None
        The point whose coordinates it touches; None: only reduced unknowns.
    by_point : array (k, 3)
        Partials by these coordinates, zero where one is constant.
    columns : array (c,) of int
        Reduced unknowns that it touches, ascending.
    by_reduced : array (k, c)
    right : array (k,)
        Observed minus computed at the origin of the unknowns.
    exact : bool
        An exact constraint, which has no part in sigma0.
    """

    point: str | None
    by_point: FloatArray
    columns: IntArray
    by_reduced: FloatArray
    right: FloatArray
    exact: bool = False

    @property
    def reduced(self) -> ReducedRows:
        """Return its equations of the reduced unknowns: all there is of one that touches no point."""
        return ReducedRows(self.columns, self.by_reduced, self.right)

    def weighted(self, root: float) -> ObservationRows:
        """Return the equations multiplied by the root of a weight."""
        return replace(self, by_point=root * self.by_point, by_reduced=root * self.by_reduced, right=root * self.right)

    def rows(self) -> list[ObservationRows]:
        """Return the equations one by one."""
        return [
            ObservationRows(
                self.point, self.by_point[[row]], self.columns, self.by_reduced[[row]], self.right[[row]], self.exact
            )
            for row in range(len(self.right))
        ]


class HyperRow(Struct, frozen=True):
    """The r rows of R of one point.

    Parameters
    ----------
    coordinates : array (r,) of int
        Those that are determined, in the order of the factorisation; the others are held.
    factor : array (r, r)
        Upper triangle.
    columns : array (c,) of int
        Reduced unknowns, ascending.
    coupling : array (r, c)
    right : array (r,)
    free : int
        Coordinates of the point that are unknowns.
    """

    coordinates: IntArray
    factor: FloatArray
    columns: IntArray
    coupling: FloatArray
    right: FloatArray
    free: int

    @property
    def is_complete(self) -> bool:
        """Return whether all coordinates are determined: more observations only tell of reduced unknowns then."""
        return len(self.coordinates) == self.free

    def with_row(self, row: ObservationRows) -> tuple[HyperRow, ReducedRows]:
        """Return a complete hyper-row with one more equation, and what that says about the reduced unknowns."""
        count = len(self.coordinates)
        columns = np.union1d(self.columns, row.columns)
        by_reduced = np.zeros((count + 1, len(columns)))
        by_reduced[:count, np.searchsorted(columns, self.columns)] = self.coupling
        by_reduced[count:, np.searchsorted(columns, row.columns)] = row.by_reduced
        rest = np.column_stack([by_reduced, np.concatenate([self.right, row.right])])
        rotation, factor = np.linalg.qr(np.vstack([self.factor, row.by_point[:, self.coordinates]]), mode="complete")
        rest = rotation.T @ rest
        changed = HyperRow(self.coordinates, factor[:count], columns, rest[:count, :-1], rest[:count, -1], self.free)
        return changed, ReducedRows(columns, rest[count:, :-1], rest[count:, -1])

    def coordinates_at(self, reduced: FloatArray) -> FloatArray:
        """Return the corrections (3,) of the point for corrections of the reduced unknowns; 0 where one is held."""
        found = np.zeros(3)
        found[self.coordinates] = self._substituted(self.right - self.coupling @ reduced[self.columns])
        return found

    def _substituted(self, right: FloatArray, transposed: int = 0) -> FloatArray:
        """Return R^-1 b or R^-T b; LAPACK itself, as systems of three take less time than a wrapper's checks."""
        if not len(self.coordinates):
            return right
        found, _ = dtrtrs(self.factor, right, trans=transposed)
        return np.asarray(found)

    def whitened(self, rows: ObservationRows) -> tuple[FloatArray, ReducedRows]:
        """Return R^-T a^T (r, k) of the point's part of rows, and what is left of them.

        The right-hand sides of what is left are those of the rows less what the hyper-row explains.
        """
        inner = self._substituted(rows.by_point[:, self.coordinates].T, transposed=1)
        if np.array_equal(self.columns, rows.columns):
            columns, left = self.columns, rows.by_reduced - inner.T @ self.coupling
        else:
            columns = np.union1d(self.columns, rows.columns)
            left = np.zeros((len(rows.right), len(columns)))
            left[:, np.searchsorted(columns, rows.columns)] = rows.by_reduced
            left[:, np.searchsorted(columns, self.columns)] -= inner.T @ self.coupling
        return inner, ReducedRows(columns, left, rows.right - inner.T @ self.right)


def stacked(observations: Sequence[ObservationRows]) -> ObservationRows:
    """Return the equations of several observations of one point as those of one."""
    if len(observations) == 1:
        return observations[0]
    by_point = np.concatenate([rows.by_point for rows in observations])
    columns, by_reduced, right = reduced_together([rows.reduced for rows in observations])
    return ObservationRows(observations[0].point, by_point, columns, by_reduced, right)


def factored(observations: Sequence[ObservationRows]) -> tuple[HyperRow, ReducedRows]:
    """Return the hyper-row of the observations of one point, and their equations of the reduced unknowns alone."""
    rows = stacked(observations)
    rest = np.asfortranarray(np.column_stack([rows.by_reduced, rows.right]))
    # LAPACK itself: a wrapper's checks and a full Q take longer than these small systems
    factor, order, scalars, _, _ = dgeqp3(rows.by_point)
    rest, _, _ = dormqr("L", "T", factor[:, : len(scalars)], scalars, rest, _WORK * rest.shape[1], overwrite_c=1)
    pivots = np.abs(np.diagonal(factor))
    rank = int(np.count_nonzero(pivots > _ZERO_PIVOT * max(float(pivots[0]), 0.0))) if len(pivots) else 0
    own = HyperRow(
        np.asarray(order[:rank] - 1, dtype=np.int64),
        np.triu(factor[:rank, :rank]),
        rows.columns,
        rest[:rank, :-1],
        rest[:rank, -1],
        int(np.count_nonzero(rows.by_point.any(axis=0))),
    )
    return own, ReducedRows(rows.columns, rest[rank:, :-1], rest[rank:, -1])


class PointInTriangle(NamedTuple):
    """A point as it is in the triangle."""

    hyper_row: HyperRow
    reduced: tuple[ReducedRows, ...]


class PointsInTriangle(dict[str, PointInTriangle]):
    """Points by name, and how many coordinates of them are determined."""

    def __init__(self, points: Mapping[str, PointInTriangle] | None = None) -> None:
        super().__init__(points or {})
        self.coordinates = sum(len(point.hyper_row.coordinates) for point in self.values())

    def __setitem__(self, name: str, point: PointInTriangle) -> None:
        before = self.get(name)
        self.coordinates += len(point.hyper_row.coordinates)
        self.coordinates -= 0 if before is None else len(before.hyper_row.coordinates)
        super().__setitem__(name, point)

    def taken(self, name: str) -> PointInTriangle:
        """Take a point out, and return it."""
        point = self.pop(name)
        self.coordinates -= len(point.hyper_row.coordinates)
        return point

    def __reduce__(self) -> tuple[type[PointsInTriangle], tuple[dict[str, PointInTriangle]]]:
        """Return how a copy is made: set item by item, it would count the coordinates twice."""
        return PointsInTriangle, (dict(self),)

    def copy(self) -> PointsInTriangle:
        """Return the same points, to go back to them."""
        return PointsInTriangle(self)


def factored_point(observations: Sequence[ObservationRows]) -> PointInTriangle:
    """Return a point that its observations alone determine."""
    hyper_row, reduced = factored(observations)
    return PointInTriangle(hyper_row, (reduced,) if len(reduced.right) else ())
