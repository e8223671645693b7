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
from orip.online.sequential.hyper_rows import ObservationRows
from orip.records.block import Block
from orip.records.observation_kinds import (
    ADDITIONAL_PARAMETER,
    ANTENNA_PARAMETER,
    CONSTANT_DISTANCE,
    CONSTANT_ELEMENT,
    DISTANCE,
    ELEMENT,
)

_OF_ONE_COMPONENT = frozenset(
    kind.name
    for kind in (ADDITIONAL_PARAMETER, ANTENNA_PARAMETER, CONSTANT_DISTANCE, CONSTANT_ELEMENT, DISTANCE, ELEMENT)
)
"""Kinds whose components are observations of their own; those of others are measured together."""

_BEYOND = np.iinfo(np.int64).max
"""A column after all others."""


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
    used = (rows.used & values.computable).tolist()
    memory = state.memory.get(rows.kind.name, np.zeros(len(rows.error)))
    right = -(values.residual + memory) / rows.error
    partials = values.partials / rows.error[:, None]
    separated = _separated(np.asarray(observations.columns(), dtype=np.int64), partials, unknowns, places)
    for key, members in _grouped(observations).items():
        chosen = [row for row in members if used[row]]
        if chosen:
            point = separated.point[chosen[0]]
            columns, by_reduced = separated.by_reduced(chosen)
            rows_of_it = _slice_of(chosen)
            yield key, ObservationRows(
                None if point < 0 else names[point],
                separated.by_point[rows_of_it], columns, by_reduced, right[rows_of_it], observations.exact,
            )  # fmt: skip


def _slice_of(rows: list[int]) -> slice | list[int]:
    """Return rows as a slice where they follow each other, as most do: that is quicker."""
    return slice(rows[0], rows[-1] + 1) if rows[-1] - rows[0] + 1 == len(rows) else rows


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


class _Separated(NamedTuple):
    """Partials of m equations by their points, and by reduced unknowns, the equations' columns sorted.

    Attributes
    ----------
    point : list of m int
        -1: an equation of reduced unknowns alone.
    by_point : array (m, 3)
    columns, partials : arrays (m, k)
        Places in the triangle, ascending, and `_BEYOND` after the last one.
    length : list of m int
        How many each equation touches.
    is_distinct : list of m bool
        Whether it touches each of them once.
    is_like_next : list of m bool
        Whether the next equation touches the same ones.
    """

    point: list[int]
    by_point: FloatArray
    columns: IntArray
    partials: FloatArray
    length: list[int]
    is_distinct: list[bool]
    is_like_next: list[bool]

    def by_reduced(self, rows: list[int]) -> tuple[IntArray, FloatArray]:
        """Return the columns (c,) that some equations touch, and their partials (k, c)."""
        together, length = _slice_of(rows), self.length[rows[0]]
        is_alike = isinstance(together, slice) and all(self.is_like_next[together.start : together.stop - 1])
        if is_alike and self.is_distinct[rows[0]]:
            return self.columns[rows[0], :length], self.partials[together, :length]
        touched = np.unique(self.columns[rows])
        touched = touched[touched < _BEYOND]
        found = np.zeros((len(rows), len(touched)))
        for into, row in zip(found, rows, strict=True):
            mine = slice(self.length[row])
            np.add.at(into, np.searchsorted(touched, self.columns[row, mine]), self.partials[row, mine])
        return touched, found


def _separated(columns: IntArray, partials: FloatArray, unknowns: Unknowns, places: IntArray) -> _Separated:
    """Return equations with the partials by their point and those by reduced unknowns apart."""
    reduced = unknowns.layout.reduced
    row, at = np.nonzero(columns >= reduced)
    place = columns[row, at] - reduced
    by_point, point = np.zeros((len(columns), 3)), np.full(len(columns), -1, dtype=np.int64)
    by_point[row, place % 3] = partials[row, at]
    point[row] = unknowns.names.eliminated[place // 3]
    is_reduced = (columns != CONSTANT) & (columns < reduced)
    found = np.full(columns.shape, _BEYOND, dtype=np.int64)
    found[is_reduced] = places[columns[is_reduced]]
    order = np.argsort(found, axis=1, kind="stable")
    # one more, which none touches, ends the longest
    ended = np.pad(np.take_along_axis(found, order, axis=1), ((0, 0), (0, 1)), constant_values=_BEYOND)
    is_distinct = ((ended[:, 1:] > ended[:, :-1]) | (ended[:, 1:] == _BEYOND)).all(axis=1)
    is_like_next = np.append((ended[1:] == ended[:-1]).all(axis=1), False)
    return _Separated(
        point.tolist(),
        by_point,
        ended,
        np.take_along_axis(partials, order, axis=1),
        is_reduced.sum(axis=1).tolist(),
        is_distinct.tolist(),
        is_like_next.tolist(),
    )
