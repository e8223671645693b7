"""Normal equations: formed from the observation equations, points eliminated, solved."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.equations import Equations, Layout
from orip.adjustment.factorisation.band import BandMatrix
from orip.adjustment.factorisation.band_cholesky import BandFactor, factorise_band
from orip.adjustment.factorisation.cholesky import (
    DissectedFactor,
    ExactConstraints,
    Factor,
    Symmetric,
    add_to_diagonal,
    exact_constraints,
    factorise,
    factorise_dissected,
    scale_matrix,
)
from orip.adjustment.factorisation.elimination import BlockFactors, Coupling, times_half, times_transposed_half
from orip.adjustment.factorisation.fronts import DissectedMatrix
from orip.adjustment.factorisation.null_space import Amounts, InnerConstraints
from orip.arrays import FloatArray, IntArray
from orip.set_aside import set_aside
from orip.structs import replace

_AT_ONCE = 32
"""Unit vectors that are solved for together."""


class SolvedNormals(Struct, frozen=True):
    """The factored normal equations and their solution.

    Parameters
    ----------
    correction : array (m + 3 b,)
        Zero for fixed and removed unknowns.
    reduced_square_sum : float
        dx^T N dx.
    scale : array (m,)
        Root of the complete diagonal of the reduced unknowns; 1 where it is zero.
    factor : Factor, BandFactor or DissectedFactor
        Of the reduced system divided by `scale` on both sides.
    blocks : BlockFactors
    coupling : Coupling
    removed : array (m + 3 b,) of bool
        Unknowns that the observations do not determine.
    lost_before : array (m + 3 b,) or None
        Digits lost by the unknowns that were removed before, and are held here; NaN for all others.
    constraints : ExactConstraints or None
        Those that bind the cofactors; None: there are none, or they have their finite weights.
    """

    correction: FloatArray
    reduced_square_sum: float
    scale: FloatArray
    factor: Factor | BandFactor | DissectedFactor
    blocks: BlockFactors
    coupling: Coupling
    removed: NDArray[np.bool_]
    lost_before: FloatArray | None = None
    constraints: ExactConstraints | None = None

    @property
    def lost_digits(self) -> FloatArray:
        """Return the digits (m + 3 b,) that each unknown lost; computed when they are asked for, mostly of none."""
        found = np.concatenate([self.factor.lost_digits, self.blocks.lost_digits.ravel()])
        return found if self.lost_before is None else np.where(np.isnan(self.lost_before), found, self.lost_before)

    def solve(self, right: FloatArray) -> FloatArray:
        """Return N^-1 right for right-hand sides (m + 3 b, k); zero for fixed and removed unknowns.

        With `constraints` it is Q_c right, with the cofactors of the bound unknowns.
        """
        size = len(self.scale)
        block_right = times_half(self.blocks.half, right[size:])
        solution = self._reduced_solution(right[:size] - self.coupling.transposed_times(block_right))
        rest = block_right - self.coupling.times(solution)
        found = np.vstack([solution, times_transposed_half(self.blocks.half, rest)])
        return found if self.constraints is None else self.constraints.bound(found, right)

    def solve_at(self, columns: IntArray, right: FloatArray) -> FloatArray:
        """Return rows (c, k) of what `solve` returns for right-hand sides that are zero in all other rows.

        No pass over the observations is made: only the coupling of the blocks concerned is computed.

        Parameters
        ----------
        columns : array (c,) of int
            Of unknowns, in ascending order.
        right : array (c, k)
        """
        at = self._at(columns)
        block_right, reduced_right = at.halves(self, right)
        solution = self.factor.back_substitute(reduced_right) / self.scale[:, None]
        rest = times_transposed_half(at.half, block_right - at.coupling @ solution)
        found = np.vstack([solution[at.reduced], rest[at.place]])
        return found if self.constraints is None else self.constraints.at(columns).bound(found, right)

    def inverse_at(self, columns: IntArray) -> FloatArray:
        """Return the inverse (c, c) at some unknowns: `solve_at` of unit vectors, in half the time.

        With N = L L^T it is Z^T Z, where Z = L^-1 times the unit vectors (c,): nothing is substituted back.

        Parameters
        ----------
        columns : array (c,) of int
            Of unknowns, in ascending order.
        """
        units, at = np.eye(len(columns)), self._at(columns)
        # some at a time stay in the processor's cache
        some = (slice(first, first + _AT_ONCE) for first in range(0, len(columns), _AT_ONCE))
        root = np.vstack([np.vstack(at.halves(self, units[:, part])).T for part in some])
        found = np.asarray(root @ root.T)
        return found if self.constraints is None else self.constraints.at(columns).bound(found, units)

    def _at(self, columns: IntArray) -> _Chosen:
        size = len(self.scale)
        of_blocks = columns[columns >= size] - size
        blocks = np.unique(of_blocks // 3)
        place = 3 * np.searchsorted(blocks, of_blocks // 3) + of_blocks % 3
        return _Chosen(columns[columns < size], place, self.blocks.half[blocks], self.coupling.of_blocks(blocks))

    def amounts(self, inner: InnerConstraints) -> Amounts:
        """Return the cofactors of the movements that inner constraints rule out, and of these with the unknowns.

        Q_rt solves the reduced system for B_r - C^T H B_p, summed over the points p, and Q_tt is its product with that,
        and what the points have of their own.
        """
        sums = self.coupling.movement_sums(inner.points)
        right = inner.reduced_defining - sums.reduced
        with_reduced = self._reduced_solution(right)
        own = sums.own + right.T @ with_reduced
        if self.constraints is not None:
            bound = self.constraints.spread.T @ inner.defining_rows()
            with_reduced -= self.constraints.spread[: len(self.scale)] @ (self.constraints.inverse @ bound)
            own -= bound.T @ self.constraints.inverse @ bound
        own, axes = np.linalg.eigh(own)
        return Amounts(inner.reduced @ axes, inner.points.combined(axes), with_reduced @ axes, own)

    def _reduced_solution(self, right: FloatArray) -> FloatArray:
        """Return the solution (m, k) of the reduced system for right-hand sides (m, k)."""
        reduced = self.factor.reduce(right / self.scale[:, None])
        return np.asarray(self.factor.back_substitute(reduced) / self.scale[:, None])

    def with_right_side(self, right: FloatArray) -> SolvedNormals:
        """Return the same with the correction for another right-hand side (m + 3 b,)."""
        size = len(self.scale)
        block_right = times_half(self.blocks.half, right[size:])
        reduced_right = self.factor.reduce((right[:size] - self.coupling.transposed_times(block_right)) / self.scale)
        solution = self.factor.back_substitute(reduced_right) / self.scale
        rest = block_right - self.coupling.times(solution)
        return replace(
            self,
            correction=set_aside(np.concatenate([solution, times_transposed_half(self.blocks.half, rest)])),
            reduced_square_sum=float(reduced_right @ reduced_right + block_right @ block_right),
        )

    def with_constraints(self, equations: Equations) -> SolvedNormals:
        """Return the same with the exact constraints of the equations bound."""
        rows = np.flatnonzero(equations.exact & equations.active)
        if not len(rows):
            return self
        design = equations.rows.some(rows).toarray()
        return replace(self, constraints=exact_constraints(design, self.solve(design.T)))


class _Chosen(NamedTuple):
    """Some unknowns: the reduced ones, and the places of others among the coordinates of their c blocks."""

    reduced: IntArray
    place: IntArray
    half: FloatArray
    coupling: csr_array

    def halves(self, normals: SolvedNormals, right: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return L^-1 of right-hand sides that are zero in all other rows: that of the blocks, and of the rest."""
        reduced, own = np.zeros((len(normals.scale), right.shape[1])), np.zeros((3 * len(self.half), right.shape[1]))
        reduced[self.reduced], own[self.place] = right[: len(self.reduced)], right[len(self.reduced) :]
        of_blocks = times_half(self.half, own)
        reduced = (reduced - self.coupling.T @ of_blocks) / normals.scale[:, None]
        return of_blocks, normals.factor.reduce(reduced)


def solve_normals(
    equations: Equations, weight_factors: FloatArray, layout: Layout, max_lost_digits: float, damping: float = 0.0
) -> SolvedNormals:
    """Form, reduce and solve the normal equations of one iteration.

    Parameters
    ----------
    weight_factors : array (n,)
        Inactive observations get no weight whatever stands here.
    damping : float
        The diagonal is multiplied by 1 + damping.
    """
    weights = equations.effective(weight_factors)
    normals = equations.rows.eliminated(weights, equations.residual, layout, max_lost_digits, damping)
    held = layout.fixed[: layout.reduced]
    diagonal = np.where(held, 0.0, normals.diagonal)
    scale = np.where(diagonal > 0.0, np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 1.0)
    scale_matrix(normals.matrix, 1.0 / scale)
    if damping:
        add_to_diagonal(normals.matrix, damping)
    factor = _factorised(normals.matrix, max_lost_digits, diagonal <= 0.0, layout.calibration)
    reduced_right = factor.reduce(normals.right / scale)
    solution = factor.back_substitute(reduced_right) / scale
    rest = normals.block_right - normals.coupling.times(solution)
    return SolvedNormals(
        correction=set_aside(np.concatenate([solution, times_transposed_half(normals.blocks.half, rest)])),
        reduced_square_sum=float(reduced_right @ reduced_right + normals.block_right @ normals.block_right),
        scale=scale,
        factor=factor,
        blocks=normals.blocks,
        coupling=normals.coupling,
        removed=np.concatenate([factor.removed & ~held, normals.blocks.removed.ravel()]),
    )


def _factorised(
    matrix: Symmetric, max_lost_digits: float, undetermined: NDArray[np.bool_], first: int
) -> Factor | BandFactor | DissectedFactor:
    """Return the factor of a matrix, which is used up."""
    if isinstance(matrix, DissectedMatrix):
        return factorise_dissected(matrix, max_lost_digits, undetermined, first)
    if isinstance(matrix, BandMatrix):
        return factorise_band(matrix, max_lost_digits, undetermined, first)
    return factorise(matrix, max_lost_digits, undetermined, first)
