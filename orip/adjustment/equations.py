"""Observation equations in the form that the adjustment works with, and what it asks of a problem."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array

from orip.adjustment.factorisation.band import Arrangement
from orip.adjustment.factorisation.cholesky import Symmetric
from orip.adjustment.factorisation.elimination import BlockFactors, Coupling, EliminatedNormals
from orip.adjustment.factorisation.null_space import Amounts
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.structs import replace

StateT = TypeVar("StateT")


class Layout(Struct, frozen=True):
    """How the unknowns are ordered: `reduced` ones first, then `blocks` points of three that are eliminated.

    Parameters
    ----------
    reduced : int
        Number m of unknowns that stay in the reduced system.
    blocks : int
        Number b of blocks of three; an observation touches one of them at most.
    fixed : array (m + 3 b,) of bool
        Places that are not unknowns (constant coordinates of a block).
    arrangement : Arrangement or None
        That of the reduced system as a band; None: it is a full matrix.
    calibration : int
        Number of leading unknowns of which one is removed, rather than another, where nothing tells them apart.
    """

    reduced: int
    blocks: int
    fixed: BoolArray
    arrangement: Arrangement | None = None
    calibration: int = 0

    @property
    def size(self) -> int:
        """Return m + 3 b."""
        return self.reduced + 3 * self.blocks

    @property
    def unknowns(self) -> int:
        """Return the number of unknowns u, removed ones included."""
        return self.size - int(np.count_nonzero(self.fixed))


class BlockPrecision(NamedTuple):
    """Cofactors (b, 3, 3) of the eliminated blocks and leverages (n,) of all observations, for sigma0 = 1."""

    blocks: FloatArray
    leverage: FloatArray


class BlockNormals(NamedTuple):
    """Normal equations of b blocks, each by itself, with the reduced unknowns held.

    Attributes
    ----------
    matrices : array (b, 3, 3)
    right : array (3 b,)
    square_sums : array (b,)
        Of the misclosures of the rows that touch a block.
    """

    matrices: FloatArray
    right: FloatArray
    square_sums: FloatArray


class DesignMatrix(Protocol):
    """The design matrix: partials of n computed observations, divided by their a-priori errors.

    It need not be stored: the adjustment asks for normal equations and leverages.
    """

    def matrix(self) -> csr_array:
        """Return the design matrix (n, m + 3 b). Its rows have the same pattern at every linearisation."""

    def some(self, chosen: IntArray) -> csr_array:
        """Return some rows (k, m + 3 b) of the design matrix."""

    def eliminated(
        self, weights: FloatArray, residual: FloatArray, layout: Layout, max_lost_digits: float, damping: float
    ) -> EliminatedNormals:
        """Return the weighted normal equations of the rows with their blocks eliminated.

        Parameters
        ----------
        weights : array (n,)
            Zero for observations that take no part.
        residual : array (n,)
        damping : float
            The diagonals of the blocks are multiplied by 1 + damping; that of the reduced system is left to the caller.
        """

    def block_normals(self, root_weights: FloatArray, misclosure: FloatArray, layout: Layout) -> BlockNormals:
        """Return the normal equations of the blocks alone, of rows times `root_weights` (n,), and `misclosure` (n,)."""

    def right_side(self, root_weights: FloatArray, misclosure: FloatArray, layout: Layout) -> FloatArray:
        """Return the right-hand side (m + 3 b,) of the normal equations, of rows times `root_weights` (n,).

        `misclosure` (n,) are those of the weighted rows; zero for observations that take no part.
        """

    def precision(
        self, factors: BlockFactors, coupling: Coupling, inverse: Symmetric, amounts: Amounts | None
    ) -> BlockPrecision:
        """Return cofactors of the blocks and leverages from the inverse (m, m) of the reduced system.

        The cofactors are those with the inner constraints, if there are any: `amounts` are those of their movements.
        """


class Equations(Struct, frozen=True):
    """n linearised observation equations, divided by their a-priori errors.

    Parameters
    ----------
    rows : DesignMatrix
    residual : array (n,)
        Computed minus observed, divided by the a-priori error.
    active : array (n,) of bool
        False: a disregarded observation, or one that cannot be computed at this linearisation.
    exact : array (n,) of bool
        Exact constraints: always full weight, counted in the redundancy, not in sigma0.
    groups : array (n,) of int, or None
        Number of the group of observations that lose weight together, by the length of their residuals; -1 for those
        that do so by themselves. None: all do.
    wider_groups : callable
        Returns the groups where many observations do not fit: what was measured as one is wrong as a whole then.
    """

    rows: DesignMatrix
    residual: FloatArray
    active: BoolArray
    exact: BoolArray
    groups: IntArray | None = None
    wider_groups: Callable[[], IntArray | None] = lambda: None

    @property
    def has_exact_constraints(self) -> bool:
        """Return whether equations are shifted after each iteration: corrections then depend on more than the state."""
        return bool((self.active & self.exact).any())

    def with_wider_groups(self) -> Equations:
        """Return the equations with the groups for many observations that do not fit."""
        return replace(self, groups=self.wider_groups())

    def effective(self, weights: FloatArray) -> FloatArray:
        """Return weight factors (n,) with those of inactive observations 0."""
        return weights if self.active.all() else np.where(self.active, weights, 0.0)

    def sizes(self, residual: FloatArray, among: BoolArray) -> FloatArray:
        """Return by what size (n,) each of the residuals (n,) is judged: that of its group, those `among` them."""
        size = np.abs(residual)
        if self.groups is None:
            return size
        rows = np.flatnonzero(among & (self.groups >= 0))
        if not len(rows):
            return size
        square_sums = np.bincount(self.groups[rows], size[rows] ** 2)
        size[rows] = np.sqrt(square_sums[self.groups[rows]])
        return size

    def shares(self, among: BoolArray) -> FloatArray:
        """Return the part (n,) that each observation has in its group: 1 by itself."""
        share = np.ones(len(self.residual))
        if self.groups is not None:
            rows = np.flatnonzero(among & (self.groups >= 0))
            share[rows] = 1.0 / np.bincount(self.groups[rows])[self.groups[rows]]
        return share

    @property
    def design(self) -> csr_array:
        """Return the design matrix (n, m + 3 b); it may have to be computed."""
        return self.rows.matrix()


class OtherPlace(NamedTuple):
    """Another place of a block, where others of its observations fit.

    Attributes
    ----------
    columns : array (3,) of int
        Its unknowns among all.
    move : array (3,)
        Their change.
    rows : array (k,) of int
        Its observations.
    weights : array (k,)
        Their weight factors there: 1, or least.
    reduced : array (k, m)
        Partials by the reduced unknowns at that place.
    own : array (k, 3)
        By the block's.
    residual : array (k,)
        At that place, divided by the a-priori errors.
    """

    columns: IntArray
    move: FloatArray
    rows: IntArray
    weights: FloatArray
    reduced: FloatArray
    own: FloatArray
    residual: FloatArray


class Problem(Protocol[StateT]):
    """What can be adjusted: a layout of the unknowns, linearisation at a state, and states after a correction."""

    @property
    def layout(self) -> Layout:
        """Return the order of the unknowns."""

    def linearise(self, state: StateT) -> Equations:
        """Return the observation equations at a state."""

    def update(self, state: StateT, correction: FloatArray) -> StateT:
        """Return the state moved by a correction of all unknowns, array (m + 3 b,)."""

    def step_factor(self, correction: FloatArray) -> float:
        """Return the factor (at most 1) that keeps a correction within the range of the linearisation."""

    def with_blocks_recomputed(self, state: StateT) -> StateT:
        """Return the state with its blocks computed from the rest of it, where that is possible."""

    def with_blocks_moved(self, state: StateT, correction: FloatArray) -> StateT:
        """Return the state with its blocks moved along their corrections, array (3 b,), or part of the way."""

    def without_undetermined_blocks(self, state: StateT, factors: BlockFactors, scale: float) -> StateT | None:
        """Return the state with the blocks that nothing determines left out; None if there are none.

        `factors` are those of the normal equations at the state, `scale` that of the observations in a-priori errors.
        """

    def without_contradictory_blocks(
        self, state: StateT, factors: BlockFactors, scale: float, weights: FloatArray
    ) -> StateT | None:
        """Return the state without blocks that the observations that fit do not determine; None if there are none.

        Blocks that fewer than two observations with some weight, of the weights (n,), are left with go as well.
        """

    def with_all_blocks(self, state: StateT) -> StateT:
        """Return the state with the blocks that were left out, computed from their observations; itself if none are."""

    def with_doubtful_blocks_placed(self, state: StateT, equations: Equations, limit: float) -> StateT:
        """Return the state with blocks that do not fit placed by their observations alone, wherever they were."""

    def moves_to_steady_weights(self, state: StateT, equations: Equations, limit: float) -> FloatArray:
        """Return corrections (m + 3 b,) of blocks that do not fit, after which their weights no longer change."""

    def other_places(
        self, state: StateT, equations: Equations, weights: FloatArray, limit: float
    ) -> Sequence[OtherPlace]:
        """Return other places of blocks of which an observation has lost weight (n,), alone or with another one."""

    def rival_places(
        self, state: StateT, equations: Equations, weights: FloatArray, limit: float
    ) -> Sequence[OtherPlace]:
        """Return places of such blocks where as many of their observations agree, nearly, those measured as one."""

    def improve_consensus(self, state: StateT, equations: Equations, limit: float) -> StateT | None:
        """Return the state with blocks moved to where more of their observations fit; None if there are none.

        `limit` is the standard residual up to which an observation fits.
        """


class Linearised(Struct, Generic[StateT], frozen=True):
    """A state with its observation equations."""

    state: StateT
    equations: Equations
