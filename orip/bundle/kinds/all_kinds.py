"""The kinds of observation: a new one is a module, a line here and an entry in `orip.records.observation_kinds`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from orip.bundle.kinds.additional_parameter import observe_additional_parameters
from orip.bundle.kinds.control_point import observe_control_points
from orip.bundle.kinds.direction import observe_directions, tied_by_directions
from orip.bundle.kinds.distance import observe_constant_distances, observe_distances, tied_by_distances
from orip.bundle.kinds.element import observe_constant_elements, observe_elements
from orip.bundle.kinds.observation import Observations
from orip.bundle.kinds.photo_point import observe_photo_points
from orip.bundle.unknowns import Unknowns
from orip.records.block import Block


def _ties_no_points(_: Block) -> frozenset[int]:
    return frozenset()


@dataclass(frozen=True, slots=True)
class Kind:
    """How a kind of observation enters the adjustment.

    Parameters
    ----------
    observe : callable
        Finds the kind's observations in a block.
    tied_points : callable
        Indices of the points that its observations tie to each other; they are not eliminated.
    """

    observe: Callable[[Block, Unknowns], Observations]
    tied_points: Callable[[Block], frozenset[int]] = _ties_no_points


KINDS = (
    Kind(observe_photo_points),
    Kind(observe_control_points),
    Kind(observe_additional_parameters),
    Kind(observe_elements),
    Kind(observe_constant_elements),
    Kind(observe_distances, tied_by_distances),
    Kind(observe_constant_distances, tied_by_distances),
    Kind(observe_directions, tied_by_directions),
)
