"""Observation equations in the form that the adjustment works with, and what it asks of a problem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

State = TypeVar("State")


@dataclass(frozen=True, slots=True)
class Layout:
    """How the unknowns are ordered: `reduced` ones first, then `blocks` points of three that are eliminated.

    Parameters
    ----------
    reduced : int
        Number m of unknowns that stay in the reduced system.
    blocks : int
        Number b of blocks of three; an observation touches one of them at most.
    fixed : array (m + 3 b,) of bool
        Places that are not unknowns (constant coordinates of a block).
    """

    reduced: int
    blocks: int
    fixed: BoolArray

    @property
    def size(self) -> int:
        """Return m + 3 b."""
        return self.reduced + 3 * self.blocks

    @property
    def unknowns(self) -> int:
        """Return the number of unknowns u, removed ones included."""
        return self.size - int(np.count_nonzero(self.fixed))


@dataclass(frozen=True, slots=True)
class Equations:
    """n linearised observation equations, divided by their a-priori errors.

    Parameters
    ----------
    design : sparse array (n, m + 3 b)
        Partials of the computed observation by the unknowns, divided by the a-priori error. Its rows have the same
        pattern at every linearisation.
    residual : array (n,)
        Computed minus observed, divided by the a-priori error.
    active : array (n,) of bool
        False: a disregarded observation, or one that cannot be computed at this linearisation.
    exact : array (n,) of bool
        A constant that is met exactly: full weight always, a part of the redundancy, no part of sigma0.
    """

    design: csr_array
    residual: FloatArray
    active: BoolArray
    exact: BoolArray


class Problem(Protocol[State]):
    """What can be adjusted: it has a layout, and can be linearised at a state and moved by a correction."""

    @property
    def layout(self) -> Layout:
        """Return the order of the unknowns."""

    def linearise(self, state: State) -> Equations:
        """Return the observation equations at a state."""

    def update(self, state: State, correction: FloatArray) -> State:
        """Return the state moved by a correction of all unknowns, array (m + 3 b,)."""

    def step_factor(self, correction: FloatArray) -> float:
        """Return the factor (at most 1) that keeps a correction where the linearisation means something."""

    def reconsidered(self, state: State, equations: Equations, limit: float) -> State | None:
        """Return a state in which more observations fit than where weights were reduced in the course of things.

        `limit` is the standard residual up to which an observation fits. None: there is none.
        """


@dataclass(frozen=True, slots=True)
class Linearised(Generic[State]):
    """A state with its observation equations."""

    state: State
    equations: Equations
