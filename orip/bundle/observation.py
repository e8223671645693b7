"""What every kind of observation gives the bundle adjustment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from orip.bundle.state import State

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Rows:
    """The observation equations of one kind, apart from their values.

    Parameters
    ----------
    kind : str
        As in residuals.csv.
    photo, point, component : tuples of str, length n
        What the user calls the observation.
    observed : array (n,)
        In the observation's own unit: mm, ground unit, radians.
    error : array (n,)
        A-priori error in the same unit, greater than zero.
    used : array (n,) of bool
        False: disregarded, the residual is listed only.
    columns : array (n, k) of int
        Unknowns that each equation touches; `CONSTANT` where there is none.
    """

    kind: str
    photo: tuple[str, ...]
    point: tuple[str, ...]
    component: tuple[str, ...]
    observed: FloatArray
    error: FloatArray
    used: BoolArray
    columns: IntArray


class Linearisation(NamedTuple):
    """Residuals (n,), computed minus observed, their partials (n, k), and which rows can be computed (n,)."""

    residual: FloatArray
    partials: FloatArray
    computable: BoolArray


class Observations(Protocol):
    """All observations of one kind in a block."""

    @property
    def rows(self) -> Rows:
        """Return what does not change while iterating."""

    def linearise_with_partials(self, state: State) -> Linearisation:
        """Return residuals and partials at a state, in the rows' units per unit of the unknowns."""
