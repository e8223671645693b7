"""Relative control: differences of position and attitude between two exposures, as inertial data observe them.

The difference of positions, along the axes of the project, is that of two stations' observed positions; a shift that
both have drops out. The rotation is that of gyroscopes, about the axes of the first station's inertial system: with
attitudes A = R B^T it is A1^T A2, in which an error that both attitudes have in common drops out, and the boresight
but for small parts. Its residual is the rotation vector that is left, so that nothing is singular anywhere. Where the
errors of the six components are correlated, their equations are decorrelated as those of a station.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.antenna_positions import antenna_positions_with_partials, decorrelation
from orip.bundle.antennas import NONE, StationPlaces, antenna_of, rows_or, station_places
from orip.bundle.correlated_rows import CorrelatedRows, rows_of_members
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rotation import (
    axes_rotation_from_angle_rates,
    rotation_from_angles,
    rotation_vectors_with_partials,
)
from orip.records.block import Block
from orip.records.control import StationDifference
from orip.records.definition import BORESIGHT_PLACES, LEVER_ARM
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.records.observation_kinds import DIFFERENCE
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN

COMPONENTS = ("X", "Y", "Z", "OMEGA", "PHI", "KAPPA")
_OF_STATION = 19
"""Unknowns: six of the photo, lever arm, time offset, shift, drift, boresight."""

_UNIT = np.array([1.0, 1.0, 1.0, DEGREES_PER_RADIAN, DEGREES_PER_RADIAN, DEGREES_PER_RADIAN])
"""Of the rows, in one of the records."""


class DifferenceObservations(Observations, frozen=True):
    """n observed components of m differences; `pair` and `axis` (n,) say which.

    Parameters
    ----------
    pair, axis : arrays (n,) of int
        Row of the difference among the m, and 0 to 5 for `COMPONENTS`.
    position : array (m, 3)
        NaN where none was observed.
    rotation : array (m, 3, 3)
        NaN likewise.
    whitening : array (m, 6, 6)
        From residuals of the components, in the units of the rows, to those of the equations.
    is_shared : array (m, 13) of bool
        Unknowns of antenna, shift and drift that both stations have.
    places : StationPlaces
        Of the first stations, then of the second ones.
    """

    rows: Rows
    pair: IntArray
    axis: IntArray
    position: FloatArray
    rotation: FloatArray
    whitening: FloatArray
    is_shared: BoolArray
    places: StationPlaces
    ground: GroundSystem

    def groups(self) -> IntArray:
        """Return the rows of the differences: one loses its weight as a whole."""
        return self.pair

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (ground unit, degrees) and partials by 38 unknowns.

        These are projection centre (3) and rotation (3) of the first photo; lever arm (3), time offset, shift (3),
        drift (3) and boresight (3) of its station; and the same of the second. What both share is with the first. The
        project's axes turn slightly when a projection centre moves; the partials neglect this.
        """
        count = len(self.position)
        found, by_unknowns, known = antenna_positions_with_partials(
            state, self.places, np.arange(2 * count), self.ground
        )
        residual = np.full((count, 6), np.nan)
        partials = np.zeros((2 * count, 6, _OF_STATION))
        residual[:, :3] = found[count:] - found[:count] - self.position
        partials[:, :3, :16] = by_unknowns
        partials[:count] *= -1.0
        residual[:, 3:], partials[:, 3:, 3:6], partials[:, 3:, 16:] = self._turns(state)
        first, second = partials[:count], partials[count:]
        first[:, :, 6:] += np.where(self.is_shared[:, None], second[:, :, 6:], 0.0)
        partials = np.concatenate([first, second], axis=2)
        of_both = np.logical_and(*np.split(known, 2))
        residual = (self.whitening @ np.nan_to_num(residual)[:, :, None])[:, :, 0]
        partials = self.whitening @ np.nan_to_num(partials)
        at = (self.pair, self.axis)
        return Linearisation(residual[at], partials[at], np.asarray(of_both, dtype=np.bool_)[self.pair])

    def _turns(self, state: BlockState) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return rotation vectors (m, 3), degrees; partials (2 m, 3, 3) by rotations of photos, and by boresights."""
        photo = self.places.photo
        boresight = rows_or(state.antennas, self.places.antenna, 0.0)[:, BORESIGHT_PLACES]
        axes = self.ground.axes_at(self.ground.to_project(state.centres[photo]))
        is_there: BoolArray = np.asarray(np.isfinite(axes).all(axis=(1, 2)))
        axes = np.where(is_there[:, None, None], axes, np.eye(3))
        attitude = axes @ state.rotations[photo] @ np.swapaxes(rotation_from_angles(boresight), 1, 2)
        first, second = np.split(attitude, 2)
        back = np.swapaxes(first, 1, 2)
        observed = np.where(np.isfinite(self.rotation), self.rotation, np.eye(3))
        vectors, rates = rotation_vectors_with_partials(back @ second @ np.swapaxes(observed, 1, 2))
        vectors = np.where(np.isfinite(self.rotation[:, 0]), vectors, np.nan)
        rates = DEGREES_PER_RADIAN * rates @ back
        rates = np.concatenate([-rates, rates])
        by_boresight = -rates @ attitude @ axes_rotation_from_angle_rates(boresight)
        return DEGREES_PER_RADIAN * vectors, rates @ axes @ state.rotation_basis()[photo], by_boresight

    def as_observed(self, residual: FloatArray, others: Mapping[str, FloatArray]) -> FloatArray:
        """Return the residuals (n,) of the components from those of the equations."""
        del others
        of_pairs = np.zeros((len(self.position), 6))
        of_pairs[self.pair, self.axis] = residual
        return np.asarray(np.linalg.solve(self.whitening, of_pairs[:, :, None])[self.pair, self.axis, 0])

    def correlations(self) -> tuple[CorrelatedRows, ...]:
        """Return the components of differences whose errors are correlated."""
        return rows_of_members(self.pair, self.axis, self.rows.error, self.whitening)


def observe_differences(block: Block, unknowns: Unknowns) -> DifferenceObservations:
    """Return the components that are observed or only compared."""
    lines = block.differences
    error = np.array([line.errors for line in lines], dtype=np.float64).reshape(-1, 6) * _UNIT
    pair, axis = np.nonzero(np.isfinite(error))
    position = np.array([line.position for line in lines], dtype=np.float64).reshape(-1, 3)
    angles = np.array([line.angles for line in lines], dtype=np.float64).reshape(-1, 3)
    whitening = np.array([_whitening(line) for line in lines]).reshape(-1, 6, 6)
    places = _places(block)
    columns, is_shared = _columns(block, unknowns, places, whitening)
    values = np.hstack([position, angles * DEGREES_PER_RADIAN])
    rows = Rows(
        kind=DIFFERENCE,
        photo=("",) * len(pair),
        point=tuple(lines[row].name for row in pair),
        component=tuple(COMPONENTS[index] for index in axis),
        observed=values[pair, axis],
        error=np.abs(error[pair, axis]),
        used=(error[pair, axis] > 0.0) & (not block.is_free_network),
        columns=columns[pair, axis],
    )
    rotation = rotation_from_angles(angles)
    return DifferenceObservations(rows, pair, axis, position, rotation, whitening, is_shared, places, block.ground)


def _whitening(line: StationDifference) -> FloatArray:
    error = np.array(line.errors) * _UNIT
    covariance = None if line.covariance is None else np.array(line.covariance) * np.outer(_UNIT, _UNIT)
    return decorrelation(error, covariance)


def _places(block: Block) -> StationPlaces:
    """Return where the first and the second stations of the differences belong; a shift is one of both or of none."""
    places = station_places(block)
    station_of = {record_key(station.photo): row for row, station in enumerate(block.stations)}
    photo_of = {record_key(photo.name): row for row, photo in enumerate(block.photos) if block.differences}
    keys = [record_key(line.first) for line in block.differences]
    keys += [record_key(line.second) for line in block.differences]
    photo = np.array([photo_of[key] for key in keys], dtype=np.int64)
    row = np.array([station_of.get(key, NONE) for key in keys], dtype=np.int64)
    cameras = np.array([antenna_of(block.antennas, camera.name) for camera in block.cameras], dtype=np.int64)

    def of_both(numbers: IntArray) -> IntArray:
        found = rows_or(numbers[:, None], row, NONE)[:, 0].reshape(2, -1)
        return np.where((found == NONE).any(axis=0), NONE, found).ravel()

    drift = of_both(places.drift)
    return replace(
        places,
        photo=photo,
        antenna=cameras[block.photo_camera[photo]],
        shift=of_both(places.shift),
        drift=drift,
        elapsed=np.where(drift == NONE, 0.0, rows_or(places.elapsed[:, None], row, 0.0)[:, 0]),
        velocity=rows_or(places.velocity, row, 0.0),
    )


def _columns(
    block: Block, unknowns: Unknowns, places: StationPlaces, whitening: FloatArray
) -> tuple[IntArray, BoolArray]:
    """Return the unknowns (m, 6, 38) of the components, and which of antenna, shift and drift both stations have."""
    of_antenna = rows_or(unknowns.antennas, places.antenna, CONSTANT)
    arm = len(LEVER_ARM)
    given = np.array([record.lever_arm for record in block.antennas], dtype=np.float64).reshape(-1, arm)
    has_arm = (rows_or(given, places.antenna, 0.0) != 0.0).any(axis=1) | (of_antenna[:, :arm] != CONSTANT).any(axis=1)
    of_stations = np.hstack([
        unknowns.elements[places.photo], of_antenna[:, [0, 1, 2, 6]],
        rows_or(unknowns.shifts, places.shift, CONSTANT), rows_or(unknowns.drifts, places.drift, CONSTANT),
        of_antenna[:, BORESIGHT_PLACES],
    ])  # fmt: skip
    first, second = np.split(of_stations, 2)
    is_shared = (first[:, 6:] == second[:, 6:]) & (first[:, 6:] != CONSTANT)
    second[:, 6:][is_shared] = CONSTANT
    touched = np.zeros((len(first), 6, 2, _OF_STATION), dtype=bool)
    touched[:, :3, :, :10] = True
    touched[:, :3, :, 3:6] = np.stack(np.split(has_arm, 2), axis=1)[:, None, :, None]
    touched[:, 3:, :, 3:6] = True
    touched[:, 3:, :, 16:] = True
    touched[:, :3, :, 10:16] = np.tile(np.eye(3, dtype=bool), 2)[:, None]
    mixed = (whitening != 0.0).astype(np.int64) @ touched.reshape(-1, 6, 2 * _OF_STATION).astype(np.int64) > 0
    return np.where(mixed, np.hstack([first, second])[:, None], CONSTANT), is_shared


def disregarded_difference(line: StationDifference) -> StationDifference:
    """Return a difference that is only compared."""
    x, y, z, omega, phi, kappa = (-abs(error) for error in line.errors)
    return replace(line, position_error=(x, y, z), angle_error=(omega, phi, kappa))


def with_difference_errors_times(line: StationDifference, of_position: float, of_rotation: float) -> StationDifference:
    """Return a difference whose errors are multiplied by factors; those only compared stay."""
    factors = np.repeat([of_position, of_rotation], 3)
    errors = np.array(line.errors)
    x, y, z, omega, phi, kappa = np.where(errors > 0.0, errors * factors, errors).tolist()
    covariance = None
    if line.covariance is not None:
        covariance = tuple(map(tuple, (np.array(line.covariance) * np.outer(factors, factors)).tolist()))
    return replace(line, position_error=(x, y, z), angle_error=(omega, phi, kappa), covariance=covariance)


KINDS = (KindEquations(DIFFERENCE, observe_differences),)
