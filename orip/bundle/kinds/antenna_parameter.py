"""A-priori values of unknown antenna parameters, shifts and drifts: what is known of them before the adjustment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.bundle.antennas import name_of_stretch, station_places
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.records.block import Block
from orip.records.definition import ANTENNA_PARAMETERS, BORESIGHT, DRIFT, SHIFT
from orip.records.observation_kinds import ANTENNA_PARAMETER
from orip.units import DEGREES_PER_RADIAN


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


KINDS = (KindEquations(ANTENNA_PARAMETER, observe_antenna_parameters),)
