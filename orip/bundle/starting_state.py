"""The state with which the adjustment of a block starts, and where the figures do that its points determine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.antennas import station_places
from orip.bundle.known_motions import motions_of_rolling_shutters
from orip.bundle.rigs.starting import starting_rigs
from orip.bundle.state import NO_FIGURES, BlockState, PlacedFigures, antenna_parameters, camera_parameters, moving
from orip.bundle.unknowns import set_names
from orip.errors import ProjectWarning
from orip.geometry.figures import Fitted, fitted_cylinder, fitted_line, fitted_plane, scatter_axes
from orip.geometry.rotation import rotation_from_angles
from orip.records.block import Block
from orip.records.control import FigureKind, FigurePoint
from orip.records.figures import LEAST_POINTS, FigureTable, figures_in, points_that_count
from orip.structs import replace
from orip.wording import counted

_SPREAD = 3.0
"""A-priori errors of its points, root mean square, that a figure's points must be apart for it to have a direction."""

_WIDEST = 1e3
"""Radius of a cylinder, in sizes of its points' scatter, from which they lie on a plane."""

_KIND: dict[FigureKind, str] = {"LINE": "line", "PLANE": "plane", "CYLINDER": "cylinder", "HEIGHT": "equal height"}

_FLAT: dict[FigureKind, tuple[int, str, str]] = {
    "LINE": (0, "all in one place", "name points along the line"),
    "PLANE": (1, "on one line", "name a point of the plane away from it"),
    "CYLINDER": (2, "on one plane", "name points around the cylinder"),
}
"""Of each kind: the axis along which its points must be spread, what they are otherwise, and what to do."""


def with_determined_figures(block: Block) -> tuple[Block, list[ProjectWarning]]:
    """Return a block whose points have starting coordinates without the figures that these do not determine."""
    figures = figures_in(block.figure_points)
    lost = {
        name: what
        for row, name in enumerate(figures.names)
        if (what := _undetermined(block, figures, row, figures.kinds[row])) is not None
    }
    if not lost:
        return block, []
    warnings = [
        ProjectWarning("figure-left-out", f"{_KIND[kind]} {name}", f"is left out: {lost[name]}")
        for name, kind in zip(figures.names, figures.kinds, strict=True)
        if name in lost
    ]
    return replace(block, figure_points=tuple(one for one in block.figure_points if one.figure not in lost)), warnings


def left_out_figures(points: Iterable[FigurePoint], names: Collection[str]) -> list[ProjectWarning]:
    """Return a warning of each figure that has too few points among some names to say anything."""
    points = list(points)
    kept = {point.figure for point in points_that_count(points, names)}
    number = Counter(point.figure for point in points if point.point in names and point.error > 0.0)
    kinds = {point.figure: point.kind for point in points}
    return [
        ProjectWarning(
            "figure-left-out",
            f"{_KIND[kind]} {name}",
            f"is left out: {counted(number[name], 'point')} of it in this bundle, and it says nothing of fewer than "
            f"{LEAST_POINTS[kind]}",
        )
        for name, kind in kinds.items()
        if name not in kept
    ]


def _undetermined(block: Block, figures: FigureTable, row: int, kind: FigureKind) -> str | None:
    """Return why the points of a figure do not determine it; None if they do."""
    if kind not in _FLAT:
        return None
    places, errors = _points_of(block, figures, row)
    axis, what, remedy = _FLAT[kind]
    _, sizes, _ = scatter_axes(places)
    if sizes[axis] > _SPREAD * float(np.sqrt(np.mean(errors**2))) and not _is_flat(places, kind, float(sizes[0])):
        return None
    return f"its points lie {what}, within their a-priori errors; {remedy}"


def _is_flat(places: FloatArray, kind: FigureKind, size: float) -> bool:
    return kind == "CYLINDER" and not 0.0 < fitted_cylinder(places).radius < _WIDEST * size


def placed_figures(block: Block) -> PlacedFigures:
    """Return the figures of a block as they fit its starting coordinates, whatever single points say."""
    figures = figures_in(block.figure_points)
    if not figures.names:
        return NO_FIGURES
    found = [_fitted(block, figures, row, kind) for row, kind in enumerate(figures.kinds)]
    return PlacedFigures(
        np.array([one.origin for one in found]),
        np.array([one.axes for one in found]),
        np.array([one.radius for one in found]),
    )


def _fitted(block: Block, figures: FigureTable, row: int, kind: FigureKind) -> Fitted:
    places, _ = _points_of(block, figures, row)
    match kind:
        case "LINE":
            return fitted_line(places)
        case "PLANE":
            return fitted_plane(places)
        case "CYLINDER":
            return fitted_cylinder(places)
        case "HEIGHT":
            height = float(np.median(block.ground.to_project(places)[:, 2]))
            return Fitted(np.append(places[:, :2].mean(axis=0), height), np.eye(3), 0.0)


def _points_of(block: Block, figures: FigureTable, row: int) -> tuple[FloatArray, FloatArray]:
    """Return starting coordinates (n, 3) and a-priori errors (n,) of a figure's points that are not disregarded."""
    place = block.point_index()
    every = [point for point, figure in zip(block.figure_points, figures.row, strict=True) if figure == row]
    mine = [point for point in every if point.error > 0.0] or every
    return block.point_start[[place[one.point] for one in mine]], np.array([one.error for one in mine])


def starting_state(block: Block) -> BlockState:
    """Return the state that the block's preliminary values give."""
    places = station_places(block)
    state = BlockState(
        cameras=camera_parameters(block),
        additional=np.zeros((len(block.cameras), max(len(set_names(camera)) for camera in block.cameras))),
        antennas=antenna_parameters(block),
        shifts=np.zeros((len(places.shifts), 3)),
        drifts=np.zeros((len(places.drifts), 3)),
        centres=block.photo_orientation[:, :3].copy(),
        rotations=rotation_from_angles(block.photo_orientation[:, 3:]),
        motions=np.zeros((len(block.photos), 6)),
        motion_corrections=np.zeros((len(block.photos), 6)),
        readouts=np.zeros(len(block.photos)),
        points=block.point_start.copy(),
        theodolites=np.array([theodolite.zero_direction for theodolite in block.theodolites], dtype=np.float64),
        figures=placed_figures(block),
        left_out=np.zeros(len(block.point_names), dtype=bool),
        turned_by_angles=np.array(
            [any(kind in photo.constant for kind in ("OMEGA", "PHI", "KAPPA")) for photo in block.photos], dtype=bool
        ),
    )
    return moving(state.with_rigs(starting_rigs(block)), block, motions_of_rolling_shutters(block))
