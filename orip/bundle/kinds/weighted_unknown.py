"""Weighted unknowns: additional parameters, antenna parameters, and motions of photos with rolling shutters.

What is known of them before the adjustment is observed: zero, or the a-priori value, with an a-priori error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.bundle.antennas import NONE, name_of_stretch, station_places
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.known_motions import motion_errors
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.interior.additional_parameters import PARAMETER_SETS, base_of_camera, default_error
from orip.records.block import Block
from orip.records.camera import READOUT
from orip.records.definition import ANTENNA_PARAMETERS, BORESIGHT, DRIFT, MOTION_PARAMETERS, SHIFT
from orip.records.observation_kinds import ADDITIONAL_PARAMETER, ANTENNA_PARAMETER, MOTION
from orip.units import DEGREES_PER_RADIAN


class AdditionalParameterObservations(Observations, frozen=True):
    """n parameters observed as zero; `camera` and `parameter` (n,) say which."""

    rows: Rows
    camera: NDArray[np.int64]
    parameter: NDArray[np.int64]

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return the values themselves and partials by them."""
        residual = state.additional[self.camera, self.parameter]
        return Linearisation(residual, np.ones((len(residual), 1)), np.ones(len(residual), dtype=bool))


def observe_additional_parameters(block: Block, unknowns: Unknowns) -> AdditionalParameterObservations:
    """Return the unknown parameters of all cameras that have a set."""
    found = [
        (row, parameter, name)
        for row, camera in enumerate(block.cameras)
        if camera.additional_set is not None
        for parameter, name in enumerate(PARAMETER_SETS[camera.additional_set].parameter_names)
        if (camera.name, name) not in block.held_additional
    ]
    camera = np.array([row for row, *_ in found], dtype=np.int64)
    parameter = np.array([index for _, index, _ in found], dtype=np.int64)
    errors = [_error(block, row, index) for row, index, _ in found]
    rows = Rows(
        kind=ADDITIONAL_PARAMETER,
        photo=("",) * len(found),
        point=tuple(block.cameras[row].name for row in camera),
        component=tuple(name for *_, name in found),
        observed=np.zeros(len(found)),
        error=np.array(errors, dtype=np.float64),
        used=np.ones(len(found), dtype=bool),
        columns=unknowns.additional[camera, parameter][:, None],
    )
    return AdditionalParameterObservations(rows, camera, parameter)


def _error(block: Block, row: int, parameter: int) -> float:
    camera = block.cameras[row]
    assert camera.additional_set is not None
    mine = block.photo_camera[block.photo_points.photo] == row
    photo_error = float(np.mean(block.photo_points.error[mine])) if mine.any() else 1.0
    return default_error(camera.additional_set, parameter, base_of_camera(camera), photo_error)


class _Known(NamedTuple):
    """What is known of an unknown: its table, row and column, its name, component, value and a-priori error."""

    table: str
    row: int
    column: int
    name: str
    component: str
    value: float
    error: float


class AntennaParameterObservations(Observations, frozen=True):
    """n a-priori values; `table`, `row` and `column` (n,) say of what. Those of the boresight are degrees."""

    rows: Rows
    table: NDArray[np.str_]
    row: IntArray
    column: IntArray

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals and partials by the parameters themselves."""
        value = np.zeros(len(self.row))
        for name, table in (("antennas", state.antennas), ("shifts", state.shifts), ("drifts", state.drifts)):
            mine = self.table == name
            value[mine] = table[self.row[mine], self.column[mine]]
        unit = np.where(np.isin(np.array(self.rows.component), BORESIGHT), DEGREES_PER_RADIAN, 1.0)
        return Linearisation(unit * value - self.rows.observed, unit[:, None], np.ones(len(value), dtype=bool))


def observe_antenna_parameters(block: Block, unknowns: Unknowns) -> AntennaParameterObservations:
    """Return the unknown antenna parameters, shifts and drifts that have an a-priori error."""
    known = list(_known(block, unknowns))
    tables = {"antennas": unknowns.antennas, "shifts": unknowns.shifts, "drifts": unknowns.drifts}
    columns = [tables[found.table][found.row, found.column] for found in known]
    rows = Rows(
        kind=ANTENNA_PARAMETER,
        photo=("",) * len(known),
        point=tuple(found.name for found in known),
        component=tuple(found.component for found in known),
        observed=np.array([found.value for found in known], dtype=np.float64),
        error=np.array([found.error for found in known], dtype=np.float64),
        used=np.ones(len(known), dtype=bool),
        columns=np.array(columns, dtype=np.int64).reshape(-1, 1),
    )
    return AntennaParameterObservations(
        rows,
        np.array([found.table for found in known], dtype=np.str_),
        np.array([found.row for found in known], dtype=np.int64),
        np.array([found.column for found in known], dtype=np.int64),
    )


def _known(block: Block, unknowns: Unknowns) -> Iterator[_Known]:
    places = station_places(block)
    for row, antenna in enumerate(block.antennas):
        yield from _of_table(
            "antennas", unknowns, row, antenna.name, ANTENNA_PARAMETERS, antenna.values, antenna.errors
        )
    for table, stretches, kinds in (("shifts", places.shifts, SHIFT), ("drifts", places.drifts, DRIFT)):
        for row, stretch in enumerate(stretches):
            antenna = block.antennas[stretch.antenna]
            errors = antenna.shift_error if table == "shifts" else antenna.drift_error
            name = name_of_stretch(antenna, stretch)
            yield from _of_table(table, unknowns, row, name, kinds, (0.0,) * 3, errors or (None,) * 3)


def _of_table(
    table: str, unknowns: Unknowns, row: int, name: str, kinds: Sequence[str], values: Sequence[float],
    errors: Sequence[float | None],
) -> Iterator[_Known]:  # fmt: skip
    columns: FloatArray = getattr(unknowns, table)[row]
    for column, (kind, value, error) in enumerate(zip(kinds, values, errors, strict=True)):
        if columns[column] != CONSTANT and error is not None:
            yield _Known(table, row, column, name, kind, value, error)


_SHORTEST = 1e-5
"""Seconds: in less nothing moves."""

_UNIT = np.repeat([1.0, DEGREES_PER_RADIAN], 3)


class MotionObservations(Observations, frozen=True):
    """n corrections observed as zero; `photo` and `parameter` (n,) say which. Those of angular rates are degrees.

    Unknown is what a correction makes during the readout. The correction itself depends on the readout where a station
    has observed the motion: as if it did not, errors of motions would make the readout too short (errors in variables).
    The errors of the bundle say how far motions are from what neighbours show, and that is so whatever the readout is.

    Parameters
    ----------
    camera : array (n,) of int
        Whose readout a correction depends on; `NONE`: it is as in the iteration before.
    """

    rows: Rows
    photo: IntArray
    parameter: IntArray
    camera: IntArray

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return the corrections and their partials by what they make during the readout, and by the readout."""
        depends = self.camera != NONE
        readout = np.where(depends, state.cameras[self.camera, READOUT], state.readouts[self.photo])
        unit: FloatArray = _UNIT[self.parameter] / np.maximum(np.abs(readout), _SHORTEST)
        residual = unit * state.motion_corrections[self.photo, self.parameter]
        by_readout = np.zeros_like(residual)
        depends &= np.abs(readout) > _SHORTEST
        by_readout[depends] = -residual[depends] / readout[depends]
        return Linearisation(residual, np.column_stack([unit, by_readout]), np.ones(len(residual), dtype=bool))


def observe_motions(block: Block, unknowns: Unknowns) -> MotionObservations:
    """Return the unknown motions of all photos."""
    photo, parameter = np.nonzero(unknowns.motions != CONSTANT)
    errors = motion_errors(block)
    camera = np.where(errors.are_observed[photo, parameter], block.photo_camera[photo], NONE)
    of_readout = np.where(camera == NONE, CONSTANT, unknowns.cameras[camera, READOUT])
    rows = Rows(
        kind=MOTION,
        photo=tuple(block.photos[row].name for row in photo),
        point=("",) * len(photo),
        component=tuple(MOTION_PARAMETERS[place] for place in parameter),
        observed=np.zeros(len(photo)),
        error=errors.values[photo, parameter],
        used=np.ones(len(photo), dtype=bool),
        columns=np.column_stack([unknowns.motions[photo, parameter], of_readout]),
    )
    return MotionObservations(rows, photo, parameter, camera)


KINDS = (
    KindEquations(ADDITIONAL_PARAMETER, observe_additional_parameters),
    KindEquations(ANTENNA_PARAMETER, observe_antenna_parameters),
    KindEquations(MOTION, observe_motions),
)
