"""Exposure stations: positions of the antenna observed by GNSS, with lever arm, shift, drift and time offset.

Where the errors of X, Y and Z of a station are correlated, its equations are decorrelated by the Cholesky factor of the
covariance: that of X is as observed, that of Y is without what X says of it, that of Z without what X and Y say.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.antennas import StationPlaces, rows_or, station_places
from orip.bundle.kinds.observation import (
    ExactObservations,
    KindEquations,
    Linearisation,
    Observations,
    Rows,
    error_of_constant_lengths,
)
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, POINT_COORDINATES, Unknowns
from orip.geometry.rotation import cross_matrix
from orip.records.block import Block
from orip.records.control import Station
from orip.records.definition import LEVER_ARM
from orip.records.ground import GroundSystem
from orip.records.observation_kinds import CONSTANT_STATION, STATION, ObservationKind

_ARM, _OFFSET = slice(0, 3), 6


class PositionObservations(Observations, frozen=True):
    """n observed coordinates of s stations; `station` and `axis` (n,) say which.

    Parameters
    ----------
    rows : Rows
    station, axis : arrays (n,) of int
        Row of the station among the s, and 0, 1, 2 for X, Y, Z.
    members : array (s,) of int
        Of the block's stations.
    observed : array (s, 3)
    whitening : array (s, 3, 3)
        From residuals of the coordinates to those of the equations, in the same unit.
    places : StationPlaces
    ground : GroundSystem
    """

    rows: Rows
    station: IntArray
    axis: IntArray
    members: IntArray
    observed: FloatArray
    whitening: FloatArray
    places: StationPlaces
    ground: GroundSystem

    def groups(self) -> IntArray:
        """Return the rows of the stations: a station loses its weight as a whole."""
        return self.station

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (ground unit) and partials by 16 unknowns.

        These are the projection centre (3), the photo's rotation (3), lever arm (3), time offset, shift (3), drift (3).
        """
        places, members = self.places, self.members
        photo, elapsed = places.photo[members], places.elapsed[members][:, None, None]
        rotation, velocity = state.rotations[photo], places.velocity[members]
        antenna = rows_or(state.antennas, places.antenna[members], 0.0)
        arm = (rotation @ antenna[:, _ARM, None])[:, :, 0]
        found = self.ground.project_with_partials(state.centres[photo] + arm)
        value = found.value + velocity * antenna[:, [_OFFSET]]
        value = value + rows_or(state.shifts, places.shift[members], 0.0)
        value = value + elapsed[:, 0] * rows_or(state.drifts, places.drift[members], 0.0)
        turned = found.by_local @ -cross_matrix(arm) @ state.rotation_basis()[photo]
        axes = np.broadcast_to(np.eye(3), turned.shape)
        partials = np.concatenate(
            [found.by_local, turned, found.by_local @ rotation, velocity[:, :, None], axes, elapsed * axes], axis=2
        )
        known = np.isfinite(value).all(axis=1) & np.isfinite(partials).all(axis=(1, 2))
        residual = (self.whitening @ np.where(known[:, None], value - self.observed, 0.0)[:, :, None])[:, :, 0]
        partials = self.whitening @ np.where(known[:, None, None], partials, 0.0)
        at = (self.station, self.axis)
        return Linearisation(residual[at], partials[at], known[self.station])

    def as_observed(self, residual: FloatArray) -> FloatArray:
        """Return the residuals (n,) of the coordinates from those of the equations."""
        of_stations = np.zeros((len(self.members), 3))
        of_stations[self.station, self.axis] = residual
        return np.asarray(np.linalg.solve(self.whitening, of_stations[:, :, None])[self.station, self.axis, 0])


class ConstantPositionObservations(ExactObservations, PositionObservations, frozen=True):
    """Positions that are met exactly."""


def observe_positions(block: Block, unknowns: Unknowns) -> PositionObservations:
    """Return the coordinates that are observed or only compared."""
    error = _errors(block)
    chosen = np.isfinite(error) & (error != 0.0)
    whitening = np.array([_whitening(station) for station in block.stations]).reshape(-1, 3, 3)
    used = (error[chosen] > 0.0) & (not block.is_free_network)
    return PositionObservations(*_observed(block, unknowns, STATION, chosen, np.abs(error[chosen]), used, whitening))


def observe_constant_positions(block: Block, unknowns: Unknowns) -> ConstantPositionObservations:
    """Return the coordinates that are met exactly; in a free network none."""
    chosen = (_errors(block) == 0.0) & (not block.is_free_network)
    error = np.full(int(chosen.sum()), error_of_constant_lengths(block) if chosen.any() else 1.0)
    whitening = np.broadcast_to(np.eye(3), (len(block.stations), 3, 3))
    used = np.ones(len(error), dtype=bool)
    return ConstantPositionObservations(*_observed(block, unknowns, CONSTANT_STATION, chosen, error, used, whitening))


def _errors(block: Block) -> FloatArray:
    """Return a-priori errors (number of stations, 3), NaN where no position was observed."""
    errors = [station.position_error if station.has_position else (np.nan,) * 3 for station in block.stations]
    return np.array(errors, dtype=np.float64).reshape(-1, 3)


def _whitening(station: Station) -> FloatArray:
    """Return diag(error) L^-1 for a covariance L L^T; coordinates that are not observed stay as they are."""
    found = np.eye(3)
    error = np.array(station.position_error)
    observed = np.flatnonzero(error > 0.0)
    if station.covariance is not None and len(observed):
        factor = np.linalg.cholesky(np.array(station.covariance)[np.ix_(observed, observed)])
        found[np.ix_(observed, observed)] = error[observed, None] * np.linalg.inv(factor)
    return found


def _observed(
    block: Block, unknowns: Unknowns, kind: ObservationKind, chosen: BoolArray, error: FloatArray, used: BoolArray,
    whitening: FloatArray,
) -> tuple[Rows, IntArray, IntArray, IntArray, FloatArray, FloatArray, StationPlaces, GroundSystem]:  # fmt: skip
    places = station_places(block)
    of_block, axis = np.nonzero(chosen)
    members, station = np.unique(of_block, return_inverse=True)
    observed = np.array([station.position for station in block.stations], dtype=np.float64).reshape(-1, 3)[members]
    whitening = whitening[members]
    columns = _columns(block, unknowns, places, members, whitening)
    rows = Rows(
        kind=kind,
        photo=tuple(block.photos[row].name for row in places.photo[of_block]),
        point=("",) * len(axis),
        component=tuple(POINT_COORDINATES[index] for index in axis),
        observed=observed[station, axis],
        error=error,
        used=used,
        columns=columns[station, axis],
    )
    return rows, station, axis, members, observed, whitening, places, block.ground


def _columns(
    block: Block, unknowns: Unknowns, places: StationPlaces, members: IntArray, whitening: FloatArray
) -> IntArray:
    """Return the unknowns (s, 3, 16) of X, Y and Z of stations."""
    photo, antenna = unknowns.elements[places.photo[members]], places.antenna[members]
    of_antenna = rows_or(unknowns.antennas, antenna, CONSTANT)
    shift = rows_or(unknowns.shifts, places.shift[members], CONSTANT)
    drift = rows_or(unknowns.drifts, places.drift[members], CONSTANT)
    given = np.array([record.lever_arm for record in block.antennas], dtype=np.float64).reshape(-1, len(LEVER_ARM))
    has_arm = (rows_or(given, antenna, 0.0) != 0.0).any(axis=1) | (of_antenna[:, _ARM] != CONSTANT).any(axis=1)
    mixed = whitening != 0.0
    depends = (mixed @ block.ground.dependence.astype(np.int64)) > 0

    def where(condition: BoolArray, columns: IntArray) -> IntArray:
        shape = (len(members), 3, columns.shape[1])
        return np.where(np.broadcast_to(condition, shape), columns[:, None], CONSTANT)

    always = np.ones((1, 1, 1), dtype=bool)
    return np.concatenate(
        [
            where(depends, photo[:, :3]),
            where(has_arm[:, None, None], photo[:, 3:]),
            where(always, of_antenna[:, _ARM]),
            where(always, of_antenna[:, [_OFFSET]]),
            where(mixed, shift),
            where(mixed, drift),
        ],
        axis=2,
    )


KINDS = (
    KindEquations(STATION, observe_positions),
    KindEquations(CONSTANT_STATION, observe_constant_positions),
)
