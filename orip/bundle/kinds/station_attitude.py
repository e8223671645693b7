"""Exposure stations: attitudes observed by INS, against which the camera is turned by the boresight."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.antennas import StationPlaces, rows_or, station_places
from orip.bundle.kinds.exact_constraints import ExactObservations, error_of_constant_angles
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.kinds.observed_rotation import rotation_residuals_with_partials
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rotation import axes_rotation_from_angle_rates, rotation_from_angles
from orip.records.block import Block
from orip.records.ground import GroundSystem
from orip.records.observations.observation_kinds import ATTITUDE, CONSTANT_ATTITUDE, ObservationKind
from orip.records.project.antenna import BORESIGHT_PLACES
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.units import DEGREES_PER_RADIAN


class AttitudeObservations(Observations, frozen=True):
    """n observed angles, degrees; `station` and `axis` (n,) say of which station and which of omega, phi, kappa.

    `observed` (n, 3) has all angles of their stations, degrees.
    """

    rows: Rows
    station: IntArray
    axis: IntArray
    observed: FloatArray
    places: StationPlaces
    ground: GroundSystem

    def groups(self) -> IntArray:
        """Return the rows of the stations: a station loses its weight as a whole."""
        return self.station

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (degrees, wrapped) and partials by the photo's rotation (3) and the boresight (3).

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
        rows = np.arange(len(self.axis))
        partials = np.concatenate([by_rotation, by_boresight], axis=2)[rows, self.axis]
        residual = np.where(known, residual[rows, self.axis], 0.0)
        return Linearisation(residual, np.where(known[:, None], partials, 0.0), known)


class ConstantAttitudeObservations(ExactObservations, AttitudeObservations, frozen=True):
    """Angles that are met exactly."""


def observe_attitudes(block: Block, unknowns: Unknowns) -> AttitudeObservations:
    """Return the angles that are observed or only compared."""
    error = _errors(block)
    chosen = np.isfinite(error) & (error != 0.0)
    used = (error[chosen] > 0.0) & (not block.is_free_network)
    return AttitudeObservations(
        *_observed(block, unknowns, ATTITUDE, chosen, np.abs(error[chosen]) * DEGREES_PER_RADIAN, used)
    )


def observe_constant_attitudes(block: Block, unknowns: Unknowns) -> ConstantAttitudeObservations:
    """Return the angles that are met exactly; in a free network none."""
    chosen = (_errors(block) == 0.0) & (not block.is_free_network)
    of_angle = error_of_constant_angles(block) * DEGREES_PER_RADIAN if chosen.any() else 1.0
    error = np.full(int(chosen.sum()), of_angle)
    used = np.ones(len(error), dtype=bool)
    return ConstantAttitudeObservations(*_observed(block, unknowns, CONSTANT_ATTITUDE, chosen, error, used))


def _errors(block: Block) -> FloatArray:
    """Return a-priori errors (number of stations, 3), radians; NaN where no attitude was observed."""
    errors = [station.angle_error if station.has_angles else (np.nan,) * 3 for station in block.stations]
    return np.array(errors, dtype=np.float64).reshape(-1, 3)


def _observed(
    block: Block, unknowns: Unknowns, kind: ObservationKind, chosen: BoolArray, error: FloatArray, used: BoolArray
) -> tuple[Rows, IntArray, IntArray, FloatArray, StationPlaces, GroundSystem]:
    places = station_places(block)
    station, axis = np.nonzero(chosen)
    angles = np.array([station.angles for station in block.stations], dtype=np.float64).reshape(-1, 3)
    angles *= DEGREES_PER_RADIAN
    boresight = rows_or(unknowns.antennas[:, BORESIGHT_PLACES], places.antenna[station], CONSTANT)
    rows = Rows(
        kind=kind,
        photo=tuple(block.photos[row].name for row in places.photo[station]),
        point=("",) * len(axis),
        component=tuple(PHOTO_PARAMETERS[3 + index] for index in axis),
        observed=angles[station, axis],
        error=error,
        used=used,
        columns=np.hstack([unknowns.photos[places.photo[station], 3:], boresight]),
    )
    return rows, station, axis, angles[station], places, block.ground


KINDS = (
    KindEquations(ATTITUDE, observe_attitudes),
    KindEquations(CONSTANT_ATTITUDE, observe_constant_attitudes),
)
