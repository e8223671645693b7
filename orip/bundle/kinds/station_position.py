"""Exposure stations: positions of the antenna observed by GNSS, with lever arm, shift, drift and time offset.

Where the errors of X, Y and Z of a station are correlated, its equations are decorrelated by the Cholesky factor of the
covariance: that of X is as observed, that of Y is without what X says of it, that of Z without what X and Y say.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.antenna_positions import (
    antenna_positions_with_partials,
    columns_of_positions,
    decorrelation,
    observed_coordinates,
    position_errors,
)
from orip.bundle.antennas import StationPlaces, station_places
from orip.bundle.correlated_rows import CorrelatedRows, rows_of_members
from orip.bundle.kinds.observation import (
    ExactObservations,
    KindEquations,
    Linearisation,
    Observations,
    Rows,
    error_of_constant_lengths,
)
from orip.bundle.state import BlockState
from orip.bundle.unknowns import POINT_COORDINATES, Unknowns
from orip.records.block import Block
from orip.records.control import Station
from orip.records.ground import GroundSystem
from orip.records.observation_kinds import CONSTANT_STATION, STATION, ObservationKind


class PositionObservations(Observations, frozen=True):
    """n observed coordinates of s stations; `station` and `axis` (n,) say which.

    Parameters
    ----------
    station, axis : arrays (n,) of int
        Row of the station among the s, and 0, 1, 2 for X, Y, Z.
    members : array (s,) of int
        Of the block's stations.
    observed : array (s, 3)
    whitening : array (s, 3, 3)
        From residuals of the coordinates to those of the equations, in the same unit.
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
        value, partials, known = antenna_positions_with_partials(state, self.places, self.members, self.ground)
        residual = (self.whitening @ np.where(known[:, None], value - self.observed, 0.0)[:, :, None])[:, :, 0]
        partials = self.whitening @ partials
        at = (self.station, self.axis)
        return Linearisation(residual[at], partials[at], known[self.station])

    def as_observed(self, residual: FloatArray, others: Mapping[str, FloatArray]) -> FloatArray:
        """Return the residuals (n,) of the coordinates from those of the equations."""
        del others
        of_stations = np.zeros((len(self.members), 3))
        of_stations[self.station, self.axis] = residual
        return np.asarray(np.linalg.solve(self.whitening, of_stations[:, :, None])[self.station, self.axis, 0])

    def correlations(self) -> tuple[CorrelatedRows, ...]:
        """Return the coordinates of stations whose errors are correlated."""
        return rows_of_members(self.station, self.axis, self.rows.error, self.whitening)


class ConstantPositionObservations(ExactObservations, PositionObservations, frozen=True):
    """Positions that are met exactly."""


def observe_positions(block: Block, unknowns: Unknowns) -> PositionObservations:
    """Return the coordinates that are observed or only compared."""
    error, chosen = position_errors(block), observed_coordinates(block)
    whitening = np.array([_whitening(station) for station in block.stations]).reshape(-1, 3, 3)
    used = (error[chosen] > 0.0) & (not block.is_free_network)
    return PositionObservations(*_observed(block, unknowns, STATION, chosen, np.abs(error[chosen]), used, whitening))


def observe_constant_positions(block: Block, unknowns: Unknowns) -> ConstantPositionObservations:
    """Return the coordinates that are met exactly; in a free network none."""
    chosen = (position_errors(block) == 0.0) & (not block.is_free_network)
    error = np.full(int(chosen.sum()), error_of_constant_lengths(block) if chosen.any() else 1.0)
    whitening = np.broadcast_to(np.eye(3), (len(block.stations), 3, 3))
    used = np.ones(len(error), dtype=bool)
    return ConstantPositionObservations(*_observed(block, unknowns, CONSTANT_STATION, chosen, error, used, whitening))


def _whitening(station: Station) -> FloatArray:
    covariance = None if station.covariance is None else np.array(station.covariance)[:3, :3]
    return decorrelation(np.array(station.position_error), covariance)


def _observed(
    block: Block, unknowns: Unknowns, kind: ObservationKind, chosen: BoolArray, error: FloatArray, used: BoolArray,
    whitening: FloatArray,
) -> tuple[Rows, IntArray, IntArray, IntArray, FloatArray, FloatArray, StationPlaces, GroundSystem]:  # fmt: skip
    places = station_places(block)
    of_block, axis = np.nonzero(chosen)
    members, station = np.unique(of_block, return_inverse=True)
    observed = np.array([station.position for station in block.stations], dtype=np.float64).reshape(-1, 3)[members]
    whitening = whitening[members]
    columns = columns_of_positions(block, unknowns, places, members, whitening)
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


KINDS = (
    KindEquations(STATION, observe_positions),
    KindEquations(CONSTANT_STATION, observe_constant_positions),
)
