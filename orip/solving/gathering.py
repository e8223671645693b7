"""A block gathered from all that is measured and given, with what is doubtful in it."""

from __future__ import annotations

from collections.abc import Sequence

from orip.bundle.assemble import BlockInput, gather
from orip.errors import InputError, ProjectWarning
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior
from orip.mistakes.before_adjustment.checks import block_warnings, measurement_warnings
from orip.records.control import Control, PreliminaryPoint
from orip.records.measurement import Measured
from orip.records.names import record_key
from orip.records.project import BundleDefinition
from orip.solving.solve import GatheredBlock


def gather_bundle(
    bundle: BundleDefinition,
    records: Definitions,
    measured: Measured,
    interior: Interior,
    control: Control,
    preliminary: tuple[PreliminaryPoint, ...],
    ground_unit: str,
    crs: str | None,
    warnings: Sequence[ProjectWarning] = (),
) -> GatheredBlock:
    """Gather the block of a bundle.

    Parameters
    ----------
    bundle : BundleDefinition
    records : Definitions
        All cameras and photos.
    measured : Measured
        With the photo observations of the bundle.
    interior : Interior
        That of the records and measurements.
    control : Control
    preliminary : tuple of PreliminaryPoint
    ground_unit : str
    crs : str or None
    warnings : sequence of ProjectWarning
        What is known to be doubtful already.

    Raises
    ------
    InputError
        With everything that keeps it from being a block.
    """
    inputs = BlockInput(
        bundle,
        records.cameras,
        records.photos,
        interior.to_photo,
        interior.pixel_sizes,
        measured.observations[record_key(bundle.name)],
        control,
        preliminary,
        ground_unit,
        crs,
    )
    try:
        block = gather(inputs)
    except InputError as error:
        raise InputError((*interior.complaints, *error.complaints)) from None
    found = (
        *warnings,
        *measurement_warnings(records, measured, interior),
        *block_warnings(block, control, preliminary),
        *block.ground.warnings,
    )
    return GatheredBlock(block, preliminary, tuple(records.cameras.values()), ground_unit, found)
