"""A block gathered from all that is measured and given, with what is doubtful in it."""

from __future__ import annotations

from dataclasses import replace

from orip.bundle.assemble import BlockInput, gather
from orip.errors import InputError
from orip.mistakes.before_adjustment.checks import block_warnings, measurement_warnings
from orip.progress import stage
from orip.records.block import Block


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
    try:
        block = gather(inputs)
    except InputError as error:
        raise InputError((*inputs.interior.complaints, *error.complaints)) from None
    found = (
        *inputs.warnings,
        *measurement_warnings(inputs.records, inputs.measured, inputs.interior),
        *block_warnings(block, inputs.control),
        *block.ground.warnings,
    )
    return replace(block, warnings=found)
