"""The upper triangle R of a least squares adjustment, and how observation equations are taken in and out of it.

With design matrix A and right-hand side l, both divided by the a-priori errors, and an orthogonal Q that is never
formed, Q [A l] = [R d; 0 q]: R^T R = A^T A, the solution is R^-1 d, and q^2 is the square sum of the residuals. An
equation is taken in by Householder reflections of R over the new row (LAPACK's ``tpqrt``; Golub and Van Loan 2013,
section 6.5), and taken out by the product form of Gill, Golub, Murray and Saunders 1974, *Methods for modifying matrix
factorizations*, section 3, for some equations together. Both walk over panels of rows and over the columns alone that a
panel reaches: R of a block of photos is a band.

An unknown that nothing determines has a pivot of zero, and its row of R is zero. That is a state like any other, not an
error: such unknowns are held at zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.linalg.lapack import dtpmqrt, dtpqrt, dtrtrs

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.online.sequential.hyper_rows import Panel, ReducedRows, Replaced, cofactors_in_band, pivotal

_PANEL = 48
"""Rows of R that are transformed together: wide enough for LAPACK, narrow enough for a band."""

_TOGETHER = 4
"""Equations that are taken out together at the most: the work on each row of R grows with the cube."""

_ZERO_PIVOT = 1e-9
"""Part of an unknown's column in R below which its pivot is rounding: nothing determines the unknown. Rounding has been
met that came to 1.3e-10 of a column that depends on others."""

_ROOM = 60
"""Unknowns by which the arrays grow at least: ten photos."""


class Triangle:
    """R (n, n), d (n,) and q^2 of n unknowns, of which more can be appended.

    Attributes
    ----------
    size : int
        n.
    residual_square_sum : float
        q^2.
    rounding : float
        Sum of 1 / r of the equations that were taken out since it was built: each magnifies its rounding so much
        (Stewart 1979).
    """

    def __init__(self, size: int = 0) -> None:
        self.size = size
        self.residual_square_sum = 0.0
        self.rounding = 0.0
        self._factor = np.zeros((size, size))
        self._right = np.zeros(size)
        # end of the columns in which each row is not zero
        self._reach = np.arange(size, dtype=np.int64) + 1
        # of the columns of all rows that are in
        self._square_sums = np.zeros(size)

    @property
    def factor(self) -> FloatArray:
        """Return R (n, n); its rows have any sign."""
        return self._factor[: self.size, : self.size]

    @property
    def right(self) -> FloatArray:
        """Return d (n,), in the signs of the rows of R."""
        return self._right[: self.size]

    def append(self, count: int) -> None:
        """Append unknowns that nothing determines yet."""
        capacity, needed = len(self._right), self.size + count
        if needed > capacity:
            capacity = max(needed, capacity + _ROOM, capacity * 5 // 4)
            factor = np.zeros((capacity, capacity))
            factor[: self.size, : self.size] = self.factor
            self._factor = factor
            self._right, self._square_sums = (
                np.concatenate([array, np.zeros(capacity - len(array))]) for array in (self._right, self._square_sums)
            )
            self._reach = np.concatenate([self._reach, np.arange(len(self._reach), capacity) + 1])
        self.size = needed

    def determined(self) -> BoolArray:
        """Return which unknowns (n,) are determined if the others are held."""
        return np.asarray(np.diagonal(self.factor) != 0.0)

    @property
    def rank(self) -> int:
        """Return the number of unknowns that the equations determine."""
        return int(np.count_nonzero(self.determined()))

    @property
    def is_regular(self) -> bool:
        """Return whether the equations determine all unknowns that they touch."""
        return bool((self.determined() | (self._square_sums[: self.size] <= 0.0)).all())

    def update(self, equations: ReducedRows) -> FloatArray:
        """Take equations in, one after the other.

        Returns
        -------
        array (k,)
            What is left of each right-hand side: without sign it is Baarda's w of that equation with sigma0 = 1, as it
            is with the equation as the last one; 0 for one that only determines an unknown.
        """
        if not self._is_safe(equations.columns):
            return np.array([self._rotate_carefully(equations, row) for row in range(len(equations.right))])
        if len(equations.right) == 1:
            return self._rotate_in(equations)
        # one after the other they leave the innovations divided by the triangle of their cofactors
        p, _ = self.whitened(equations.columns, equations.rows)
        factor = np.linalg.cholesky(np.eye(len(equations.right)) + p.T @ p)
        left = np.linalg.solve(factor, equations.right - p.T @ self.right)
        self._rotate_in(equations)
        return np.asarray(left)

    def update_at_once(self, equations: ReducedRows) -> None:
        """Take equations in together: quicker than one after the other, without their leftovers."""
        if self._is_safe(equations.columns):
            self._rotate_in(equations)
        else:
            self.update(equations)

    def downdate(self, equations: ReducedRows, least_redundancy: float) -> bool:
        """Take equations out that are in: the same rows, and right-hand sides from the same origin.

        Returns
        -------
        bool
            False if one of them has a redundancy number below the least; then others may be out already, and R has to
            be built from all equations that remain.
        """
        columns, rows, right = equations
        return all(
            self._take_out(ReducedRows(columns, rows[few], right[few]), least_redundancy)
            for few in (slice(start, start + _TOGETHER) for start in range(0, len(right), _TOGETHER))
        )

    def build(self, equations: Sequence[ReducedRows]) -> None:
        """Build the triangle of all equations, in place of those that were in.

        The rows are factored from panel to panel: those that begin in a panel, with what is left of the ones before.
        """
        beginning: dict[int, list[ReducedRows]] = {}
        for rows in equations:
            beginning.setdefault(int(rows.columns[0]) // _PANEL if len(rows.columns) else 0, []).append(rows)
        self._factor[:], self._right[:], self._square_sums[:] = 0.0, 0.0, 0.0
        self._reach = np.arange(len(self._reach), dtype=np.int64) + 1
        left = np.zeros((0, 1))
        for first in range(0, self.size, _PANEL):
            left = self._build_panel(first, beginning.get(first // _PANEL, []), left)
        self.residual_square_sum = float(np.square(left[:, -1]).sum())
        self.rounding = 0.0

    def _build_panel(self, first: int, rows: Sequence[ReducedRows], left: FloatArray) -> FloatArray:
        """Factor the equations that begin in a panel with what is left of those above it; return what is left."""
        last = min(first + _PANEL, self.size)
        end = max([last, first + left.shape[1] - 1, *(int(some.columns[-1]) + 1 for some in rows if len(some.columns))])
        stacked = np.zeros((len(left) + sum(len(some.right) for some in rows), end - first + 1))
        stacked[: len(left), : left.shape[1] - 1], stacked[: len(left), -1] = left[:, :-1], left[:, -1]
        start = len(left)
        for some in rows:
            part = slice(start, start + len(some.right))
            stacked[part, some.columns - first], stacked[part, -1] = some.rows, some.right
            self._square_sums[some.columns] += np.square(some.rows).sum(axis=0)
            start = part.stop
        # a column without equations would keep a row of others as its own
        columns = first + np.flatnonzero(stacked[:, :-1].any(axis=0))
        factor = np.asarray(np.linalg.qr(stacked[:, np.append(columns - first, -1)], mode="r"))
        count = int(np.searchsorted(columns, last))
        factor, columns, rank = self._with_dependent_columns_last(factor, columns, count)
        own = factor[:rank]
        self._factor[np.ix_(columns[:rank], columns)] = own[:, :-1]
        self._factor[first:last, first:last] = np.triu(self._factor[first:last, first:last])
        self._right[columns[:rank]] = own[:, -1]
        self._reach[first:last] = end
        left = np.zeros((len(factor) - rank, end - last + 1))
        left[:, columns[count:] - last], left[:, -1] = factor[rank:, count:-1], factor[rank:, -1]
        return left

    def _with_dependent_columns_last(
        self, factor: FloatArray, columns: IntArray, count: int
    ) -> tuple[FloatArray, IntArray, int]:
        """Return a factor whose first columns do not depend on each other, its columns (c,), and how many these are.

        A column of the panel, the first `count` ones, that depends on those before it goes to the panel's end as soon
        as it is met, and what is left is factored again: a reflection made of rounding would take a direction from the
        columns after it, which might seem to depend on others then, and a row from the columns beyond.
        """
        rank = 0
        while rank < min(count, len(factor)):
            if abs(factor[rank, rank]) > _ZERO_PIVOT * np.sqrt(self._square_sums[columns[rank]]):
                rank += 1
                continue
            count -= 1
            order = np.r_[:rank, rank + 1 : count + 1, rank, count + 1 : len(columns)]
            columns = columns[order]
            factor = factor[:, np.append(order, -1)]
            factor[rank:, rank:] = np.linalg.qr(factor[rank:, rank:], mode="r")
        return factor, columns, rank

    def saved(self, first: int) -> Replaced:
        """Return what a change of equations whose first unknown is `first` replaces, to undo it."""
        panels = [
            (
                panel,
                self._factor[panel.first : panel.last, panel.first : panel.end].copy(),
                self._right[panel.first : panel.last].copy(),
            )
            for panel in self._panels(first)
        ]
        start = panels[0][0].first if panels else self.size
        return Replaced(
            start, panels, self._reach[start:].copy(), self._square_sums.copy(), self.residual_square_sum, self.rounding
        )

    def restore(self, replaced: Replaced) -> None:
        """Undo a change since `saved`."""
        for panel, rows, right in replaced.panels:
            self._factor[panel.first : panel.last, panel.first : self.size] = 0.0
            self._factor[panel.first : panel.last, panel.first : panel.end] = rows
            self._right[panel.first : panel.last] = right
        self._reach[replaced.first :] = replaced.reach
        self._square_sums[:] = replaced.square_sums
        self.residual_square_sum, self.rounding = replaced.residual_square_sum, replaced.rounding

    def solution(self) -> FloatArray:
        """Return the solution (n,), with 0 for unknowns that nothing determines."""
        found = np.zeros(self.size)
        for panel in reversed(list(self._panels(0))):
            own, beyond = slice(panel.first, panel.last), slice(panel.last, panel.end)
            right = self._right[own] - self._factor[own, beyond] @ found[beyond]
            found[own] = dtrtrs(pivotal(self._factor[own, own]), right)[0]
        return found

    def whitened(self, columns: IntArray, rows: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return R^-T a^T (n, k) of rows a (k, c), and which rows (k,) touch something that nothing determines.

        Unknowns that nothing determines are held.
        """
        full = np.zeros((self.size, len(rows)))
        full[columns] = rows.T
        found = self._forward(full)
        held = ~self.determined()
        is_open = (np.abs(found[held]) > _ZERO_PIVOT * np.abs(rows).max(axis=1, initial=0.0)).any(axis=0)
        found[held] = 0.0
        return found, np.asarray(is_open)

    def cofactors(self) -> FloatArray:
        """Return N^-1 = (R^T R)^-1 (n, n) for the unknowns that a row of R has in common; elsewhere it is zero.

        Unknowns that nothing determines are held.
        """
        return cofactors_in_band(self._factor, list(self._panels(0)), self.determined())

    def _forward(self, right: FloatArray) -> FloatArray:
        """Return R^-T b (n, k) of b (n, k), which is overwritten."""
        touched = np.flatnonzero(right.any(axis=1))
        found = np.zeros_like(right)
        for panel in self._panels(int(touched[0])) if len(touched) else ():
            own, beyond = slice(panel.first, panel.last), slice(panel.last, panel.end)
            found[own] = dtrtrs(pivotal(self._factor[own, own]), right[own], trans=1)[0]
            right[beyond] -= self._factor[own, beyond].T @ found[own]
        return found

    def _panels(self, first: int) -> Iterator[Panel]:
        """Yield panels of rows from a first one on."""
        starts = np.arange(first - first % _PANEL, self.size, _PANEL)
        if len(starts):
            # a row reaches its own end at least
            ends = np.maximum.reduceat(self._reach[: self.size], starts)
            lasts = np.minimum(starts + _PANEL, self.size)
            yield from map(Panel, starts.tolist(), lasts.tolist(), np.maximum(lasts, ends).tolist())

    def _is_safe(self, columns: IntArray) -> bool:
        """Return whether no pivot is zero that equations in some columns could meet."""
        return self.is_regular and bool(self.determined()[columns].all())

    def _rotate_carefully(self, equations: ReducedRows, row: int) -> float:
        """Rotate an equation into R by Givens rotations, where pivots may be zero; return what is left of l.

        What is left of a column that depends on others is rounding, and must not be taken for a pivot.
        """
        new = np.zeros(self.size)
        new[equations.columns] = equations.rows[row]
        left = float(equations.right[row])
        self._square_sums[equations.columns] += np.square(equations.rows[row])
        touched = np.flatnonzero(new)
        end = int(touched.max(initial=-1)) + 1
        for place in range(int(touched.min(initial=self.size)), self.size):
            own, value = self._factor[place], float(new[place])
            pivot = float(own[place])
            if value == 0.0 or (pivot == 0.0 and abs(value) <= _ZERO_PIVOT * np.sqrt(self._square_sums[place])):
                continue
            length = float(np.hypot(pivot, value))
            cosine, sine = pivot / length, value / length
            self._reach[place] = end = max(end, int(self._reach[place]))
            across = slice(place, end)
            own[across], new[across] = (
                cosine * own[across] + sine * new[across],
                cosine * new[across] - sine * own[across],
            )
            before = float(self._right[place])
            self._right[place], left = cosine * before + sine * left, cosine * left - sine * before
            if pivot == 0.0:
                left, new[:] = 0.0, 0.0
                break
        self.residual_square_sum += left**2
        return left

    def _rotate_in(self, equations: ReducedRows) -> FloatArray:
        """Rotate equations into R together and return what is left of their right-hand sides."""
        columns, right = equations.columns, equations.right[:, None]
        new = np.zeros((len(right), self.size))
        new[:, columns] = equations.rows
        touched = np.flatnonzero(new.any(axis=0))
        self._square_sums[columns] += np.square(equations.rows).sum(axis=0)
        end = int(touched[-1]) + 1 if len(touched) else 0
        for panel in self._panels(int(touched[0])) if len(touched) else ():
            if panel.first >= end:
                break
            if not new[:, panel.first : panel.last].any():
                continue
            end = max(end, panel.end)
            right = self._reflect(panel, end, new, right)
        self.residual_square_sum += float(np.square(right).sum())
        return np.asarray(right[:, 0])

    def _reflect(self, panel: Panel, end: int, new: FloatArray, right: FloatArray) -> FloatArray:
        """Eliminate the columns of a panel from new rows (k, n), in place; return their right-hand sides (k, 1)."""
        own, beyond = slice(panel.first, panel.last), slice(panel.last, end)
        width = panel.last - panel.first
        block, vectors, scalars, _ = dtpqrt(
            0, width, np.asfortranarray(self._factor[own, own]), np.asfortranarray(new[:, own])
        )
        self._factor[own, own] = np.triu(block)
        # the right-hand side is one more column
        above = np.asfortranarray(np.column_stack([self._factor[own, beyond], self._right[own]]))
        below = np.asfortranarray(np.column_stack([new[:, beyond], right]))
        above, below, _ = dtpmqrt(0, vectors, scalars, above, below, trans="T", overwrite_a=1, overwrite_b=1)
        self._factor[own, beyond], self._right[own] = above[:, :-1], above[:, -1]
        new[:, beyond] = below[:, :-1]
        self._reach[own] = np.maximum(self._reach[own], end)
        return np.asarray(below[:, -1:])

    def _take_out(self, equations: ReducedRows, least_redundancy: float) -> bool:
        """Take k equations out together; False, with nothing changed, if they are not redundant enough.

        With R^T P = A^T the new R is U R, where U^T U = 1 - P P^T. With T_i = 1 - p_1 p_1^T - ... - p_i p_i^T (k, k) of
        the rows of P, row i of U has u_i = sqrt(1 - p_i^T T_(i-1)^-1 p_i) on the diagonal and -p_i^T T_(i-1)^-1 p_j /
        u_i beyond. The last T has the redundancy numbers.
        """
        columns = equations.columns
        if not len(columns):
            self.residual_square_sum -= float(equations.right @ equations.right)
            return True
        p, is_open = self.whitened(columns, equations.rows)
        count = len(equations.right)
        left = np.eye(count) - np.cumsum(p[:, :, None] * p[:, None], axis=0)
        if is_open.any() or np.linalg.eigvalsh(left[-1])[0] < least_redundancy:
            return False
        before = np.concatenate([np.eye(count)[None], left[:-1]])
        gain = np.linalg.solve(before, p[:, :, None])[:, :, 0]
        residual = equations.right - p.T @ self.right
        rest = np.zeros((count, self.size + 1))
        rest[:, columns], rest[:, -1] = equations.rows, equations.right
        for panel in self._panels(int(columns[0])):
            self._scale_down(panel, p, gain, rest)
        self._square_sums[columns] -= np.square(equations.rows).sum(axis=0)
        cofactor = np.linalg.inv(left[-1])
        self.residual_square_sum = max(self.residual_square_sum - float(residual @ cofactor @ residual), 0.0)
        self.rounding += float(np.trace(cofactor))
        return True

    def _scale_down(self, panel: Panel, p: FloatArray, gain: FloatArray, rest: FloatArray) -> None:
        """Multiply a panel by its rows of U; `rest` (k, n + 1) are the rows less what the panels above have of them."""
        own, across = slice(panel.first, panel.last), slice(panel.first, self.size)
        mine, gains = p[own], gain[own]
        if not mine.any():
            return
        end = max(panel.end, int(np.flatnonzero(rest[:, across].any(axis=0)).max(initial=0)) + panel.first + 1)
        self._reach[own] = np.maximum(self._reach[own], end)
        scale = np.sqrt(1.0 - np.einsum("ik,ik->i", mine, gains))
        products, beyond = (gains @ mine.T) / scale[:, None], slice(panel.last, end)
        # what rows below have of the columns of this panel is in its own rows; of those beyond in the rest, too
        inner, outer, right = self._factor[own, own], self._factor[own, beyond], self._right[own]
        within, factors = np.diag(scale) - np.triu(products, 1), np.diag(scale) + np.tril(products)
        gains = gains / scale[:, None]
        changed, changed_right = factors @ outer - gains @ rest[:, beyond], factors @ right - gains @ rest[:, -1]
        rest[:, beyond] -= mine.T @ outer
        rest[:, -1] -= mine.T @ right
        rest[:, own] = 0.0
        self._factor[own, own], self._factor[own, beyond], self._right[own] = within @ inner, changed, changed_right
