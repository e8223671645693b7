"""Control elements: observed values of unknowns, of cameras, photos, points and theodolite sets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.bundle.kinds.observation import (
    ExactObservations,
    KindEquations,
    Linearisation,
    Observations,
    Rows,
    columns_of_coordinates,
    coordinates_with_partials,
    error_of_constant_angles,
    error_of_constant_lengths,
)
from orip.bundle.kinds.station_attitude import require_separable_angles, rotation_residuals_with_partials
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, POINT_COORDINATES, Unknowns
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.control import ControlElement
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.records.observation_kinds import CONSTANT_ELEMENT, ELEMENT, ObservationKind
from orip.records.photo import PHOTO_PARAMETERS
from orip.units import DEGREES_PER_RADIAN


class _Place(NamedTuple):
    """Where an element's value is: its quantity, row and column in the state."""

    quantity: str
    row: int
    column: int


class ElementObservations(Observations, frozen=True):
    """n observed unknowns; `quantity`, `row` and `column` (n,) say which. Angles are degrees.

    `rotation` (number of photos, 3) has the angles that are observed or constant, degrees; NaN for others.
    """

    rows: Rows
    quantity: NDArray[np.str_]
    row: IntArray
    column: IntArray
    rotation: FloatArray
    ground: GroundSystem

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals and partials by up to three unknowns.

        An angle depends on all rotation unknowns of its photo, a coordinate of the project on all local coordinates of
        its position. The project's axes turn slightly when a projection centre moves, by the shift over the earth's
        radius; the partials neglect this. Near phi = ±90 degrees the residuals of the three angles of a photo are small
        rotations about the project's axes.

        Raises
        ------
        InputError
            If a photo with one or two observed angles has a phi too close to ±90 degrees.
        """
        residual, partials = np.full(len(self.row), np.nan), np.zeros((len(self.row), 3))
        for quantity, evaluate in _EVALUATION.items():
            chosen = self.quantity == quantity
            if chosen.any():
                value, partials[chosen] = evaluate(self.ground, state, self.row[chosen], self.column[chosen])
                residual[chosen] = value - self.rows.observed[chosen]
        sets = self.quantity == "theodolite"
        residual[sets] = (residual[sets] + 180.0) % 360.0 - 180.0
        turning = np.flatnonzero(self.quantity == "rotation")
        if len(turning):
            residual[turning], partials[turning] = self._turns(state, turning)
        known = np.isfinite(residual)
        return Linearisation(np.where(known, residual, 0.0), np.where(known[:, None], partials, 0.0), known)

    def _turns(self, state: BlockState, chosen: IntArray) -> tuple[FloatArray, FloatArray]:
        row, column = self.row[chosen], self.column[chosen]
        axes = self.ground.axes_at(self.ground.to_project(state.centres[row]))
        residual, rates, inseparable = rotation_residuals_with_partials(axes @ state.rotations[row], self.rotation[row])
        places = chosen[inseparable & self.rows.used[chosen]]
        require_separable_angles([f"{self.rows.component[row]} of photo {self.rows.photo[row]}" for row in places])
        rows = np.arange(len(row))
        return residual[rows, column], (rates @ axes @ state.rotation_basis()[row])[rows, column]


class ConstantElementObservations(ExactObservations, ElementObservations, frozen=True):
    """Elements that are constant in the project, but depend on unknowns in the local frame."""


_Values = tuple[FloatArray, FloatArray]
"""Values (n,) of elements, and partials (n, 3)."""


def _camera_values(_: GroundSystem, state: BlockState, row: IntArray, column: IntArray) -> _Values:
    return state.cameras[row, column], np.broadcast_to([1.0, 0.0, 0.0], (len(row), 3))


def _theodolite_values(_: GroundSystem, state: BlockState, row: IntArray, __: IntArray) -> _Values:
    partials = np.broadcast_to([DEGREES_PER_RADIAN, 0.0, 0.0], (len(row), 3))
    return state.theodolites[row] * DEGREES_PER_RADIAN, partials


def _centre_values(ground: GroundSystem, state: BlockState, row: IntArray, column: IntArray) -> _Values:
    found = coordinates_with_partials(ground, state.centres[row], column)
    return np.where(found.known, found.value, np.nan), found.by_local


def _point_values(ground: GroundSystem, state: BlockState, row: IntArray, column: IntArray) -> _Values:
    found = coordinates_with_partials(ground, state.points[row], column)
    return np.where(found.known, found.value, np.nan), found.by_local


_EVALUATION: Mapping[str, Callable[[GroundSystem, BlockState, IntArray, IntArray], _Values]] = {
    "camera": _camera_values,
    "theodolite": _theodolite_values,
    "centre": _centre_values,
    "point": _point_values,
}


def observe_elements(block: Block, unknowns: Unknowns) -> ElementObservations:
    """Return the elements that are observed or disregarded; those with a-priori error 0 are constants of the block."""
    places = _Places(block)
    chosen = [element for element in block.elements if element.error != 0.0 and places.has(element)]
    error = np.array([abs(element.error) for element in chosen], dtype=np.float64)
    used = np.array([error_allows_use(block, element) for element in chosen], dtype=bool)
    return ElementObservations(*_observed(block, unknowns, chosen, ELEMENT, error, used))


def observe_constant_elements(block: Block, unknowns: Unknowns) -> ConstantElementObservations:
    """Return the elements that are met exactly."""
    chosen = block.constant_elements
    error = np.ones(len(chosen))
    if chosen:
        angular = np.array([element.kind in PHOTO_PARAMETERS[3:] for element in chosen])
        of_angle = error_of_constant_angles(block) * DEGREES_PER_RADIAN
        error = np.where(angular, of_angle, error_of_constant_lengths(block))
    used = np.ones(len(chosen), dtype=bool)
    return ConstantElementObservations(*_observed(block, unknowns, chosen, CONSTANT_ELEMENT, error, used))


def bound_by_elements(block: Block) -> frozenset[int]:
    """Return the points that constant elements bind: they stay in the reduced system, as all exact constraints do."""
    place = block.point_index()
    return frozenset(place[element.name] for element in block.constant_elements if element.group == "POINT")


def _observed(
    block: Block, unknowns: Unknowns, chosen: Sequence[ControlElement], kind: ObservationKind, error: FloatArray,
    used: NDArray[np.bool_],
) -> tuple[Rows, NDArray[np.str_], IntArray, IntArray, FloatArray, GroundSystem]:  # fmt: skip
    places = _Places(block)
    found = [places.of(element) for element in chosen]
    columns = [_columns(place, unknowns, block.ground) for place in found]
    rows = Rows(
        kind=kind,
        photo=tuple(
            block.photos[place.row].name if element.group == "PHOTO" else ""  # in whatever case it is written there
            for element, place in zip(chosen, found, strict=True)
        ),
        point=tuple("" if element.group == "PHOTO" else element.name for element in chosen),
        component=tuple(element.kind for element in chosen),
        observed=np.array([element.value for element in chosen], dtype=np.float64),
        error=error,
        used=used,
        columns=np.array(columns, dtype=np.int64).reshape(-1, 3),
    )
    return (
        rows,
        np.array([place.quantity for place in found], dtype=np.str_),
        np.array([place.row for place in found], dtype=np.int64),
        np.array([place.column for place in found], dtype=np.int64),
        _observed_rotations(block),
        block.ground,
    )


def _observed_rotations(block: Block) -> FloatArray:
    """Return omega, phi and kappa (number of photos, 3) as elements give them, or as they are constant; degrees."""
    row_of = {record_key(photo.name): row for row, photo in enumerate(block.photos)}
    angles = np.full((len(block.photos), 3), np.nan)
    for row, photo in enumerate(block.photos):
        for axis, kind in enumerate(PHOTO_PARAMETERS[3:]):
            if kind in photo.constant:
                angles[row, axis] = photo.orientation[3 + axis]
    for element in (*block.elements, *block.constant_elements):
        if element.group == "PHOTO" and element.kind in PHOTO_PARAMETERS[3:]:
            key = record_key(element.name)
            if key in row_of:
                angles[row_of[key], PHOTO_PARAMETERS.index(element.kind) - 3] = element.value
    return angles


def error_allows_use(block: Block, element: ControlElement) -> bool:
    """Return whether an element is used: not disregarded, nor fixing the ground system of a free network."""
    ties_to_ground = element.group in ("PHOTO", "POINT", "THEODOLITE")
    return element.error > 0.0 and not (ties_to_ground and block.is_free_network)


class _Places:
    """Places in the state by record or point name."""

    def __init__(self, block: Block) -> None:
        self.rows = {
            "CAMERA": {record_key(camera.name): row for row, camera in enumerate(block.cameras)},
            "PHOTO": {record_key(photo.name): row for row, photo in enumerate(block.photos)},
            "THEODOLITE": {theodolite.name: row for row, theodolite in enumerate(block.theodolites)},
            "POINT": block.point_index(),
        }

    def has(self, element: ControlElement) -> bool:
        """Return whether the block has the record or point of an element."""
        return self._name(element) in self.rows[element.group]

    def of(self, element: ControlElement) -> _Place:
        """Return where an element's value is."""
        row = self.rows[element.group][self._name(element)]
        if element.group == "PHOTO":
            column = PHOTO_PARAMETERS.index(element.kind)
            return _Place("centre", row, column) if column < 3 else _Place("rotation", row, column - 3)
        return _Place(element.group.lower(), row, _KINDS[element.group].index(element.kind))

    @staticmethod
    def _name(element: ControlElement) -> str:
        return record_key(element.name) if element.group in ("CAMERA", "PHOTO") else element.name


_KINDS = {"CAMERA": CAMERA_PARAMETERS, "POINT": POINT_COORDINATES, "THEODOLITE": ("R",)}


def _columns(place: _Place, unknowns: Unknowns, ground: GroundSystem) -> IntArray:
    """Return the unknowns (3,) that an element depends on."""
    if place.quantity == "rotation":
        return np.asarray(unknowns.elements[place.row, 3:])
    if place.quantity in ("centre", "point"):
        table = unknowns.elements[:, :3] if place.quantity == "centre" else unknowns.points
        return np.asarray(columns_of_coordinates(ground, table[[place.row]], np.array([place.column]))[0])
    column = (
        unknowns.cameras[place.row, place.column] if place.quantity == "camera" else unknowns.theodolites[place.row]
    )
    return np.array([column, CONSTANT, CONSTANT])


KINDS = (
    KindEquations(ELEMENT, observe_elements),
    KindEquations(CONSTANT_ELEMENT, observe_constant_elements, bound_by_elements),
)
