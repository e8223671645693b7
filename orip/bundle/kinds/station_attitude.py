"""Observed rotations, and the attitudes of exposure stations observed by INS, with the boresight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.antenna_positions import (
    antenna_positions_with_partials,
    columns_of_positions,
    decorrelation,
    observed_coordinates,
)
from orip.bundle.antennas import StationPlaces, rows_or, station_places
from orip.bundle.kinds.observation import (
    ExactObservations,
    KindEquations,
    Linearisation,
    Observations,
    Rows,
    error_of_constant_angles,
)
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.errors import InputError
from orip.geometry.rotation import (
    angle_rates_from_axes_rotation,
    angles_from_rotation,
    axes_rotation_from_angle_rates,
    rotation_from_angles,
    rotation_vectors_with_partials,
)
from orip.records.block import Block
from orip.records.definition import BORESIGHT_PLACES
from orip.records.ground import GroundSystem
from orip.records.observation_kinds import ATTITUDE, CONSTANT_ATTITUDE, STATION, ObservationKind
from orip.records.photo import PHOTO_PARAMETERS
from orip.units import DEGREES_PER_RADIAN, RADIANS_PER_DEGREE
from orip.wording import agreeing, first_names, joined

# Near there omega and kappa turn about the same axis: each of them by itself says nothing, and their errors, taken as
# those of the angles, would hold a third axis without any. The rotation that the three angles are together is as well
# known as elsewhere. Its residual is the rotation delta with R = Exp([delta]x) R_observed: those of OMEGA, PHI and
# KAPPA are what R is turned by about X, Y and Z, and their a-priori errors are the errors of these rotations.

_COSINE_NEAR_POLE = 0.1
"""Of an observed phi of 84.3 degrees: beyond it the rotation is what was observed."""

_LEAST_COSINE = 0.02
"""Of an adjusted phi of 88.9 degrees: angles cannot be compared there, wherever they were observed."""


def rotation_residuals_with_partials(
    rotation: FloatArray, observed: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return what n rotations differ from observed ones in each of their three angles or small rotations.

    Parameters
    ----------
    rotation : array (n, 3, 3)
    observed : array (n, 3)
        Omega, phi and kappa, degrees; NaN where one was not observed.

    Returns
    -------
    residual : array (n, 3)
        Degrees, in (-180, 180]; NaN where the angle was not observed.
    partials : array (n, 3, 3)
        Degrees by small rotations about the axes, radians.
    inseparable : array (n,) of bool
        Rotations near the pole of which not all angles were observed: there these say nothing.
    """
    angles = angles_from_rotation(rotation)
    complete = np.isfinite(observed).all(axis=1)
    at_pole = np.abs(np.cos(angles[:, 1])) < _LEAST_COSINE
    as_rotation = complete & (at_pole | (np.abs(np.cos(observed[:, 1] * RADIANS_PER_DEGREE)) < _COSINE_NEAR_POLE))
    residual = (angles * DEGREES_PER_RADIAN - observed + 180.0) % 360.0 - 180.0
    partials = angle_rates_from_axes_rotation(angles) * DEGREES_PER_RADIAN
    if as_rotation.any():
        as_observed = rotation_from_angles(observed[as_rotation] * RADIANS_PER_DEGREE)
        vectors, by_rotation = rotation_vectors_with_partials(rotation[as_rotation] @ np.swapaxes(as_observed, 1, 2))
        residual[as_rotation], partials[as_rotation] = vectors * DEGREES_PER_RADIAN, by_rotation * DEGREES_PER_RADIAN
    return residual, partials, at_pole & ~complete


def require_separable_angles(inseparable: Sequence[str]) -> None:
    """Require that single angles are observed only where omega and kappa can be told apart.

    Parameters
    ----------
    inseparable : sequence of str
        What is observed there.

    Raises
    ------
    InputError
    """
    if inseparable:
        what = joined(inseparable) if len(inseparable) <= 3 else first_names(inseparable, 3)
        message = (
            f"{what} {agreeing(len(inseparable), 'is', 'are')} observed, but phi is within 1.1 degrees of ±90 "
            "there, where omega and kappa turn about the same axis; give all three angles of a photo in the "
            f".ELE file (they are then one rotation), or remove the {agreeing(len(inseparable), 'element')}"
        )
        raise InputError.single(message)


class AttitudeObservations(Observations, frozen=True):
    """n observed angles, degrees; `station` and `axis` (n,) say of which station and which of omega, phi, kappa.

    Parameters
    ----------
    station, axis : arrays (n,) of int
    observed : array (n, 3)
        All angles of their stations, degrees.
    mixing : array (n, 6)
        From residuals of the station's X, Y, Z and angles, in the units of rows, to that of the equation.
    position : array (n, 3)
        Observed; only of stations whose angles are correlated with it.
    position_row : array (n, 3) of int
        Where the residuals of these are among the observed positions.
    """

    rows: Rows
    station: IntArray
    axis: IntArray
    observed: FloatArray
    places: StationPlaces
    ground: GroundSystem
    mixing: FloatArray
    position: FloatArray
    position_row: IntArray

    @property
    def is_mixed(self) -> bool:
        """Return whether angles are correlated with others, or with positions."""
        return bool((self.mixing[:, 3:] != np.eye(3)[self.axis]).any() or (self.mixing[:, :3] != 0.0).any())

    def groups(self) -> IntArray:
        """Return the rows of the stations: a station loses its weight as a whole."""
        return self.station

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (degrees, wrapped) and partials by the photo's rotation (3) and the boresight (3).

        Where angles are correlated with positions, also by projection centre (3), lever arm (3), time offset, shift (3)
        and drift (3).

        The project's axes turn slightly when a projection centre moves, by the shift over the earth's radius; the
        partials neglect this. Near phi = ±90 degrees the residuals are small rotations about the project's axes.
        """
        photo, antenna = self.places.photo[self.station], self.places.antenna[self.station]
        boresight = rows_or(state.antennas, antenna, 0.0)[:, BORESIGHT_PLACES]
        axes = self.ground.axes_at(self.ground.to_project(state.centres[photo]))
        rotation = axes @ state.rotations[photo] @ np.swapaxes(rotation_from_angles(boresight), 1, 2)
        known: BoolArray = np.asarray(np.isfinite(rotation).all(axis=(1, 2)))
        rotation = np.where(known[:, None, None], rotation, np.eye(3))
        residual, rates, _ = rotation_residuals_with_partials(rotation, self.observed)
        by_rotation = rates @ np.where(known[:, None, None], axes, 0.0) @ state.rotation_basis()[photo]
        by_boresight = -rates @ rotation @ axes_rotation_from_angle_rates(boresight)
        partials = np.concatenate([by_rotation, by_boresight], axis=2)
        partials = np.einsum("na,nak->nk", self.mixing[:, 3:], partials)
        residual = np.einsum("na,na->n", self.mixing[:, 3:], residual)
        if self.rows.columns is not None and self.rows.columns.shape[1] > _UNCORRELATED:
            value, by_unknowns, is_there = antenna_positions_with_partials(
                state, self.places, self.station, self.ground
            )
            known &= is_there
            residual += np.einsum("na,na->n", self.mixing[:, :3], np.nan_to_num(value - self.position))
            of_position = np.einsum("na,nak->nk", self.mixing[:, :3], by_unknowns)
            partials[:, :3] += of_position[:, 3:6]
            partials = np.hstack([partials, of_position[:, :3], of_position[:, 6:]])
        return Linearisation(np.where(known, residual, 0.0), np.where(known[:, None], partials, 0.0), known)

    def decorrelated(self, angles: FloatArray, positions: FloatArray) -> FloatArray:
        """Return what errors of the angles (n, g), and of all observed positions (p, g), are in the equations."""
        found = np.zeros_like(angles)
        if len(positions):
            found += np.einsum("na,nag->ng", self.mixing[:, :3], positions[self.position_row])
        own = self.station * 3 + self.axis
        for other in range(3):
            wanted = self.station * 3 + other
            row = np.minimum(np.searchsorted(own, wanted), len(own) - 1)
            found += np.where(own[row] == wanted, self.mixing[:, 3 + other], 0.0)[:, None] * angles[row]
        return found

    def as_observed(self, residual: FloatArray, others: Mapping[str, FloatArray]) -> FloatArray:
        """Return the residuals (n,) of the angles from those of the equations."""
        found = residual.copy()
        if (self.mixing[:, :3] != 0.0).any():
            of_position = others[STATION.name][self.position_row]
            found -= np.einsum("na,na->n", self.mixing[:, :3], of_position)
        for axis in range(3):  # lower triangles: omega by itself, phi after omega, kappa after both
            mine = np.flatnonzero(self.axis == axis)
            for other in range(axis):
                row = np.searchsorted(self.station * 3 + self.axis, self.station[mine] * 3 + other)
                row = np.minimum(row, len(found) - 1)
                found[mine] -= self.mixing[mine, 3 + other] * found[row]
            found[mine] /= self.mixing[mine, 3 + axis]
        return found


_UNCORRELATED = 6
"""Unknowns of an angle that is not correlated with a position."""


class ConstantAttitudeObservations(ExactObservations, AttitudeObservations, frozen=True):
    """Angles that are met exactly."""


def observe_attitudes(block: Block, unknowns: Unknowns) -> AttitudeObservations:
    """Return the angles that are observed or only compared."""
    error = _errors(block)
    chosen = np.isfinite(error) & (error != 0.0)
    used = (error[chosen] > 0.0) & (not block.is_free_network)
    return AttitudeObservations(
        *_observed(block, unknowns, ATTITUDE, chosen, np.abs(error[chosen]) * DEGREES_PER_RADIAN, used, _mixing(block))
    )


def observe_constant_attitudes(block: Block, unknowns: Unknowns) -> ConstantAttitudeObservations:
    """Return the angles that are met exactly; in a free network none."""
    chosen = (_errors(block) == 0.0) & (not block.is_free_network)
    of_angle = error_of_constant_angles(block) * DEGREES_PER_RADIAN if chosen.any() else 1.0
    error = np.full(int(chosen.sum()), of_angle)
    used = np.ones(len(error), dtype=bool)
    mixing = np.broadcast_to(np.eye(6)[3:], (len(block.stations), 3, 6))
    return ConstantAttitudeObservations(*_observed(block, unknowns, CONSTANT_ATTITUDE, chosen, error, used, mixing))


def _errors(block: Block) -> FloatArray:
    """Return a-priori errors (number of stations, 3), radians; NaN where no attitude was observed."""
    errors = [station.angle_error if station.has_angles else (np.nan,) * 3 for station in block.stations]
    return np.array(errors, dtype=np.float64).reshape(-1, 3)


_Parts = tuple[Rows, IntArray, IntArray, FloatArray, StationPlaces, GroundSystem, FloatArray, FloatArray, IntArray]


def _mixing(block: Block) -> FloatArray:
    """Return the last rows (number of stations, 3, 6) of what decorrelates positions and angles, in units of rows."""
    unit = np.repeat([1.0, DEGREES_PER_RADIAN], 3)
    found = np.tile(np.eye(6)[3:], (len(block.stations), 1, 1))
    for row, station in enumerate(block.stations):
        if station.has_joint_covariance and station.covariance is not None:
            error = np.array([*station.position_error, *station.angle_error]) * unit
            found[row] = decorrelation(error, np.array(station.covariance) * np.outer(unit, unit))[3:]
    return found


def _observed(
    block: Block, unknowns: Unknowns, kind: ObservationKind, chosen: BoolArray, error: FloatArray, used: BoolArray,
    mixing: FloatArray,
) -> _Parts:  # fmt: skip
    places = station_places(block)
    station, axis = np.nonzero(chosen)
    angles = np.array([station.angles for station in block.stations], dtype=np.float64).reshape(-1, 3)
    angles *= DEGREES_PER_RADIAN
    boresight = rows_or(unknowns.antennas[:, BORESIGHT_PLACES], places.antenna[station], CONSTANT)
    own = mixing[station, axis]
    columns = np.hstack([unknowns.elements[places.photo[station], 3:], boresight])
    if (own[:, :3] != 0.0).any():
        of_position = columns_of_positions(block, unknowns, places, station, own[:, None, :3])[:, 0]
        columns = np.hstack([columns, of_position[:, :3], of_position[:, 6:]])
    position = np.array([record.position for record in block.stations], dtype=np.float64).reshape(-1, 3)
    rows = Rows(
        kind=kind,
        photo=tuple(block.photos[row].name for row in places.photo[station]),
        point=("",) * len(axis),
        component=tuple(PHOTO_PARAMETERS[3 + index] for index in axis),
        observed=angles[station, axis],
        error=error,
        used=used,
        columns=columns,
    )
    return (
        rows, station, axis, angles[station], places, block.ground, own, position[station],
        _rows_of_positions(block)[station],
    )  # fmt: skip


def _rows_of_positions(block: Block) -> IntArray:
    """Return which of the observed coordinates those of each station (number of stations, 3) are."""
    chosen = observed_coordinates(block)
    return (np.cumsum(chosen.ravel()) - 1).reshape(chosen.shape).astype(np.int64)


KINDS = (
    KindEquations(ATTITUDE, observe_attitudes),
    KindEquations(CONSTANT_ATTITUDE, observe_constant_attitudes),
)
