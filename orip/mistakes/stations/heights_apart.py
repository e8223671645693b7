"""Heights of the control and of the stations that differ by a pole, an instrument or an antenna, not by a system.

A difference of a metre or two is taken up by the principal distance where that is unknown, and bends the rest: the
control is then tried without its heights, and with them as the block sees them.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock
from orip.bundle.verdict import group_findings
from orip.errors import ProjectWarning
from orip.mistakes.camera_values import other_principal_distance
from orip.mistakes.hypothesis import DECIDED, Misfit, Readjuster, fit_of_adjustment, is_good
from orip.mistakes.stations.doubted_camera import OF_LENSES, are_doubted, has_positions, is_better
from orip.mistakes.stations.misread_positions import HEIGHT_OFFSET
from orip.records.block import Block
from orip.structs import replace
from orip.wording import counted_names

_FEWEST = 3
"""Heights that do not agree by chance."""

_LEAST, _MOST = 0.3, 10.0
"""Metres: less is in the errors, more a system of heights."""

_ARM = 3.0
"""Metres that an antenna is above its camera at most: stations that are too high by less may be those of it."""

_ALIKE = 0.2
"""Spread of the differences, as a part of their median, at most."""


def heights_apart(misfit: Misfit) -> list[ProjectWarning]:
    """Return that the heights of the control and of the stations differ by a constant, if all else fits then."""
    block = misfit.readjuster.block
    can_be_told = misfit.readjuster.is_worthwhile and has_positions(block) and block.ground_unit == "m"
    if not (can_be_told and are_doubted(misfit.solution)) or block.constant_points[:, 2].any():
        return []
    free = misfit.readjuster.adjust(_with_heights(block, None))
    if free is None or not free.converged:
        return []
    off = _heights_off(block, free)
    if len(off) < _FEWEST:
        return []
    by = float(np.median(off))
    told = bool(group_findings(misfit.solution))
    if -_ARM <= by < 0.0 and (block.stations or told):
        return []  # an antenna has unknowns of its own, and its group names them
    if not (_LEAST < abs(by) < _MOST and float(np.median(np.abs(off - by))) < _ALIKE * abs(by)):
        return []
    tried = misfit.readjuster.adjust(_with_heights(block, by))
    if tried is None or not (is_better(tried, misfit.solved) and is_good(fit_of_adjustment(tried))):
        return []
    if are_doubted(solution_of(tried)):
        return []
    return _heights_or_camera(tried, misfit.readjuster, by, told)


def _heights_or_camera(shifted: SolvedBlock, readjuster: Readjuster, by: float, told: bool) -> list[ProjectWarning]:
    """Return that a held principal distance is wrong, if all fits as well with another one as with other heights.

    That takes nothing from what was surveyed; a difference of heights is said only where it alone explains the block.
    Where a principal distance explains it that hardly differs, either may be wrong, and both are named, unless the
    groups have `told`.
    """
    block = readjuster.block
    cost = shifted.weighing.cost(shifted.equations)
    for row, camera in enumerate(block.cameras):
        if "C" in camera.unknown:
            continue
        for hypothesis in other_principal_distance(block, row):
            tried = readjuster.adjust(hypothesis.block)
            if tried is not None and tried.converged and tried.weighing.cost(tried.equations) < cost + DECIDED:
                other = float(tried.state.cameras[row, 0])
                if abs(other / camera.parameters[0] - 1.0) > OF_LENSES:
                    return hypothesis.findings(tried)
                return [] if told else [_warning(block, by, other)]
    return [_warning(block, by)]


def _with_heights(block: Block, by: float | None) -> Block:
    """Return a block whose control is lower by a constant, or has no heights."""
    points = []
    for point in block.control_points:
        (x, y, z), errors = point.coordinates, point.errors
        if z is None:
            points.append(point)
        elif by is None:
            points.append(replace(point, coordinates=(x, y, None), errors=(*errors[:2], None)))
        else:
            points.append(replace(point, coordinates=(x, y, z - by)))
    return replace(block, control_points=tuple(points))


def _heights_off(block: Block, free: SolvedBlock) -> FloatArray:
    """Return by how much the heights of the control are above those of the block."""
    place = free.block.point_index()
    found = free.block.ground.to_project(free.state.points)[:, 2]
    return np.array(
        [
            point.coordinates[2] - found[place[point.name]]
            for point in block.control_points
            if point.name in place and point.kind == "control" and point.coordinates[2] is not None
        ]
    )


def _warning(block: Block, by: float, other: float | None = None) -> ProjectWarning:
    """Return the warning; `other` is the principal distance with which all fits as well."""
    names = [point.name for point in block.control_points if point.kind == "control"]
    mend = "correct Z of the control (or of the stations), or use one system of heights"
    if by > 0.0:
        cause = "the height of the pole or the instrument above the mark was probably not taken off"
    elif by < -_ARM:
        cause = "the height of the pole was probably taken off twice, or that of an antenna added"
    else:
        cause = "the stations are probably those of an antenna above the camera, or a pole was taken off twice"
        mend = "correct Z of the stations, or of the control"
    size = f"{abs(by):.{1 if abs(by) > 1.0 else 2}f} m"
    text = (
        f"their heights are all about {size} too {'high' if by > 0.0 else 'low'}, compared with those of the exposure "
        f"stations, and all fits with {'-' if by > 0.0 else '+'}{size}: {cause}; {mend}"
    )
    held = [camera.name for camera in block.cameras if "C" not in camera.unknown]
    if held:
        fits = "is wrong" if other is None else f"is wrong, and all fits with C = {other:.6g} mm as well"
        text += f'; if the heights are right, C of camera {held[0]} {fits}: set unknown = ["C"]'
    return ProjectWarning(HEIGHT_OFFSET, counted_names("control point", names), text)
