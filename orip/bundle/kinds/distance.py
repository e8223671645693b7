"""Control distances: coordinate differences, plane and spatial distances between two points.

Spatial distances are lengths of the local frame; all others are taken in the project's coordinates, on the grid. A
distance with a-priori error 0 is constant, and is met exactly.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.bundle.kinds.observation import (
    ExactObservations,
    KindEquations,
    Linearisation,
    Observations,
    Rows,
    error_of_constant_lengths,
    refuse_too_precise,
)
from orip.bundle.state import BlockState
from orip.bundle.unknowns import Unknowns
from orip.records.block import Block
from orip.records.control import ControlDistance, DistanceCode
from orip.records.ground import GroundSystem, ProjectCoordinates
from orip.records.observation_kinds import CONSTANT_DISTANCE, DISTANCE, ObservationKind

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


class DistanceObservations(Observations, frozen=True):
    """n distances between points `start` and `end`; `axes` (n, 3) marks the coordinates that each measures along."""

    rows: Rows
    start: NDArray[np.int64]
    end: NDArray[np.int64]
    axes: NDArray[np.bool_]
    ground: GroundSystem

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (ground unit) and partials by the two points' coordinates, start first."""
        start, end = self._coordinates(state.points[self.start]), self._coordinates(state.points[self.end])
        difference = np.where(self.axes, end.value - start.value, 0.0)
        signed = self.axes.sum(axis=1) == 1
        length = np.linalg.norm(difference, axis=1)
        known = np.isfinite(length) & (signed | (length > 0.0))
        value = np.where(signed, difference.sum(axis=1), length)
        direction = difference / np.where(length > 0.0, length, 1.0)[:, None]
        along = np.where(signed[:, None], self.axes.astype(np.float64), direction)[:, None, :]
        partials = np.hstack([-(along @ start.by_local)[:, 0], (along @ end.by_local)[:, 0]])
        # not a number where the project's system does not reach
        return Linearisation(np.nan_to_num(value - self.rows.observed), np.nan_to_num(partials), known)

    def _coordinates(self, local: FloatArray) -> ProjectCoordinates:
        """Return the coordinates that distances are taken in: local ones of spatial distances, else the project's."""
        spatial = self.axes.sum(axis=1) == 3
        project = self.ground.project_with_partials(local)
        return ProjectCoordinates(
            np.where(spatial[:, None], local, project.value),
            np.where(spatial[:, None, None], np.eye(3), project.by_local),
        )


class ConstantDistanceObservations(ExactObservations, DistanceObservations, frozen=True):
    """Distances that are met exactly."""


def observe_distances(block: Block, unknowns: Unknowns) -> DistanceObservations:
    """Return the weighted and the disregarded distances."""
    chosen = [distance for distance in block.distances if distance.error != 0.0]
    error = np.array([distance.error for distance in chosen], dtype=np.float64)
    return DistanceObservations(*_between(block, unknowns, chosen, DISTANCE, np.abs(error), error > 0.0))


def refuse_too_precise_distances(block: Block) -> None:
    """Refuse distances that are too precise; see `refuse_too_precise`."""
    observed = [(f"distance {distance.name}", distance.error) for distance in block.distances]
    refuse_too_precise(block, observed, ", or 0 for a distance that is exactly known")


def observe_constant_distances(block: Block, unknowns: Unknowns) -> ConstantDistanceObservations:
    """Return the distances with a-priori error 0."""
    chosen = [distance for distance in block.distances if distance.error == 0.0]
    error = np.full(len(chosen), error_of_constant_lengths(block) if chosen else 1.0)
    used = np.ones(len(chosen), dtype=bool)
    return ConstantDistanceObservations(*_between(block, unknowns, chosen, CONSTANT_DISTANCE, error, used))


def tied_by_distances(block: Block) -> frozenset[int]:
    """Return the points that distances tie to each other."""
    place = block.point_index()
    return frozenset(place[name] for distance in block.distances for name in (distance.start, distance.end))


def _between(
    block: Block, unknowns: Unknowns, chosen: Sequence[ControlDistance], kind: ObservationKind, error: FloatArray,
    used: NDArray[np.bool_],
) -> tuple[Rows, NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_], GroundSystem]:  # fmt: skip
    place = block.point_index()
    start = np.array([place[distance.start] for distance in chosen], dtype=np.int64)
    end = np.array([place[distance.end] for distance in chosen], dtype=np.int64)
    axes = np.zeros((len(chosen), 3), dtype=bool)
    for row, distance in enumerate(chosen):
        axes[row, list(AXES[distance.code])] = True
    rows = Rows(
        kind=kind,
        photo=("",) * len(chosen),
        point=tuple(distance.name for distance in chosen),
        component=tuple(distance.code for distance in chosen),
        observed=np.array([distance.distance for distance in chosen], dtype=np.float64),
        error=error,
        used=used,
        columns=np.hstack([unknowns.points[start], unknowns.points[end]]),
    )
    return rows, start, end, axes, block.ground


KINDS = (
    KindEquations(DISTANCE, observe_distances, tied_by_distances, refuse_too_precise_distances),
    KindEquations(CONSTANT_DISTANCE, observe_constant_distances, tied_by_distances),
)
