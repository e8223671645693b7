"""The block of a bundle, gathered from stores and control texts."""

from __future__ import annotations

from orip.progress import stage
from orip.solving.gathering import gather_bundle
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
    return gather_bundle(
        bundle.definition,
        state.records,
        state.measured,
        state.interior,
        given.value.control,
        given.value.preliminary,
        definition.ground_unit,
        definition.crs,
        given.warnings,
    )
