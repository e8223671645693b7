"""Control points: observed ground coordinates, each with its own a-priori error, or with correlated ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.correlated_rows import (
    CorrelatedRows,
    as_observed,
    correlated_rows,
    decorrelated,
    with_last,
)
from orip.bundle.kinds.observation import (
    KindEquations,
    Linearisation,
    Observations,
    Rows,
    columns_of_coordinates,
    coordinates_with_partials,
)
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, POINT_COORDINATES, Unknowns
from orip.records.block import Block
from orip.records.control import PointCorrelation
from orip.records.ground import GroundSystem
from orip.records.observation_kinds import CONTROL_POINT
from orip.structs import replace

ScalarT = TypeVar("ScalarT", bound=np.generic)


class ControlPointObservations(Observations, frozen=True):
    """n observed coordinates of the project; `point` and `coordinate` (0, 1, 2) say which.

    `correlated` has those whose errors are, `place` (n,) the place of each one's point in its group.
    """

    rows: Rows
    point: NDArray[np.int64]
    coordinate: NDArray[np.int64]
    ground: GroundSystem
    correlated: tuple[CorrelatedRows, ...] = ()
    place: NDArray[np.int64] | None = None

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (ground unit) and partials by the coordinates of the point, or of those of its group."""
        found = coordinates_with_partials(self.ground, state.points[self.point], self.coordinate)
        residual = np.where(found.known, found.value - self.rows.observed, 0.0)
        if self.place is None:
            return Linearisation(residual, found.by_local, found.known)
        error, known = self.rows.error, found.known.copy()
        partials = _spread(found.by_local, self.place, self.columns().shape[1], 0.0)
        for group in self.correlated:
            own = error[group.rows]
            partials[group.rows] = own[:, None] * (group.whitening @ (partials[group.rows] / own[:, None]))
            known[group.rows] = found.known[group.rows].all()
        return Linearisation(decorrelated(self.correlated, error, residual), partials, known)

    def as_observed(self, residual: FloatArray, others: Mapping[str, FloatArray]) -> FloatArray:
        """Return the residuals (n,) of the coordinates from those of the equations."""
        del others
        return as_observed(self.correlated, self.rows.error, residual)

    def correlations(self) -> tuple[CorrelatedRows, ...]:
        """Return the coordinates whose errors are correlated."""
        return self.correlated

    def with_left_out(self, left_out: BoolArray) -> ControlPointObservations:
        """Return the observations with equations that are free of the errors of some of them (n,)."""
        return replace(self, correlated=with_last(self.correlated, left_out)) if self.correlated else self

    def groups(self) -> IntArray | None:
        """Return the points (n,) of coordinates with correlated errors, which lose weight together; -1: alone."""
        if not self.correlated:
            return None
        found = np.full(len(self.point), -1)
        rows = np.concatenate([group.rows for group in self.correlated])
        found[rows] = np.unique(self.point[rows], return_inverse=True)[1]
        return found


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
    used = (error > 0.0) & (not block.is_free_network)
    correlated = _correlated(block, point, coordinate, used)
    columns, places = columns_of_coordinates(block.ground, unknowns.points[point], coordinate), None
    if correlated:
        columns, places = _columns_of_groups(correlated, point, columns)
    rows = Rows(
        kind=CONTROL_POINT,
        photo=("",) * len(found),
        point=tuple(block.point_names[index] for index in point),
        component=tuple(POINT_COORDINATES[index] for index in coordinate),
        observed=np.array([row[2] for row in found], dtype=np.float64),
        error=np.abs(error),
        used=used,
        columns=columns,
    )
    return ControlPointObservations(rows, point, coordinate, block.ground, correlated, places)


def tied_by_correlations(block: Block) -> frozenset[int]:
    """Return the points whose errors are correlated with those of other points."""
    place = block.point_index()
    return frozenset(place[name] for pair in _pairs(block) for name in (pair.first, pair.second))


def _pairs(block: Block) -> list[PointCorrelation]:
    """Return the correlations of control points that the block has; it may be a part of the one they were given for."""
    if not block.control_correlations:
        return []
    known = {point.name for point in block.control_points if not point.rejected}
    return [pair for pair in block.control_correlations if {pair.first, pair.second} <= known]


def _correlated(block: Block, point: IntArray, coordinate: IntArray, used: BoolArray) -> tuple[CorrelatedRows, ...]:
    """Return the groups of rows (n,) whose errors are correlated."""
    own, pairs = [one for one in block.control_points if one.correlations is not None], _pairs(block)
    if not (own or pairs):
        return ()
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    place = block.point_index()
    row_of = {key: row for row, key in enumerate(zip(point.tolist(), coordinate.tolist(), strict=True))}
    coefficients: dict[tuple[int, int], float] = {}

    def put(first: int, second: int, matrix: tuple[tuple[float, float, float], ...]) -> None:
        for a, of_axis in enumerate(matrix):
            for b, r in enumerate(of_axis):
                one, other = row_of.get((first, a)), row_of.get((second, b))
                if one is not None and other is not None and one != other and r != 0.0:
                    coefficients[one, other] = coefficients[other, one] = r

    for control in own:
        rxy, rxz, ryz = control.correlations or (0.0, 0.0, 0.0)
        put(place[control.name], place[control.name], ((1.0, rxy, rxz), (rxy, 1.0, ryz), (rxz, ryz, 1.0)))
    for pair in pairs:
        put(place[pair.first], place[pair.second], pair.coefficients)
    if not coefficients:
        return ()
    at = np.array(list(coefficients), dtype=np.int64)
    matrix = coo_array((np.array(list(coefficients.values())), (at[:, 0], at[:, 1])), shape=(len(point),) * 2).tocsr()
    # the coordinates of a point are together, so that they lose weight and are left out together
    together = coo_array((np.ones(len(point)), (np.arange(len(point)), point)), shape=(len(point), point.max() + 1))
    number = connected_components(abs(matrix) + together @ together.T, directed=False)[1]
    counts, involved = np.bincount(number), np.unique(number[at[:, 0]])
    return tuple(
        correlated_rows(rows, np.eye(len(rows)) + matrix[rows][:, rows].toarray(), used[rows])
        for group in involved[counts[involved] > 1].tolist()
        for rows in [np.flatnonzero(number == group)]
    )


def _columns_of_groups(
    correlated: tuple[CorrelatedRows, ...], point: IntArray, columns: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the unknowns (n, 3 k) of equations with up to k points, and the place (n,) of each row's point."""
    place, sizes = np.zeros(len(point), dtype=np.int64), [1]
    for group in correlated:
        points, place[group.rows] = np.unique(point[group.rows], return_inverse=True)
        sizes.append(len(points))
    spread = _spread(columns, place, 3 * max(sizes), CONSTANT)
    for group in correlated:
        spread[group.rows] = spread[group.rows].max(axis=0)
    return spread, place


def _spread(values: NDArray[ScalarT], place: IntArray, width: int, filled: float) -> NDArray[ScalarT]:
    """Return values (n, 3) at the places (n,) of points in rows (n, width) that are filled otherwise."""
    found = np.full((len(values), width), filled, dtype=values.dtype)
    found[np.arange(len(values))[:, None], 3 * place[:, None] + np.arange(3)] = values
    return found


KINDS = (KindEquations(CONTROL_POINT, observe_control_points, tied_by_correlations),)
