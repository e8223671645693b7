"""Observations that an adjustment down-weighted or left out, and the photos and points that fit worst."""

from __future__ import annotations

import numpy as np

from orip.arrays import IntArray
from orip.mistakes.fit_comparison import Fit
from orip.records.block import Block
from orip.records.coded_names import coded
from orip.records.results.solution import Solution

_DOUBTED = 0.5
"""Weight factor below which an observation hardly influenced the result."""

_PICTURE = 0.01
"""Mean square of the residuals, as a part of the variance of the photo coordinates, above which the photos are not of
these points: residuals are a tenth of the coordinates."""

_FAR_OFF = 1e6
"""Largest standard residual that is counted in full; those of points behind their photo are infinite."""


def doubted_photo_points(block: Block, solution: Solution) -> IntArray:
    """Return the rows (k,) of `Block.photo_points` that an adjustment doubts, or could not compute."""
    weights = solution.residuals.weight_factor[coded(solution.residuals.kind).where("photo".__eq__)]
    of_x, of_y = weights[::2], weights[1::2]
    lost = block.photo_points.in_use & (np.isnan(of_x) | np.isnan(of_y))
    return np.flatnonzero((of_x < _DOUBTED) | (of_y < _DOUBTED) | lost)


def doubted_control(solution: Solution) -> set[str]:
    """Return the names of control points that an adjustment doubts."""
    rows = solution.residuals
    doubted = coded(rows.kind).where("control".__eq__) & (rows.weight_factor < _DOUBTED)
    return set(coded(rows.point)[doubted].occurring())


def down_weighted_share(solution: Solution, kind: str) -> float:
    """Return the part of the observations of a kind in use that has lost weight."""
    weights = solution.residuals.weight_factor[coded(solution.residuals.kind).where(kind.__eq__)]
    weights = weights[~np.isnan(weights)]
    return float(np.mean(weights < 1.0)) if len(weights) else 0.0


def is_in_the_picture(solution: Solution) -> bool:
    """Tell whether residuals are so large that the photos cannot be of these points."""
    rows = solution.residuals
    photo = coded(rows.kind).where("photo".__eq__)
    left_out = float(np.isnan(rows.weight_factor[photo]).mean())
    mean_square, variance = float(np.mean(rows.residual[photo] ** 2)), float(np.var(rows.observed[photo]))
    return left_out > _PICTURE or mean_square > _PICTURE * variance


def photos_by_misfit(fit: Fit) -> list[str]:
    """Return the photos by the mean square of their standard residuals, the worst first."""
    return _by_misfit(fit, 1)


def points_by_misfit(fit: Fit) -> list[str]:
    """Return the points by the mean square of the standard residuals of their photo points, the worst first."""
    return _by_misfit(fit, 2)


def _by_misfit(fit: Fit, column: int) -> list[str]:
    squares: dict[str, list[float]] = {}
    for kind, name, standard in zip(fit.columns[0], fit.columns[column], fit.standard.tolist(), strict=True):
        if kind == "photo":
            squares.setdefault(name, []).append(min(standard, _FAR_OFF) ** 2)
    return sorted(squares, key=lambda name: -float(np.mean(squares[name])))
