"""Gathering the input of a bundle's block from stores and control texts."""

from __future__ import annotations

from orip.bundle.assemble import BlockInput
from orip.workflow.adjust.unread_files import unread_files
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.texts import raise_complaints


def block_input(bundle: BundleState) -> BlockInput:
    """Return what the block of a bundle is gathered from.

    Parameters
    ----------
    bundle : BundleState
        With definitions, marks and observations.

    Raises
    ------
    InputError
        With everything that is wrong in the control texts; else if the project is not initialised, or nothing of the
        bundle is measured.
    """
    found = block_input_so_far(bundle)
    bundle.require_measured()
    return found


def block_input_so_far(bundle: BundleState) -> BlockInput:
    """Return what the block of a bundle is gathered from, of which nothing may be measured yet; see `block_input`."""
    state, definition = bundle.state, bundle.project.definition
    given = state.texts.control_input(bundle.name)
    raise_complaints(given.complaints)
    state.require_initialised()
    return BlockInput(
        bundle.definition,
        state.records,
        state.measured,
        state.interior,
        given.value.control,
        given.value.preliminary,
        definition.ground_unit,
        definition.crs,
        (*unread_files(bundle, given.value.control), *given.warnings),
        definition.antennas,
    )
