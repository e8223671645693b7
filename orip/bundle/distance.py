"""Control distances: coordinate differences, plane and spatial distances between two points.

A distance with a-priori error 0 is constant. It is met exactly without a weight that would eat the digits of the
normal equations: it enters with a moderate error, and after each iteration the value in the equation is shifted by what
the adjusted distance still misses (an augmented Lagrangian), until it misses nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from orip.bundle.observation import Linearisation, Observations, Rows
from orip.bundle.state import State
from orip.bundle.unknowns import Unknowns
from orip.model.block import Block
from orip.model.control import ControlDistance, DistanceCode

FloatArray = NDArray[np.float64]

AXES: dict[DistanceCode, tuple[int, ...]] = {
    "X": (0,),
    "Y": (1,),
    "Z": (2,),
    "XY": (0, 1),
    "YZ": (1, 2),
    "ZX": (2, 0),
    "XYZ": (0, 1, 2),
}
"""Coordinates that each code measures along; a single one is signed, end minus start."""

_CONSTANT_ERROR = 0.01
"""Error of a constant distance in its equation, as a part of a photo error taken to the ground."""


@dataclass(frozen=True, slots=True)
class DistanceObservations(Observations):
    """n distances between points `start` and `end`; `axes` (n, 3) marks the coordinates that each measures along."""

    rows: Rows
    start: NDArray[np.int64]
    end: NDArray[np.int64]
    axes: NDArray[np.bool_]

    def linearise_with_partials(self, state: State) -> Linearisation:
        """Return residuals (ground unit) and partials by the two points' coordinates, start first."""
        difference = np.where(self.axes, state.points[self.end] - state.points[self.start], 0.0)
        signed = self.axes.sum(axis=1) == 1
        length = np.linalg.norm(difference, axis=1)
        known = signed | (length > 0.0)
        value = np.where(signed, difference.sum(axis=1), length)
        direction = difference / np.where(length > 0.0, length, 1.0)[:, None]
        by_end = np.where(signed[:, None], self.axes.astype(np.float64), direction)
        return Linearisation(value - self.rows.observed, np.hstack([-by_end, by_end]), known)


@dataclass(frozen=True, slots=True)
class ConstantDistanceObservations(DistanceObservations):
    """Distances that are met exactly."""

    exact: ClassVar[bool] = True

    def remembered(self, state: State) -> FloatArray:
        """Return the shifts of the equations: grown by what the distances still miss."""
        missing = DistanceObservations.linearise_with_partials(self, state).residual
        return np.asarray(state.memory.get(self.rows.kind, 0.0) + missing)


def observe_distances(block: Block, unknowns: Unknowns) -> DistanceObservations:
    """Return the weighted and the disregarded distances."""
    chosen = [each for each in block.distances if each.error != 0.0]
    error = np.array([each.error for each in chosen], dtype=np.float64)
    return DistanceObservations(*_between(block, unknowns, chosen, "distance", np.abs(error), error > 0.0))


def observe_constant_distances(block: Block, unknowns: Unknowns) -> ConstantDistanceObservations:
    """Return the distances with a-priori error 0."""
    chosen = [each for each in block.distances if each.error == 0.0]
    error = np.full(len(chosen), _constant_error(block) if chosen else 1.0)
    used = np.ones(len(chosen), dtype=bool)
    return ConstantDistanceObservations(*_between(block, unknowns, chosen, "constant distance", error, used))


def tied_by_distances(block: Block) -> frozenset[int]:
    """Return the points that distances tie to each other."""
    place = block.point_index()
    return frozenset(place[name] for each in block.distances for name in (each.start, each.end))


def _between(
    block: Block, unknowns: Unknowns, chosen: Sequence[ControlDistance], kind: str, error: FloatArray,
    used: NDArray[np.bool_],
) -> tuple[Rows, NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:  # fmt: skip
    place = block.point_index()
    start = np.array([place[each.start] for each in chosen], dtype=np.int64)
    end = np.array([place[each.end] for each in chosen], dtype=np.int64)
    axes = np.zeros((len(chosen), 3), dtype=bool)
    for row, each in enumerate(chosen):
        axes[row, list(AXES[each.code])] = True
    rows = Rows(
        kind=kind,
        photo=("",) * len(chosen),
        point=tuple(each.name for each in chosen),
        component=tuple(each.code for each in chosen),
        observed=np.array([each.distance for each in chosen], dtype=np.float64),
        error=error,
        used=used,
        columns=np.hstack([unknowns.points[start], unknowns.points[end]]),
    )
    return rows, start, end, axes


def _constant_error(block: Block) -> float:
    """Return 1 % of what a photo error means on the ground at the mean distance of the points from their photos."""
    points = block.photo_points
    distance = np.linalg.norm(block.point_start[points.point] - block.photo_orientation[points.photo, :3], axis=1)
    principal = np.array([camera.parameters[0] for camera in block.cameras])[block.photo_camera[points.photo]]
    return float(_CONSTANT_ERROR * np.mean(points.error) * np.mean(distance / principal))
