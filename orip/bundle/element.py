"""Control elements: observed values of unknowns, of cameras, photos, points and theodolite sets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orip.bundle.observation import Linearisation, Observations, Rows
from orip.bundle.state import State
from orip.bundle.unknowns import CONSTANT, POINT_COORDINATES, Unknowns
from orip.errors import InputError
from orip.geometry.rotation import angle_rates_from_axes_rotation
from orip.model.block import Block
from orip.model.camera import CAMERA_PARAMETERS
from orip.model.control import ControlElement
from orip.model.names import record_key
from orip.model.photo import PHOTO_PARAMETERS
from orip.units import DEGREES_PER_RADIAN

FloatArray = NDArray[np.float64]

_LEAST_COSINE_OF_PHI = 0.02
"""Nearer to phi = ±90 degrees omega and kappa turn about the same axis, and neither can be observed alone."""


@dataclass(frozen=True, slots=True)
class _Place:
    """Where an element's value is: its group, row and column in the state."""

    group: str
    row: int
    column: int


@dataclass(frozen=True, slots=True)
class ElementObservations(Observations):
    """n observed unknowns; `places` say which. Angles are degrees."""

    rows: Rows
    places: tuple[_Place, ...]

    def linearise_with_partials(self, state: State) -> Linearisation:
        """Return residuals and partials by up to three unknowns: an angle depends on all rotations of its photo.

        Raises
        ------
        InputError
            If an observed rotation comes too near to phi = ±90 degrees.
        """
        angles = state.angles()
        rates = angle_rates_from_axes_rotation(angles) @ state.rotation_basis()
        residual = np.empty(len(self.places))
        partials = np.zeros((len(self.places), 3))
        for index, place in enumerate(self.places):
            if place.group == "PHOTO" and place.column >= 3:
                self._require_tilted(angles[place.row, 1], index)
                value = angles[place.row, place.column - 3] * DEGREES_PER_RADIAN
                partials[index] = rates[place.row, place.column - 3] * DEGREES_PER_RADIAN
            elif place.group == "THEODOLITE":
                value = state.theodolites[place.row] * DEGREES_PER_RADIAN
                partials[index, 0] = DEGREES_PER_RADIAN
            else:
                value = _length(state, place)
                partials[index, 0] = 1.0
            residual[index] = value - self.rows.observed[index]
        residual[self._turning()] = (residual[self._turning()] + 180.0) % 360.0 - 180.0
        return Linearisation(residual, partials, np.ones(len(self.places), dtype=bool))

    def _turning(self) -> NDArray[np.bool_]:
        angular = [each.group == "THEODOLITE" or (each.group == "PHOTO" and each.column >= 3) for each in self.places]
        return np.array(angular, dtype=bool)

    def _require_tilted(self, phi: float, index: int) -> None:
        if abs(np.cos(phi)) < _LEAST_COSINE_OF_PHI:
            message = (
                f"{self.rows.component[index]} of photo {self.rows.photo[index]} is observed, but its phi is within "
                "1.1 degrees of ±90, where omega and kappa cannot be told apart; take the element out of the .ELE file"
            )
            raise InputError.single(message)


def _length(state: State, place: _Place) -> float:
    values = {"CAMERA": state.cameras, "PHOTO": state.centres, "POINT": state.points}[place.group]
    return float(values[place.row, place.column])


def observe_elements(block: Block, unknowns: Unknowns) -> ElementObservations:
    """Return the elements that are observed or disregarded; those with a-priori error 0 are constants of the block."""
    rows = _RowsOfRecords(block)
    found = [
        (element, place)
        for element in block.elements
        if element.error != 0.0 and (place := rows.place(element)) is not None
    ]
    columns = [_columns(place, unknowns) for _, place in found]
    free = np.array([error_allows_use(block, element) for element, _ in found], dtype=bool)
    return ElementObservations(
        Rows(
            kind="element",
            photo=tuple(element.name if element.group == "PHOTO" else "" for element, _ in found),
            point=tuple("" if element.group == "PHOTO" else element.name for element, _ in found),
            component=tuple(element.kind for element, _ in found),
            observed=np.array([element.value for element, _ in found], dtype=np.float64),
            error=np.array([abs(element.error) for element, _ in found], dtype=np.float64),
            used=free,
            columns=np.array(columns, dtype=np.int64).reshape(-1, 3),
        ),
        tuple(place for _, place in found),
    )


def error_allows_use(block: Block, element: ControlElement) -> bool:
    """Whether an element takes part: not disregarded, and not a hold on the ground system of a free network."""
    ties_to_ground = element.group in ("PHOTO", "POINT", "THEODOLITE")
    return element.error > 0.0 and not (ties_to_ground and block.definition.datum == "free")


class _RowsOfRecords:
    """Rows of the state by record or point name."""

    def __init__(self, block: Block) -> None:
        self.rows = {
            "CAMERA": {record_key(each.name): row for row, each in enumerate(block.cameras)},
            "PHOTO": {record_key(each.name): row for row, each in enumerate(block.photos)},
            "THEODOLITE": {each.name: row for row, each in enumerate(block.theodolites)},
            "POINT": block.point_index(),
        }

    def place(self, element: ControlElement) -> _Place | None:
        """Return where an element's value is, or None if the block does not have it."""
        name = record_key(element.name) if element.group in ("CAMERA", "PHOTO") else element.name
        row = self.rows[element.group].get(name)
        return None if row is None else _Place(element.group, row, _KINDS[element.group].index(element.kind))


_KINDS = {
    "CAMERA": CAMERA_PARAMETERS,
    "PHOTO": PHOTO_PARAMETERS,
    "POINT": POINT_COORDINATES,
    "THEODOLITE": ("R",),
}


def _columns(place: _Place, unknowns: Unknowns) -> list[int]:
    if place.group == "PHOTO" and place.column >= 3:
        return [int(column) for column in unknowns.photos[place.row, 3:]]
    table = {
        "CAMERA": unknowns.cameras,
        "PHOTO": unknowns.photos,
        "POINT": unknowns.points,
        "THEODOLITE": unknowns.theodolites[:, None],
    }[place.group]
    return [int(table[place.row, place.column]), CONSTANT, CONSTANT]
