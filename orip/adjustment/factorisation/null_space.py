"""Movements that the observations do not determine, and inner constraints of a free network (Baarda 1973)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.structs import replace

# A movement x has the stiffness x^T N x / x^T x, with N scaled to a unit diagonal. Movements of least stiffness are
# found by subspace iteration with the factor of N (Bauer 1957; Rutishauser 1969), and their stiffness is computed with
# N itself: errors of its factorisation do not count. For each movement below the limit one unknown is removed.

LOST_ALL = 99.0
"""Digits lost by an unknown that no observation touches."""

SHIFT = 1e-13
"""Added to the diagonal of a matrix that has no factor; far below any limit, and above the rounding of its elements."""

_FIRST_GUESSES = 2
_MORE_GUESSES = 8
_STEPS = 4
"""A step magnifies a movement against another one by the ratio of their stiffnesses: mostly by more than 10^5."""

_UNLIKELY_PART = 1e-4
"""Size of a movement's part in a random vector, where 1 is its standard deviation. In both of two random vectors it is
smaller with a probability of 10^-8."""

_LARGE_ENOUGH = 0.2
"""Part of the largest component of a movement; of the unknowns whose component is larger, the last one is removed."""

_ROUNDING = float(np.finfo(np.float64).eps)


class SoftMovements(NamedTuple):
    """Orthonormal movements (m, r) that are not determined, and their stiffnesses (r,)."""

    movements: FloatArray
    stiffness: FloatArray


class RemovedUnknowns(NamedTuple):
    """Unknowns (r,) to be removed, and the digits (r,) that each has lost."""

    columns: IntArray
    lost_digits: FloatArray


def soft_movements(
    product: Callable[[FloatArray], FloatArray],
    solution: Callable[[FloatArray], FloatArray],
    unknowns: IntArray,
    size: int,
    least_stiffness: float,
) -> SoftMovements:
    """Return the movements of a symmetric matrix N whose stiffness is below a limit.

    Parameters
    ----------
    product, solution : callable
        Return N x and N^-1 x (or that of N with a small shift) for x (size, k) that is zero outside `unknowns`.
    unknowns : array (k,) of int
        Places that take part.
    size : int
        m.
    """
    guesses = min(_FIRST_GUESSES, len(unknowns))
    random = np.random.default_rng(len(unknowns))
    while guesses:
        moved = np.zeros((size, guesses))
        moved[unknowns] = random.normal(size=(len(unknowns), guesses))
        moved, combination = solution(moved), np.eye(guesses)
        for step in range(1, _STEPS):
            if _are_stiff(moved @ combination, step, least_stiffness):
                return SoftMovements(np.zeros((size, 0)), np.zeros(0))
            moved, triangle = np.linalg.qr(moved)
            moved, combination = solution(moved), triangle @ combination
        moved, _ = np.linalg.qr(moved)
        stiffness, turn = np.linalg.eigh(moved.T @ product(moved))
        soft = stiffness < least_stiffness
        if not soft.all() or guesses == len(unknowns):
            return SoftMovements(moved @ turn[:, soft], stiffness[soft])
        guesses = min(_MORE_GUESSES * guesses, len(unknowns))
    return SoftMovements(np.zeros((size, 0)), np.zeros(0))


def _are_stiff(moved: FloatArray, steps: int, least_stiffness: float) -> bool:
    """Return whether no movement is softer than a limit, from N^-s x (m, k) of k vectors x of normal random numbers.

    The part x^T v of a movement v with the stiffness c, normal with variance 1, makes N^-s x at least |x^T v| / c^s
    long.
    """
    lengths = np.linalg.norm(moved, axis=0)
    return len(lengths) > 1 and bool(lengths.max() * least_stiffness**steps < _UNLIKELY_PART)


def unknowns_to_remove(found: SoftMovements, first: int = 0) -> RemovedUnknowns:
    """Return one unknown for each movement: without them no combination of the movements is possible.

    Of the unknowns that have a large part in what is still possible the last one is taken, or the last of the `first`
    ones if any of these has, so that the same unknowns are named whatever the order of elimination is, and in every
    iteration. The digits lost by an unknown are -log10 of the stiffness of the movement in which it takes part and no
    other removed one does.
    """
    rest, chosen = found.movements.copy(), []
    for _ in range(rest.shape[1]):
        sizes = np.linalg.norm(rest, axis=1)
        large = np.flatnonzero(sizes >= _LARGE_ENOUGH * sizes.max())
        leading = large[large < first]
        column = int(leading[-1] if len(leading) else large[-1])
        direction = rest[column] / sizes[column]
        rest -= np.outer(rest @ direction, direction)
        chosen.append(column)
    columns = np.array(chosen, dtype=np.int64)
    parts = np.linalg.solve(found.movements[columns], np.eye(len(columns)))
    stiffness = (parts**2 * found.stiffness[:, None]).sum(axis=0) / (parts**2).sum(axis=0)
    # a stiffness that is nothing but rounding cannot have lost more digits than a number has
    return RemovedUnknowns(columns, -np.log10(np.maximum(stiffness, _ROUNDING)))


class _Factor(Protocol):
    """The factor of a symmetric matrix; what it returns is zero for the columns that are removed."""

    def reduce(self, vectors: FloatArray, /) -> FloatArray: ...

    def back_substitute(self, vectors: FloatArray, /) -> FloatArray: ...


F = TypeVar("F", bound=_Factor)


def factor_of_determined(
    factored: Callable[[BoolArray, FloatArray, float], F | None],
    product: Callable[[FloatArray], FloatArray],
    is_finite: Callable[[], bool],
    undetermined: BoolArray,
    max_lost_digits: float,
    first: int,
) -> F:
    """Return the factor of a symmetric positive semidefinite matrix N without the columns that are not determined.

    Parameters
    ----------
    factored : callable
        Returns the factor without the columns (m,) that are removed, which have lost so many digits (m,), and with the
        diagonal enlarged by a number; None if there is none.
    product : callable
        Returns N x for x (m, k).
    is_finite : callable
        Returns whether all elements of N are finite; if not, all columns are removed.
    undetermined : array (m,) of bool
        Columns known to have no observation at all; they are removed at once.
    max_lost_digits : float
        A movement whose stiffness has lost more is not determined; a column is removed for it.
    first : int
        See `unknowns_to_remove`.
    """
    removed, lost = undetermined.copy(), np.where(undetermined, LOST_ALL, 0.0)
    factor = factored(removed, lost, 0.0)
    if factor is None and not is_finite():
        removed[:], lost[:] = True, LOST_ALL
        factor = factored(removed, lost, 0.0)
    while True:
        soft = _undetermined(factor, partial(factored, removed, lost), product, ~removed, 10.0**-max_lost_digits)
        found = unknowns_to_remove(soft, first)
        if factor is not None and not len(found.columns):
            return factor
        removed[found.columns] = True
        lost[found.columns] = found.lost_digits
        factor = factored(removed, lost, 0.0)


def _undetermined(
    factor: F | None,
    shifted: Callable[[float], F | None],
    product: Callable[[FloatArray], FloatArray],
    taking_part: BoolArray,
    least: float,
) -> SoftMovements:
    """Return the movements for which further columns are removed; where there is no factor, at least one."""
    shift = SHIFT
    singular = factor is None
    while factor is None:
        factor = shifted(shift)
        shift *= 10.0
    solver = factor
    while True:
        found = soft_movements(
            lambda x: taking_part[:, None] * product(x),
            lambda x: solver.back_substitute(solver.reduce(x)),
            np.flatnonzero(taking_part),
            len(taking_part),
            least,
        )
        if len(found.stiffness) or not singular:
            return found
        least *= 10.0


# G (u, d) are the movements of all u unknowns that nothing determines, combined so that B^T G = I; B is G in the rows
# of the coordinates that define the datum, and zero elsewhere. The unknowns x of a solution with any d of them held
# contain the amounts t = B^T x of the movements; x - G t meets the inner constraints. Its cofactors are S Q S^T, S = I
# - G B^T, of which only those elements are formed that are asked for:
#
#     Q - G Z^T - Z G^T,  Z = Q_xt - G Q_tt / 2,  Q_xt = Q B,  Q_tt = B^T Q B
#
# A point p that is eliminated, with the rows H and C = H N_pr of the triangular factor, has Q_pt = H^T (H B_p - C Q_rt)
# with the reduced unknowns r: neither Q B of all points nor another solution is needed. Residuals and leverages of
# observations do not depend on the datum.


class PointMovements(Struct, frozen=True):
    """d movements of b eliminated points: each changes a coordinate by a linear function of homogeneous coordinates.

    Parameters
    ----------
    homogeneous : array (b, 4)
    coefficients : array (3, d, 4)
        Of each coordinate.
    free, defining : arrays (b, 3) of bool
        Which coordinates are unknowns, and which of these define the datum.
    """

    homogeneous: FloatArray
    coefficients: FloatArray
    free: BoolArray
    defining: BoolArray

    def of(self, points: IntArray) -> PointMovements:
        """Return the movements of some points (k,)."""
        return replace(
            self, homogeneous=self.homogeneous[points], free=self.free[points], defining=self.defining[points]
        )

    def combined(self, combinations: FloatArray) -> PointMovements:
        """Return combinations (d, e) of the movements."""
        return replace(self, coefficients=np.einsum("adh,de->aeh", self.coefficients, combinations))

    def rows(self) -> FloatArray:
        """Return the rows (b, 3, d) of G."""
        moved = np.stack([self.homogeneous @ table.T for table in self.coefficients], axis=1)
        return np.asarray(np.where(self.free[:, :, None], moved, 0.0))

    def defining_rows(self) -> FloatArray:
        """Return the rows (b, 3, d) of B."""
        return np.asarray(np.where(self.defining[:, :, None], self.rows(), 0.0))


class InnerConstraints(Struct, frozen=True):
    """G and B of a free network.

    Parameters
    ----------
    reduced, reduced_defining : arrays (m, d)
        Rows of the reduced unknowns in G and B.
    points : PointMovements
    """

    reduced: FloatArray
    reduced_defining: FloatArray
    points: PointMovements

    def defining_rows(self) -> FloatArray:
        """Return B (m + 3 b, d)."""
        d = self.reduced.shape[1]
        return np.vstack([self.reduced_defining, self.points.defining_rows().reshape(-1, d)])


class MovementSums(NamedTuple):
    """What eliminated points contribute to the amounts of d movements.

    Attributes
    ----------
    reduced : array (m, d)
        C^T H B_p.
    own : array (d, d)
        B_p^T H^T H B_p.
    """

    reduced: FloatArray
    own: FloatArray


class Amounts(Struct, frozen=True):
    """Cofactors of the amounts of d movements, combined so that these have no covariances.

    Parameters
    ----------
    reduced : array (m, d)
        Rows of the reduced unknowns in G.
    points : PointMovements
    with_reduced : array (m, d)
        Q_rt.
    own : array (d,)
        The diagonal of Q_tt.
    """

    reduced: FloatArray
    points: PointMovements
    with_reduced: FloatArray
    own: FloatArray

    def of(self, reduced: IntArray, points: IntArray) -> Amounts:
        """Return those with some of the reduced unknowns and of the points."""
        return Amounts(self.reduced[reduced], self.points.of(points), self.with_reduced[reduced], self.own)

    def transform_blocks(self, blocks: FloatArray, half: FloatArray, coupling: csr_array) -> None:
        """Transform cofactors (b, 3, 3) of the points, in place, with H (b, 3, 3) and C (3 b, m)."""
        moved = self.points.rows()
        with_amounts = half @ self.points.defining_rows() - (coupling @ self.with_reduced).reshape(moved.shape)
        z = np.swapaxes(half, 1, 2) @ with_amounts - moved * self.own / 2.0
        product = moved @ np.swapaxes(z, 1, 2)
        blocks -= product
        blocks -= np.swapaxes(product, 1, 2)

    def factors_of_reduced(self) -> tuple[FloatArray, FloatArray]:
        """Return L and R (m, 2 d): the transformed cofactors of the reduced unknowns are Q_rr - L R^T."""
        z = self.with_reduced - self.reduced * self.own / 2.0
        return np.hstack([self.reduced, z]), np.hstack([z, self.reduced])


def movement_sums(points: PointMovements, half: FloatArray, coupling: csr_array) -> MovementSums:
    """Return what points contribute, with H (b, 3, 3) and C (3 b, m)."""
    rows = half @ points.defining_rows()
    flat = rows.reshape(-1, rows.shape[2])
    return MovementSums(np.asarray(coupling.T @ flat), flat.T @ flat)
