"""The interface of a kind of observation: its rows and their linearisation; ground coordinates and exact equations."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.correlated_rows import CorrelatedRows
from orip.bundle.rigs.starting import Chained, chained
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.errors import InputError
from orip.records.block import Block
from orip.records.ground import GroundSystem
from orip.records.observation_kinds import ObservationKind


class Rows(Struct, frozen=True):
    """The observation equations of one kind, without their computed values.

    Parameters
    ----------
    kind : ObservationKind
        Each kind of a block has its own.
    photo, point, component : sequences of str, length n
        What the user calls the observation.
    observed : array (n,)
        In the unit of the files: mm, ground unit, degrees.
    error : array (n,)
        A-priori error in the same unit, greater than zero.
    used : array (n,) of bool
        False: disregarded, the residual is listed only.
    columns : array (n, k) of int, or None
        Unknowns that each equation touches, `CONSTANT` where there is none; None: see `Observations.columns`.
    """

    kind: ObservationKind
    photo: Sequence[str]
    point: Sequence[str]
    component: Sequence[str]
    observed: FloatArray
    error: FloatArray
    used: BoolArray
    columns: IntArray | None


class Linearisation(NamedTuple):
    """Residuals (n,), computed minus observed, their partials (n, k), and which rows can be computed (n,)."""

    residual: FloatArray
    partials: FloatArray
    computable: BoolArray


class Observations(Struct, frozen=True):
    """All observations of one kind in a block.

    Attributes
    ----------
    rows : Rows
        What does not change while iterating.
    exact : bool
        Exact constraints: never down-weighted, and no part of sigma0.
    """

    rows: Rows
    exact: ClassVar[bool] = False

    def columns(self) -> IntArray | NDArray[np.int32]:
        """Return the unknowns (n, k) that each equation touches; `CONSTANT` where there is none."""
        assert self.rows.columns is not None, "a kind that does not keep them computes them"
        return self.rows.columns

    def in_parts(self) -> Iterator[Observations]:
        """Yield the observations some thousands at a time, where there may be millions."""
        yield self

    @abstractmethod
    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals and partials at a state, in the rows' units per unit of the unknowns."""

    def groups(self) -> IntArray | None:
        """Return the numbers of the groups (n,) that lose weight together; -1, or None for all: by themselves."""
        return None

    def as_observed(self, residual: FloatArray, others: Mapping[str, FloatArray]) -> FloatArray:
        """Convert equation residuals to residuals (n,) of the observations; both are in the rows' units.

        They differ where observations with correlated errors have equations that are not. `others` has the converted
        residuals of kinds before this one, by their names.
        """
        del others
        return residual

    def correlations(self) -> tuple[CorrelatedRows, ...]:
        """Return the observations whose errors are correlated."""
        return ()

    def with_left_out(self, left_out: BoolArray) -> Observations:
        """Return the observations with equations that are free of the errors of some of them (n,)."""
        del left_out
        return self

    def remembered(self, state: BlockState) -> FloatArray | None:
        """Return the shifts that are added to the residuals (n,) in the next iteration; None: there are none.

        They are kept in `BlockState.memory`; the given state is new, but still has the memory of the one before.
        """
        del state
        return None


def partials_by_unknowns(
    observations: Observations, state: BlockState, unknowns: Unknowns
) -> tuple[Linearisation, Chained]:
    """Return observations at a state, and their partials by unknowns alone, also where photos are of rigs."""
    found = observations.linearise_with_partials(state)
    columns = np.asarray(observations.columns(), dtype=np.int64)
    return found, chained(found.partials, columns, unknowns.rigs, state.partials_of_rigs())


def _ties_no_points(_: Block) -> frozenset[int]:
    return frozenset()


def _refuses_nothing(_: Block) -> None:
    pass


class KindEquations(Struct, frozen=True):
    """How a kind of observation enters the adjustment; the module of a kind lists its own as `KINDS`.

    Parameters
    ----------
    observe : callable
        Finds the kind's observations in a block.
    tied_points : callable
        Indices of the points that its observations tie to each other; they are not eliminated.
    refuse : callable
        Raises an InputError for observations whose normal equations would have too few digits at the starting values.
    """

    kind: ObservationKind
    observe: Callable[[Block, Unknowns], Observations]
    tied_points: Callable[[Block], frozenset[int]] = _ties_no_points
    refuse: Callable[[Block], None] = _refuses_nothing


class Coordinates(NamedTuple):
    """Coordinates (n,) of the project, their partials (n, 3) by local ones, and which of them exist (n,)."""

    value: FloatArray
    by_local: FloatArray
    known: NDArray[np.bool_]


def coordinates_with_partials(ground: GroundSystem, local: FloatArray, axis: IntArray) -> Coordinates:
    """Return one coordinate of each of n positions.

    Parameters
    ----------
    local : array (n, 3)
        The positions in the local frame.
    axis : array (n,) of int
        0, 1, 2: X, Y, Z.

    Returns
    -------
    Coordinates
        Zero where the project's system does not reach.
    """
    found = ground.project_with_partials(local)
    rows = np.arange(len(axis))
    value, by_local = found.value[rows, axis], found.by_local[rows, axis]
    known = np.isfinite(value) & np.isfinite(by_local).all(axis=1)
    return Coordinates(np.where(known, value, 0.0), np.where(known[:, None], by_local, 0.0), known)


def columns_of_coordinates(ground: GroundSystem, columns: IntArray, axis: IntArray) -> IntArray:
    """Return the unknowns (n, 3) that coordinates depend on, out of those (n, 3) of their positions."""
    return np.where(ground.dependence[axis], columns, CONSTANT)


# A weight large enough to enforce them would cost the normal equations their digits. Such an equation has a moderate
# error instead, and after each iteration its value is shifted by the remaining misclosure (an augmented Lagrangian).

_PART_OF_PHOTO_ERROR = 0.01
"""Error that the equation of a constant has, as a part of what a photo error changes of it."""


class ExactObservations(Observations, frozen=True):
    """Exact constraints: the first base class, before the kind of observation whose equations they have."""

    exact: ClassVar[bool] = True

    def remembered(self, state: BlockState) -> FloatArray:
        """Return the shifts of the equations, increased by the remaining misclosures."""
        missing = self.linearise_with_partials(state).residual
        return np.asarray(state.memory.get(self.rows.kind.name, 0.0) + missing)


def photo_error_on_ground(block: Block) -> float:
    """Return the size of a photo error on the ground at the mean distance of the points from their photos."""
    points = block.photo_points
    distance = np.linalg.norm(block.point_start[points.point] - block.photo_orientation[points.photo, :3], axis=1)
    principal = np.array([camera.parameters[0] for camera in block.cameras])[block.photo_camera[points.photo]]
    return float(np.mean(points.error) * np.mean(distance / principal))


_LEAST_PART = 1e-4
"""Of a photo error on the ground, that the error of an observed length may be."""


def refuse_too_precise(block: Block, observed: Sequence[tuple[str, float]], otherwise: str = "") -> None:
    """Refuse lengths that are so precise that their normal equations would leave the others too few digits.

    Parameters
    ----------
    observed : sequence of (str, float)
        What each is called, and its a-priori error; those of 0 and below have no such equations.
    otherwise : str
        What else can be written.

    Raises
    ------
    InputError
        For the most precise one.
    """
    weighted = [(error, name) for name, error in observed if error > 0.0]
    if not weighted:
        return
    (error, name), least = min(weighted), _LEAST_PART * photo_error_on_ground(block)
    if error < least:
        message = (
            f"{name} has an a-priori error of {error:.2g}, less than a ten-thousandth of a photo error on the ground; "
            f"write one above {least:.2g}{otherwise}"
        )
        raise InputError.single(message)


def error_of_constant_lengths(block: Block) -> float:
    """Return 1 % of the size of a photo error on the ground."""
    return _PART_OF_PHOTO_ERROR * photo_error_on_ground(block)


def error_of_constant_angles(block: Block) -> float:
    """Return 1 % of the angle (radians) of a photo error in the mean camera."""
    principal = np.array([camera.parameters[0] for camera in block.cameras])[block.photo_camera]
    return float(_PART_OF_PHOTO_ERROR * np.mean(block.photo_points.error) / np.mean(principal))
