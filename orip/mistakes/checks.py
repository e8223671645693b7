"""The checks before an adjustment, in the order in which their warnings are printed."""

from __future__ import annotations

from orip.errors import ProjectWarning
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior
from orip.mistakes.camera_values import camera_warnings
from orip.mistakes.names import name_warnings, photos_under_two_names
from orip.mistakes.outside_frame import misnamed_marks, points_outside_frames
from orip.mistakes.photo_coordinates import coordinates_in_other_units, find_reduced_pictures
from orip.records.block import Block
from orip.records.control import Control
from orip.records.measurement import Measured
from orip.records.names import record_key


def measurement_warnings(
    definitions: Definitions, measured: Measured, interior: Interior
) -> tuple[ProjectWarning, ...]:
    """Return what is probably wrong with cameras, marks and photo points, together with the interior's own warnings.

    Parameters
    ----------
    definitions : Definitions
    measured : Measured
    interior : Interior
        Orientations from those marks.
    """
    cameras = (warning for camera in definitions.cameras.values() for warning in camera_warnings(camera))
    outside = (
        warning
        for observations in measured.observations.values()
        for warning in points_outside_frames(definitions, observations, interior.to_photo)
    )
    units = [
        warning
        for observations in measured.observations.values()
        for warning in coordinates_in_other_units(definitions, observations)
    ]
    reduced = [
        warning
        for observations in measured.observations.values()
        for warning in find_reduced_pictures(definitions, observations)
    ]
    # points in another unit, or from another origin, lie outside; that is no second mistake
    misread = {warning.where for warning in (*units, *reduced)}
    outside = (warning for warning in outside if not _cameras_of(definitions, warning) & misread)
    # photos of several bundles are checked once for each bundle
    marks = (*misnamed_marks(interior.adjustments), *interior.warnings)
    return tuple(dict.fromkeys((*cameras, *units, *reduced, *marks, *outside)))


def _cameras_of(definitions: Definitions, warning: ProjectWarning) -> set[str]:
    """Return the camera that a warning is about, or that of the photo that it is about, as warnings name it."""
    photo = definitions.photos.get(record_key(warning.where.removeprefix("photo ")))
    camera = definitions.cameras.get(record_key(photo.camera)) if photo is not None else None
    return {warning.where} if camera is None else {warning.where, f"camera {camera.name}"}


def block_warnings(block: Block, control: Control) -> tuple[ProjectWarning, ...]:
    """Return what is probably wrong with the names of a gathered block's photos and points.

    Parameters
    ----------
    block : Block
    control : Control
        All control of the project, even what the block does not use.
    """
    # measurements are checked without these
    from orip.mistakes.free_network import observations_without_weight
    from orip.mistakes.stations import missing_strips

    names = name_warnings(block, control, block.preliminary)
    return (*photos_under_two_names(block), *names, *observations_without_weight(block), *missing_strips(block))
