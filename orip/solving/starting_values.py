"""Where an adjustment starts: at given values, and where some are missing, at those that the chain finds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from orip.bundle.assemble import with_starting_values
from orip.errors import NotSolvableError, ProjectWarning
from orip.mistakes.misread_control import misread_control
from orip.prelim.chain import preliminary_values
from orip.prelim.project_coordinates import orientations_in_frame, points_in_project
from orip.records.block import Block
from orip.records.camera import Camera
from orip.records.preliminary import CameraStart, PreliminaryValues


def started_block(block: Block, found: Callable[[PreliminaryValues], None]) -> tuple[Block, list[ProjectWarning]]:
    """Return a gathered block as its adjustment starts.

    Parameters
    ----------
    block : Block
    found : callable
        Told what the chain found, if it had to be asked.

    Raises
    ------
    NotSolvableError
        With the reason for each photo that could not be oriented.
    """
    if np.isfinite(block.photo_orientation).all():
        return with_starting_values(block)
    values = explained_preliminary_values(block)
    found(values)
    if complaint := not_oriented(values):
        raise NotSolvableError(complaint)
    orientation = np.where(
        np.isnan(block.photo_orientation), orientations_in_frame(values.photos), block.photo_orientation
    )
    # control that is weighted starts where its rays meet: coordinates that are wrong would lead them astray
    placed = {point.name for point in block.preliminary}
    points = [point for point in points_in_project(values.points, block.ground) if point.name not in placed]
    cameras = cameras_as_found(block.cameras, values.cameras)
    preliminary = (*block.preliminary, *points)
    started, warnings = with_starting_values(
        replace(block, photo_orientation=orientation, cameras=cameras, preliminary=preliminary)
    )
    return started, [*(ProjectWarning("preliminary-values", "", finding) for finding in values.findings), *warnings]


def explained_preliminary_values(block: Block) -> PreliminaryValues:
    """Run the chain, and add to its findings what was probably mistaken in control that does not fit."""
    values = preliminary_values(block)
    return replace(values, findings=(*misread_control(values.reading), *values.findings))


def cameras_as_found(cameras: Sequence[Camera], found: Sequence[CameraStart]) -> tuple[Camera, ...]:
    """Return cameras with the parameters that preliminary values have for them."""
    parameters = {start.name: start.parameters for start in found}
    return tuple(replace(camera, parameters=parameters.get(camera.name, camera.parameters)) for camera in cameras)


def not_oriented(values: PreliminaryValues) -> str:
    """Return what is wrong with the control, else why photos could not be oriented, a line each; "" if all could."""
    reasons = [photo.how for photo in values.photos if photo.rotation is None]
    if not reasons:
        return ""
    if values.findings:
        return "\n".join(values.findings)
    title = f"{len(reasons)} of {len(values.photos)} photos could not be oriented"
    advice = (
        "measure what is missing, or give those photos X0 Y0 Z0 OMEGA PHI KAPPA in orip.toml; 'orip prelim' shows "
        "each step"
    )
    different = list(dict.fromkeys(reasons))
    if len(different) == 1:
        return f"{title}: {different[0]}; {advice}"
    return "\n".join([f"{title}; {advice}", *different])
