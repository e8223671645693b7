"""Observed rotations, and the attitudes of exposure stations observed by INS, with the boresight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
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
from orip.records.observation_kinds import ATTITUDE, CONSTANT_ATTITUDE, ObservationKind
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
        columns=np.hstack([unknowns.elements[places.photo[station], 3:], boresight]),
    )
    return rows, station, axis, angles[station], places, block.ground


KINDS = (
    KindEquations(ATTITUDE, observe_attitudes),
    KindEquations(CONSTANT_ATTITUDE, observe_constant_attitudes),
)
