"""What orip explains of simulated blocks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.bundle.methods import Method, adjust_block
from orip.errors import NotSolvableError, ProjectWarning
from orip.mistakes.explanation import explain_misfit
from orip.mistakes.hypothesis import Readjuster
from orip.prelim.chain import preliminary_values_from_all_rays
from orip.records.block import Block
from orip.records.camera import Camera
from orip.solving.starting_values import started_block
from orip.structs import replace


def explained(block: Block, found_before: Sequence[ProjectWarning] = ()) -> list[ProjectWarning]:
    """Adjust a block, and return what orip says of it after what it found before the adjustment."""
    gathered = replace(
        block,
        point_start=np.full_like(block.point_start, np.nan),
        defined_cameras=block.cameras,
        warnings=tuple(found_before),
    )

    def start(other: Block) -> Block:
        started = started_block(other, preliminary_values_from_all_rays)
        if started.left_out:
            raise NotSolvableError("\n".join(map(str, started.left_out)))
        return started.block

    started = start(gathered)
    solution, solved = adjust_block(started, Method(), lambda _: None, lambda: False)
    return explain_misfit(solution, solved, started, Readjuster(gathered, start))


def with_camera(block: Block, *values: tuple[int, float]) -> Block:
    """Return a block whose camera has other values at some places of `CAMERA_PARAMETERS`."""
    (camera,) = block.cameras
    parameters = list(camera.parameters)
    for place, value in values:
        parameters[place] = value
    changed: Camera = replace(camera, parameters=tuple(parameters))
    return replace(block, cameras=(changed,))
