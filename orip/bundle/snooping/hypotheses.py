"""What may be wrong: observations that one mistake spoils together, of all kinds that have an a-priori error.

- a photo point: x and y;
- a control point: its weighted coordinates;
- a control element; and together those of one projection centre, rotation or point;
- a direction or a zenith angle; both to one target; and all of a theodolite set;
- the position of an exposure station; its attitude;
- a distance, and an observation of any other kind, by itself.

Constants are no observations, and neither the zeros that additional parameters are observed to be nor the a-priori
values of an antenna are measurements that would be left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, IntArray
from orip.bundle.kinds.additional_parameter import AdditionalParameterObservations
from orip.bundle.kinds.antenna_parameter import AntennaParameterObservations
from orip.bundle.kinds.control_point import ControlPointObservations
from orip.bundle.kinds.direction import DirectionObservations
from orip.bundle.kinds.element import ElementObservations
from orip.bundle.kinds.observation import Observations
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.kinds.station_attitude import AttitudeObservations
from orip.bundle.kinds.station_position import PositionObservations


class Hypotheses(Struct, frozen=True):
    """Groups of observations that may be wrong; one observation may be in several.

    Parameters
    ----------
    rows : tuple of tuples of int
        Observations of each group, among all of the block.
    by_component : array of bool
        Photo points: tested by the larger w of x and y. All others are tested as a whole.
    in_one_place : array of bool
        The rows depend on the unknowns of one photo or one point.
    """

    rows: tuple[tuple[int, ...], ...]
    by_component: BoolArray
    in_one_place: BoolArray

    def __len__(self) -> int:
        return len(self.rows)


def hypotheses_of(observations: Iterable[Observations]) -> Hypotheses:
    """Return what may be wrong in all observations of a block that are used."""
    rows: list[tuple[int, ...]] = []
    of_kind: list[tuple[int, Observations]] = []
    first = 0
    for kind in observations:
        found = _used(_groups(kind), kind.rows.used, first)
        rows += found
        of_kind.append((len(found), kind))
        first += len(kind.rows.photo)
    counts = [count for count, _ in of_kind]
    photo_points = [isinstance(kind, PhotoPointObservations) for _, kind in of_kind]
    local = [isinstance(kind, (ControlPointObservations, ElementObservations)) for _, kind in of_kind]
    return Hypotheses(tuple(rows), np.repeat(np.array(photo_points), counts), np.repeat(np.array(local), counts))


def _used(groups: Iterable[tuple[int, ...]], used: BoolArray, first: int) -> list[tuple[int, ...]]:
    """Return the groups without observations that are not used, each once, in numbers among all of the block."""
    if used.all():
        found = [tuple(first + row for row in group) for group in groups]
    else:
        found = [tuple(first + row for row in group if used[row]) for group in groups]
    return list(dict.fromkeys(group for group in found if group))


def _groups(kind: Observations) -> Iterable[tuple[int, ...]]:
    """Return the groups of rows of a kind; a group follows the single rows that it consists of."""
    if kind.exact or isinstance(kind, (AdditionalParameterObservations, AntennaParameterObservations)):
        return ()
    if isinstance(kind, PhotoPointObservations):
        return ((row, row + 1) for row in range(0, len(kind.rows.photo), 2))
    if isinstance(kind, ControlPointObservations):
        return _together(range(len(kind.point)), kind.point)
    if isinstance(kind, ElementObservations):
        return _element_groups(kind)
    if isinstance(kind, (PositionObservations, AttitudeObservations)):
        return _together(range(len(kind.station)), kind.station)
    if isinstance(kind, DirectionObservations):
        return _direction_groups(kind)
    return ((row,) for row in range(len(kind.rows.photo)))


def _element_groups(kind: ElementObservations) -> Iterator[tuple[int, ...]]:
    yield from ((row,) for row in range(len(kind.row)))
    for quantity in ("centre", "rotation", "point"):
        rows = np.flatnonzero(kind.quantity == quantity).tolist()
        yield from (group for group in _together(rows, kind.row) if len(group) > 1)


def _direction_groups(kind: DirectionObservations) -> Iterator[tuple[int, ...]]:
    rows = range(len(kind.set))
    yield from ((row,) for row in rows)
    for line_of_sight in _together(rows, np.unique(np.stack([kind.set, kind.target]), axis=1, return_inverse=True)[1]):
        if len(line_of_sight) > 1:
            yield line_of_sight
    yield from (whole for whole in _together(rows, kind.set) if len(whole) > 1)


def _together(rows: Iterable[int], belongs_to: IntArray) -> Iterator[tuple[int, ...]]:
    """Return the rows that belong to the same thing."""
    ordered = sorted(rows, key=lambda row: (int(belongs_to[row]), row))
    for _, members in groupby(ordered, key=lambda row: int(belongs_to[row])):
        yield tuple(members)
