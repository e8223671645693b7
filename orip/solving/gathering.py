"""A block gathered from all that is measured and given, with what is doubtful in it."""

from __future__ import annotations

import numpy as np

from orip.bundle.assemble import BlockInput, gather
from orip.errors import Complaint, InputError
from orip.mistakes.before_adjustment.checks import block_warnings, measurement_warnings
from orip.mistakes.before_adjustment.ground_systems import contradicting_ground_systems
from orip.mistakes.before_adjustment.impossible_camera import raise_if_impossible
from orip.progress import stage
from orip.records.block import Block
from orip.records.names import record_key
from orip.structs import replace


@stage("gathering observations")
def gather_bundle(inputs: BlockInput) -> Block:
    """Gather the block of a bundle, with warnings of what is doubtful in it.

    Returns
    -------
    Block
        Elements of photos that are not known are NaN, and so are all starting coordinates of points.

    Raises
    ------
    InputError
        With everything that prevents an adjustment.
    """
    used = {record_key(photo.camera) for photo in inputs.records.photos.values()}
    raise_if_impossible(camera for key, camera in inputs.records.cameras.items() if key in used)
    orientations = [photo.orientation[:2] for photo in inputs.records.photos.values()]
    systems = contradicting_ground_systems(inputs.control, np.array(orientations, dtype=np.float64).reshape(-1, 2))
    try:
        block = gather(inputs)
    except InputError as error:
        causes = (Complaint(str(warning)) for warning in systems)
        raise InputError((*causes, *inputs.interior.complaints, *error.complaints)) from None
    found = (
        *systems,
        *inputs.warnings,
        *measurement_warnings(inputs.records, inputs.measured, inputs.interior),
        *block_warnings(block, inputs.control),
        *block.ground.warnings,
    )
    return replace(block, warnings=found)
