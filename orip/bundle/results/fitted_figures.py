"""Adjusted lines, planes, cylinders and common heights, with their precision."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.kinds.figure import FigureObservations
from orip.bundle.results.ground import reduced_cofactors
from orip.bundle.solve import SolvedBlock
from orip.bundle.state import RADIUS, SHIFTS, TILTS
from orip.bundle.unknowns import CONSTANT
from orip.records.figures import FigureEstimate, figures_in
from orip.units import DEGREES_PER_RADIAN

_VALUES = ("X", "Y", "Z", "dX", "dY", "dZ", "radius", "sd_place", "sd_direction", "sd_radius", "rms")


def figure_estimates(solved: SolvedBlock) -> tuple[FigureEstimate, ...]:
    """Return the adjusted figures of a block, in the project's coordinates."""
    block, placed, columns = solved.block, solved.state.figures, solved.problem.unknowns.figures
    figures = figures_in(block.figure_points)
    if not figures.names:
        return ()
    level = np.array([kind == "HEIGHT" for kind in figures.kinds])
    places = np.where(level[:, None], placed.origins, block.ground.to_project(placed.origins))
    directions = (block.ground.axes_at(places) @ placed.axes[:, :, 2, None])[:, :, 0]
    places[level, :2] = directions[level] = np.nan
    number, rms = _residuals(solved, len(figures.names))
    radii = np.where(columns[:, RADIUS] != CONSTANT, placed.radii, np.nan)
    values = np.column_stack([places, directions, radii, _deviations(solved), rms]).tolist()
    return tuple(
        FigureEstimate(name, kind, int(points), **dict(zip(_VALUES, row, strict=True)))
        for name, kind, points, row in zip(figures.names, figures.kinds, number, values, strict=True)
    )


def _deviations(solved: SolvedBlock) -> FloatArray:
    """Return the standard deviations (number of figures, 3) of place, direction (degrees) and radius, at their largest.

    NaN for what a figure has not, infinite for what nothing determines.
    """
    columns = solved.problem.unknowns.figures
    cofactors = reduced_cofactors(solved, columns)
    removed = np.append(solved.normals.removed, False)[columns]
    found = np.full((len(columns), 3), np.nan)
    for place, (part, unit) in enumerate(
        ((SHIFTS, 1.0), (TILTS, DEGREES_PER_RADIAN), (slice(RADIUS, RADIUS + 1), 1.0))
    ):
        known = (columns[:, part] != CONSTANT).any(axis=1)
        largest = np.linalg.eigvalsh(cofactors[:, part, part])[:, -1]
        sd = unit * solved.deviation_scale * np.sqrt(np.maximum(largest, 0.0))
        found[known, place] = np.where(removed[:, part].any(axis=1), np.inf, sd)[known]
    return found


def _residuals(solved: SolvedBlock, count: int) -> tuple[FloatArray, FloatArray]:
    """Return how many points of each figure are in use, and the root mean square of their distances."""
    points, squares, first = np.zeros(count), np.zeros(count), 0
    for kind in solved.problem.observations:
        rows = slice(first, first + len(kind.rows.error))
        first = rows.stop
        if isinstance(kind, FigureObservations):
            used = solved.equations.active[rows]
            distance = solved.equations.residual[rows] * kind.rows.error
            np.add.at(points, kind.figure[used & (kind.component == 0)], 1.0)
            np.add.at(squares, kind.figure[used], distance[used] ** 2)
    return points, np.sqrt(squares / np.maximum(points, 1.0))
