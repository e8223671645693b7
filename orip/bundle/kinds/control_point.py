"""Control points: observed ground coordinates, each with its own a-priori error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.bundle.kinds.observation import (
    KindEquations,
    Linearisation,
    Observations,
    Rows,
    columns_of_coordinates,
    coordinates_with_partials,
)
from orip.bundle.state import BlockState
from orip.bundle.unknowns import POINT_COORDINATES, Unknowns
from orip.records.block import Block
from orip.records.ground import GroundSystem
from orip.records.observation_kinds import CONTROL_POINT


class ControlPointObservations(Observations, frozen=True):
    """n observed coordinates of the project; `point` and `coordinate` (0, 1, 2) say which."""

    rows: Rows
    point: NDArray[np.int64]
    coordinate: NDArray[np.int64]
    ground: GroundSystem

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (ground unit) and partials by the point's three coordinates."""
        found = coordinates_with_partials(self.ground, state.points[self.point], self.coordinate)
        residual = np.where(found.known, found.value - self.rows.observed, 0.0)
        return Linearisation(residual, found.by_local, found.known)


def observe_control_points(block: Block, unknowns: Unknowns) -> ControlPointObservations:
    """Return the weighted and the disregarded coordinates of control and check points as observations."""
    place = block.point_index()
    found = [
        (place[point.name], coordinate, value, error)
        for point in block.control_points
        if not point.rejected
        for coordinate, (value, error) in enumerate(zip(point.coordinates, point.errors, strict=True))
        if value is not None and error is not None and error != 0.0
    ]
    point = np.array([row[0] for row in found], dtype=np.int64)
    coordinate = np.array([row[1] for row in found], dtype=np.int64)
    error = np.array([row[3] for row in found], dtype=np.float64)
    rows = Rows(
        kind=CONTROL_POINT,
        photo=("",) * len(found),
        point=tuple(block.point_names[index] for index in point),
        component=tuple(POINT_COORDINATES[index] for index in coordinate),
        observed=np.array([row[2] for row in found], dtype=np.float64),
        error=np.abs(error),
        used=(error > 0.0) & (not block.is_free_network),
        columns=columns_of_coordinates(block.ground, unknowns.points[point], coordinate),
    )
    return ControlPointObservations(rows, point, coordinate, block.ground)


KINDS = (KindEquations(CONTROL_POINT, observe_control_points),)
