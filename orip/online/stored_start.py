"""A block at the values of its last adjustment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orip.bundle.assemble import with_starting_values
from orip.bundle.local_frame import photos_in_frame
from orip.errors import NotSolvableError
from orip.records.block import Block
from orip.records.observations.control import PreliminaryPoint
from orip.records.results.solution import Solution
from orip.solving.starting_values import StartedBlock
from orip.units import RADIANS_PER_DEGREE


def started_at_solution(block: Block, solution: Solution) -> StartedBlock:
    """Return a gathered block with the adjusted values of its photos, points and cameras.

    Raises
    ------
    NotSolvableError
        If a photo was left out of the adjustment.
    """
    rows = {name: row for row, name in enumerate(solution.photos.names)}
    if lacking := [photo.name for photo in block.photos if photo.name not in rows]:
        message = f"photo {lacking[0]} was left out of the last adjustment"
        raise NotSolvableError(message)
    orientation = np.array([solution.photos.values[rows[photo.name]] for photo in block.photos])
    orientation[:, 3:] *= RADIANS_PER_DEGREE
    cameras = dict(zip(solution.cameras.names, solution.cameras.values.tolist(), strict=True))
    points = zip(solution.points.names, solution.points.values.tolist(), strict=True)
    started = replace(
        block,
        photo_orientation=orientation,
        cameras=tuple(
            replace(camera, parameters=tuple(cameras.get(camera.name, camera.parameters))) for camera in block.cameras
        ),
        preliminary=tuple(
            PreliminaryPoint(name, (x, y, z)) for name, (x, y, z) in points if np.isfinite((x, y, z)).all()
        ),
    )
    return StartedBlock(with_starting_values(photos_in_frame(started))[0], block)
