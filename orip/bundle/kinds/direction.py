"""Theodolite directions: azimuth from station to target less the set's zero direction, and zenith angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.records.block import Block
from orip.records.ground import GroundSystem
from orip.records.observation_kinds import DIRECTION
from orip.units import DEGREES_PER_RADIAN


class DirectionObservations(Observations, frozen=True):
    """n directions and zenith angles, degrees; `is_zenith` (n,) tells which, `set` (n,) is the theodolite set's row."""

    rows: Rows
    station: NDArray[np.int64]
    target: NDArray[np.int64]
    set: NDArray[np.int64]
    is_zenith: NDArray[np.bool_]
    ground: GroundSystem

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (degrees, wrapped) and partials by zero direction, station (3) and target (3).

        Directions refer to the project's axes at the station. These turn slightly when the station moves, by the shift
        over the earth's radius; the partials neglect this.
        """
        station, target = state.points[self.station], state.points[self.target]
        axes = self.ground.axes_at(self.ground.to_project(station))
        dx, dy, dz = (axes @ (target - station)[:, :, None])[:, :, 0].T
        plane = np.hypot(dx, dy)
        known = plane > 0.0
        plane = np.where(known, plane, 1.0)
        spatial = plane**2 + dz**2
        azimuth = np.arctan2(dx, dy) - state.theodolites[self.set]
        zenith = np.arctan2(plane, dz)
        by_azimuth = np.stack([dy, -dx, np.zeros_like(dx)], axis=1) / plane[:, None] ** 2
        by_zenith = np.stack([dx * dz / plane, dy * dz / plane, -plane], axis=1) / spatial[:, None]
        by_target = (np.where(self.is_zenith[:, None], by_zenith, by_azimuth)[:, None, :] @ axes)[:, 0]
        by_zero = np.where(self.is_zenith, 0.0, -1.0)[:, None]
        value = np.where(self.is_zenith, zenith, azimuth) * DEGREES_PER_RADIAN
        residual = (value - self.rows.observed + 180.0) % 360.0 - 180.0
        partials = np.hstack([by_zero, -by_target, by_target]) * DEGREES_PER_RADIAN
        # not a number where the project's system does not reach
        return Linearisation(np.nan_to_num(residual), np.nan_to_num(partials), known)


def observe_directions(block: Block, unknowns: Unknowns) -> DirectionObservations:
    """Return directions and zenith angles; a-priori error 0 is not possible, negative is disregarded."""
    place = block.point_index()
    sets = {theodolite.name: row for row, theodolite in enumerate(block.theodolites)}
    found = [
        (direction, is_zenith, value, error)
        for direction in block.directions
        for is_zenith, value, error in (
            (False, direction.direction, direction.direction_error),
            (True, direction.zenith, direction.zenith_error),
        )
        if value is not None and error is not None
    ]
    station = np.array([place[direction.station] for direction, *_ in found], dtype=np.int64)
    target = np.array([place[direction.target] for direction, *_ in found], dtype=np.int64)
    row = np.array([sets[direction.set] for direction, *_ in found], dtype=np.int64)
    is_zenith = np.array([zenith for _, zenith, *_ in found], dtype=bool)
    error = np.array([error for *_, error in found], dtype=np.float64)
    zero = np.where(is_zenith, CONSTANT, unknowns.theodolites[row] if len(row) else CONSTANT)
    rows = Rows(
        kind=DIRECTION,
        photo=tuple(direction.set for direction, *_ in found),
        point=tuple(f"{direction.station}-{direction.target}" for direction, *_ in found),
        component=tuple("zenith" if zenith else "direction" for _, zenith, *_ in found),
        observed=np.array([value for *_, value, _ in found], dtype=np.float64),
        error=np.abs(error),
        used=error > 0.0,
        columns=np.hstack([zero[:, None], unknowns.points[station], unknowns.points[target]]),
    )
    return DirectionObservations(rows, station, target, row, is_zenith, block.ground)


def tied_by_directions(block: Block) -> frozenset[int]:
    """Return the points that directions tie to each other."""
    place = block.point_index()
    return frozenset(place[name] for direction in block.directions for name in (direction.station, direction.target))


KINDS = (KindEquations(DIRECTION, observe_directions, tied_by_directions),)
