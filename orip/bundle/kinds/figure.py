"""Points that lie on a line, on a plane, on a cylinder, or at equal heights.

The figure itself is unknown: each of its points has a distance from it, with an a-priori error, and the points are not
tied to each other. Lines, planes and cylinders are straight in space; heights are those of the project.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.kinds.observation import (
    KindEquations,
    Linearisation,
    Observations,
    Rows,
    columns_of_coordinates,
    coordinates_with_partials,
    refuse_too_precise,
)
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.records.block import Block
from orip.records.control import FigureKind
from orip.records.figures import FIGURE_PARAMETERS, figures_in
from orip.records.ground import GroundSystem
from orip.records.observation_kinds import CYLINDER, HEIGHT, LINE, PLANE, ObservationKind

_MOST_TIED = 500
"""Points on figures up to which they stay in the reduced system: with 3 500 points in 200 photos that takes a tenth of
the time."""

_COMPONENTS: dict[FigureKind, tuple[str, ...]] = {
    "LINE": ("side", "up"),
    "PLANE": ("normal",),
    "CYLINDER": ("radial",),
    "HEIGHT": ("Z",),
}


class FigureObservations(Observations, frozen=True):
    """n distances of points from figures; `figure`, `point` and `component` (n,) say of which, and along what."""

    rows: Rows
    figure: IntArray
    point: IntArray
    component: IntArray
    ground: GroundSystem

    def _along_axes(self, state: BlockState) -> tuple[FloatArray, FloatArray]:
        """Return the coordinates (n, 3) of the points along the axes of their figures, and their partials (n, 3, 9).

        These are by the point's coordinates (3) and by shifts, tilts and radius of the figure (6).
        """
        axes = state.figures.axes[self.figure]
        r = np.einsum("nji,nj->ni", axes, state.points[self.point] - state.figures.origins[self.figure])
        by_tilts = np.zeros((len(r), 3, 2))
        # a figure that turns by w takes coordinates r to r - w × r
        by_tilts[:, 1, 0], by_tilts[:, 2, 0] = r[:, 2], -r[:, 1]
        by_tilts[:, 0, 1], by_tilts[:, 2, 1] = -r[:, 2], r[:, 0]
        shifts = np.broadcast_to(-np.eye(3), axes.shape)
        return r, np.concatenate([axes.transpose(0, 2, 1), shifts, by_tilts, np.zeros((len(r), 3, 1))], axis=2)


class LineObservations(FigureObservations, frozen=True):
    """Points on lines: the distance to the side, and up (at right angles to it)."""

    def groups(self) -> IntArray:
        """Return the rows of the points: the two distances of a point lose weight together."""
        return np.arange(len(self.figure), dtype=np.int64) // 2

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return distances (ground unit) and their partials by the point and by the figure's parameters."""
        r, by = self._along_axes(state)
        at = (np.arange(len(r)), self.component)
        return Linearisation(r[at], by[at], np.ones(len(r), dtype=bool))


class PlaneObservations(FigureObservations, frozen=True):
    """Points on planes: the distance along the normal."""

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return distances (ground unit) and their partials by the point and by the figure's parameters."""
        r, by = self._along_axes(state)
        return Linearisation(r[:, 2], by[:, 2], np.ones(len(r), dtype=bool))


class CylinderObservations(FigureObservations, frozen=True):
    """Points on cylinders: the distance from the surface, positive outside."""

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return distances (ground unit) and their partials by the point and by the figure's parameters."""
        r, by = self._along_axes(state)
        across = np.linalg.norm(r[:, :2], axis=1)
        known = across > 0.0
        outward = r[:, :2] / np.where(known, across, 1.0)[:, None]
        partials = np.einsum("ni,nik->nk", outward, by[:, :2])
        partials[:, -1] = -1.0
        return Linearisation(across - state.figures.radii[self.figure], partials, known)


class HeightObservations(FigureObservations, frozen=True):
    """Points of equal heights: the height above the common one, in the project."""

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return differences (ground unit) and their partials by the point and by the figure's parameters."""
        height = np.full(len(self.point), 2, dtype=np.int64)
        found = coordinates_with_partials(self.ground, state.points[self.point], height)
        residual = np.where(found.known, found.value - state.figures.origins[self.figure, 2], 0.0)
        by_figure = np.zeros((len(residual), len(FIGURE_PARAMETERS)))
        by_figure[:, FIGURE_PARAMETERS.index("SHIFT3")] = -1.0
        return Linearisation(residual, np.hstack([found.by_local, by_figure]), found.known)


def _observe(
    block: Block, unknowns: Unknowns, kind: ObservationKind, figure: FigureKind, of: type[FigureObservations]
) -> FigureObservations:
    """Return the distances of points from figures of a kind."""
    place, components = block.point_index(), _COMPONENTS[figure]
    rows = figures_in(block.figure_points).row
    found = [
        (one, row, number)
        for one, row in zip(block.figure_points, rows, strict=True)
        if one.kind == figure
        for number in range(len(components))
    ]
    point = np.array([place[one.point] for one, *_ in found], dtype=np.int64)
    row = np.array([row for _, row, _ in found], dtype=np.int64)
    component = np.array([number for *_, number in found], dtype=np.int64)
    error = np.array([one.error for one, *_ in found], dtype=np.float64)
    of_points = unknowns.points[point]
    if figure == "HEIGHT":
        of_points = columns_of_coordinates(block.ground, of_points, np.full(len(point), 2, dtype=np.int64))
    of_figures = unknowns.figures[row] if len(row) else np.full((0, len(FIGURE_PARAMETERS)), CONSTANT)
    return of(
        Rows(
            kind=kind,
            photo=tuple(one.figure for one, *_ in found),
            point=tuple(one.point for one, *_ in found),
            component=tuple(components[number] for number in component.tolist()),
            observed=np.zeros(len(found)),
            error=np.abs(error),
            used=error > 0.0,
            columns=np.hstack([of_points, of_figures]),
        ),
        row,
        point,
        component,
        block.ground,
    )


def refuse_too_precise_points(block: Block) -> None:
    """Refuse points on figures that are too precise; see `refuse_too_precise`."""
    refuse_too_precise(block, [(f"point {one.point} of figure {one.figure}", one.error) for one in block.figure_points])


def tied_by_figures(block: Block) -> frozenset[int]:
    """Return the points on figures that are not eliminated: all, but of a block with very many none.

    Rows that have a point and a figure in them are no part of the loop over photo points, unless the point stays.
    """
    if len(block.figure_points) > _MOST_TIED:
        return frozenset()
    place = block.point_index()
    return frozenset(place[point.point] for point in block.figure_points)


def _equations(kind: ObservationKind, figure: FigureKind, of: type[FigureObservations]) -> KindEquations:
    observe = partial(_observe, kind=kind, figure=figure, of=of)
    return KindEquations(kind, observe, tied_by_figures, refuse_too_precise_points)


KINDS = (
    _equations(LINE, "LINE", LineObservations),
    _equations(PLANE, "PLANE", PlaneObservations),
    _equations(CYLINDER, "CYLINDER", CylinderObservations),
    _equations(HEIGHT, "HEIGHT", HeightObservations),
)
