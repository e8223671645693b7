"""The equations of single observations, as the bundle linearises them.

There is no second formula: every kind of observation of `orip.bundle.kinds` comes in by its own linearisation. The
block may be a part of the whole one, a single photo point of it for instance: unknowns are found by their names.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.kinds.all_kinds import KINDS
from orip.bundle.kinds.observation import Observations
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, UnknownName, Unknowns, number_unknowns
from orip.records.block import Block
from orip.records.observations.observation_kinds import (
    ADDITIONAL_PARAMETER,
    ANTENNA_PARAMETER,
    CONSTANT_DISTANCE,
    CONSTANT_ELEMENT,
    DISTANCE,
    ELEMENT,
)
from orip.sequential.hyper_row import ObservationRows

_OF_ONE_COMPONENT = frozenset(
    kind.name
    for kind in (ADDITIONAL_PARAMETER, ANTENNA_PARAMETER, CONSTANT_DISTANCE, CONSTANT_ELEMENT, DISTANCE, ELEMENT)
)
"""Kinds whose components are observations of their own; those of others are measured together."""


class ObservationKey(NamedTuple):
    """What was measured at once: x and y of a photo point, the coordinates of a control point, one element.

    Attributes
    ----------
    kind : str
        Name of its `ObservationKind`.
    photo, point : str
        As residuals.csv names them.
    component : str
        Empty where several belong together.
    repetition : int
        0 for the first of that name.
    """

    kind: str
    photo: str
    point: str
    component: str = ""
    repetition: int = 0


class ReducedColumns:
    """The place of each reduced unknown in the triangle: they are numbered as they first occur."""

    def __init__(self) -> None:
        self.names: list[UnknownName] = []
        self._place: dict[UnknownName, int] = {}

    def places(self, names: tuple[UnknownName, ...]) -> IntArray:
        """Return the places of unknowns; new ones get the next."""
        for name in names:
            if name not in self._place:
                self._place[name] = len(self.names)
                self.names.append(name)
        return np.array([self._place[name] for name in names], dtype=np.int64)

    def known_places(self, names: Sequence[UnknownName]) -> IntArray:
        """Return the places of unknowns, -1 for one that has none."""
        return np.array([self._place.get(name, -1) for name in names], dtype=np.int64)


def tied_points(block: Block) -> frozenset[int]:
    """Return the points of a block that observations tie to each other: their coordinates are reduced unknowns."""
    return frozenset[int]().union(*(kind.tied_points(block) for kind in KINDS))


def linearised(
    block: Block, state: BlockState, tied: Collection[int], columns: ReducedColumns
) -> dict[ObservationKey, ObservationRows]:
    """Return the equations of all observations of a block that are used and can be computed.

    Parameters
    ----------
    block : Block
    state : BlockState
        Where they are linearised; observed minus computed there is their right-hand side.
    tied : collection of int
        Points of the block whose coordinates are reduced unknowns; see `tied_points`.
    columns : ReducedColumns
        Is given the unknowns that are new.
    """
    unknowns = number_unknowns(block, tied)
    places = columns.places(unknowns.names.reduced)
    found: dict[ObservationKey, ObservationRows] = {}
    for kind in KINDS:
        observations = kind.observe(block, unknowns)
        if len(observations.rows.error):
            found.update(_of_kind(observations, state, unknowns, places, block.point_names))
    return found


def _of_kind(
    observations: Observations, state: BlockState, unknowns: Unknowns, places: IntArray, names: tuple[str, ...]
) -> Iterator[tuple[ObservationKey, ObservationRows]]:
    values, rows = observations.linearise_with_partials(state), observations.rows
    used = rows.used & values.computable
    memory = state.memory.get(rows.kind.name, np.zeros(len(rows.error)))
    right = -(values.residual + memory) / rows.error
    partials = values.partials / rows.error[:, None]
    columns = np.asarray(observations.columns(), dtype=np.int64)
    for key, members in _grouped(observations).items():
        chosen = np.array([row for row in members if used[row]], dtype=np.int64)
        if len(chosen):
            equations = _Equations(columns[chosen], partials[chosen], right[chosen])
            yield key, _separated(equations, unknowns, places, names, observations.exact)


def _grouped(observations: Observations) -> Mapping[ObservationKey, list[int]]:
    """Return the rows of each observation."""
    rows, groups = observations.rows, dict[ObservationKey, list[int]]()
    seen: dict[tuple[str, str, str], int] = {}
    by_itself = rows.kind.name in _OF_ONE_COMPONENT
    for row, (photo, point, component) in enumerate(zip(rows.photo, rows.point, rows.component, strict=True)):
        repetition = seen.get((photo, point, component), 0)
        seen[photo, point, component] = repetition + 1
        key = ObservationKey(rows.kind.name, photo, point, component if by_itself else "", repetition)
        groups.setdefault(key, []).append(row)
    return groups


class _Equations(NamedTuple):
    """Equations of one observation: columns (k, c) of the block, partials (k, c) and right-hand sides (k,)."""

    columns: IntArray
    partials: FloatArray
    right: FloatArray


def _separated(
    equations: _Equations, unknowns: Unknowns, places: IntArray, names: tuple[str, ...], exact: bool
) -> ObservationRows:
    """Return equations with the partials by their point and those by reduced unknowns apart."""
    reduced = unknowns.layout.reduced
    row, at = np.nonzero(equations.columns != CONSTANT)
    column, value = equations.columns[row, at], equations.partials[row, at]
    of_point = column >= reduced
    by_point, point = np.zeros((len(equations.right), 3)), None
    if of_point.any():
        place = column[of_point] - reduced
        by_point[row[of_point], place % 3] = value[of_point]
        point = names[int(unknowns.names.eliminated[place[0] // 3])]
    of_reduced = places[column[~of_point]]
    touched = np.unique(of_reduced)
    by_reduced = np.zeros((len(equations.right), len(touched)))
    np.add.at(by_reduced, (row[~of_point], np.searchsorted(touched, of_reduced)), value[~of_point])
    return ObservationRows(point, by_point, touched, by_reduced, equations.right, exact)
