"""Control that was measured in pictures of another resolution than the other points."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import BoolArray
from orip.errors import ProjectWarning
from orip.mistakes.doubted_observations import doubted_photo_points
from orip.mistakes.hypothesis import Misfit, explains, fit_of_adjustment
from orip.mistakes.mistake import ON_GROUND, Consequence, declare
from orip.records.block import Block
from orip.structs import replace
from orip.wording import counted_names

REDUCED_CONTROL = declare(
    "reduced-control", "the control was measured in pictures of another resolution",
    Consequence(warnings=None, groups=(*ON_GROUND, "check point", "camera")),
)  # fmt: skip

_FACTORS = (2.0, 4.0, 8.0, 0.5, 0.25)
"""Columns of the sensor over those of the pictures in which control was measured; below 1 these are larger."""

_FEWEST, _EDGE = 6, 1.01
"""Photo points of control that all lie in a corner or outside, and tolerance at the edge of a picture."""

_MOST = 0.5
"""Part of all photo points that are of control, at most."""


def reduced_control(misfit: Misfit) -> list[ProjectWarning]:
    """Return that control was measured at another resolution, if all fits when its pixels are multiplied."""
    block = misfit.readjuster.block
    if not (misfit.readjuster.is_worthwhile and block.control_points):
        return []
    known = np.isin(np.array(block.point_names, dtype=str), [point.name for point in block.control_points])
    rows = known[block.photo_points.point] & block.photo_points.in_use
    if not _FEWEST <= np.count_nonzero(rows) <= _MOST * len(rows):
        return []
    doubted = np.isin(np.flatnonzero(rows), doubted_photo_points(block, misfit.solution))
    if misfit.solution.status == "converged" and not doubted.any():
        return []
    given = fit_of_adjustment(misfit.solved)
    for factor, changed in _multiplied(block, rows):
        tried = misfit.readjuster.adjust_roughly(changed)
        if tried is not None and explains(fit_of_adjustment(tried), given):
            return [_warning(block, rows, factor)]
    return []


def _multiplied(block: Block, rows: BoolArray) -> Iterator[tuple[float, Block]]:
    """Yield blocks whose control is measured in pictures as large as the sensor, for factors that leave it inside."""
    sensors = [camera.sensor for camera in block.cameras]
    if any(sensor is None for sensor in sensors):
        return
    sizes = np.array([(sensor.width, sensor.height) for sensor in sensors if sensor is not None])
    size = sizes[block.photo_camera[block.photo_points.photo[rows]]]
    corner = size * [-0.5, 0.5]
    xy = block.photo_points.xy[rows]
    part = np.abs(xy - corner) / size
    for factor in _FACTORS:
        is_possible = part.max() * factor <= _EDGE
        # larger pictures are left at least in part
        if is_possible and (factor > 1.0 or part.max() > _EDGE):
            moved = block.photo_points.xy.copy()
            moved[rows] = (xy - corner) * factor + corner
            yield factor, replace(block, photo_points=replace(block.photo_points, xy=moved))


def _warning(block: Block, rows: BoolArray, factor: float) -> ProjectWarning:
    seen = {block.point_names[row] for row in block.photo_points.point[rows].tolist()}
    names = [point.name for point in block.control_points if point.name in seen]
    lower = "lower" if factor > 1.0 else "higher"
    text = (
        f"they fit when their pixels are multiplied by {factor:g}, in all photos: they were measured in pictures of a "
        f"{lower} resolution than the other points; multiply their columns and rows by {factor:g} in the measurement "
        "files, or measure them in the same pictures"
    )
    return ProjectWarning(REDUCED_CONTROL, counted_names("control point", names), text)
