"""The block of a bundle, gathered from stores and control texts."""

from __future__ import annotations

from orip.bundle.assemble import BlockInput, gather
from orip.errors import InputError
from orip.mistakes.before_adjustment.checks import block_warnings, measurement_warnings
from orip.progress import stage
from orip.solving.solve import GatheredBlock
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.texts import raise_complaints


@stage("gathering observations")
def gathered_block(bundle: BundleState) -> GatheredBlock:
    """Gather the block of a bundle.

    Parameters
    ----------
    bundle : BundleState
        With definitions, marks and observations.

    Raises
    ------
    InputError
        If the project is not initialised, or nothing of the bundle is measured; else with everything that keeps it from
        being a block.
    """
    state, definition = bundle.state, bundle.project.definition
    given = state.texts.control_input(bundle.name)
    raise_complaints(given.complaints)
    state.require_initialised()
    bundle.require_measured()
    records, interior = state.records, state.interior
    inputs = BlockInput(
        bundle.definition,
        records.cameras,
        records.photos,
        interior.to_photo,
        interior.pixel_sizes,
        bundle.observations,
        given.records.control,
        given.records.preliminary,
        definition.ground_unit,
        definition.crs,
    )
    try:
        block = gather(inputs)
    except InputError as error:
        raise InputError((*interior.complaints, *error.complaints)) from None
    warnings = (
        *given.warnings,
        *measurement_warnings(records, state.measured, interior),
        *block_warnings(block, given.records.control, given.records.preliminary),
        *block.ground.warnings,
    )
    cameras = tuple(stored.record for stored in state.definitions.cameras)
    return GatheredBlock(block, given.records.preliminary, cameras, definition.ground_unit, warnings)
