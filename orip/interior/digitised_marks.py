"""Digitised marks: fiducial marks of a camera and tick marks, measured on the stage and taken into their records."""

from __future__ import annotations

from orip.errors import OrientationError
from orip.interior.definitions import Definitions, unknown_record
from orip.interior.fiducial_system import fiducials_from_plate
from orip.records.names import record_key
from orip.records.observations.measurement import FiducialsRecord, TicksRecord
from orip.records.project.camera import Camera, Mark
from orip.records.project.photo import Temtick
from orip.structs import replace


def camera_with_digitised_fiducials(record: FiducialsRecord, definitions: Definitions) -> Camera:
    """Return the camera of a ``FIDUCIALS`` record with its fiducial marks.

    Raises
    ------
    OrientationError
        If the camera is not known or is a digital frame, or the marks do not make a fiducial system.
    """
    camera = definitions.cameras.get(record_key(record.camera))
    if camera is None:
        raise OrientationError(
            unknown_record("camera", record.camera, (camera.name for camera in definitions.cameras.values()))
        )
    if camera.sensor is not None:
        message = (
            f"camera {camera.name} has a sensor, and a digital frame has no fiducial marks; take this FIDUCIALS record "
            "out, or the sensor out of the camera"
        )
        raise OrientationError(message)
    try:
        fiducials = fiducials_from_plate(record.marks, record.arrangement)
    except ValueError as fault:
        message = f"fiducials of camera {camera.name}: {fault}"
        raise OrientationError(message) from None
    return replace(camera, fiducials=fiducials)


def temtick_with_digitised_ticks(record: TicksRecord, definitions: Definitions) -> Temtick:
    """Return the temtick of a ``TICKS`` record with its tick marks, taken as they are.

    Raises
    ------
    OrientationError
        If the temtick is not known.
    """
    temtick = definitions.temticks.get(record_key(record.temtick))
    if temtick is None:
        raise OrientationError(
            unknown_record("temtick", record.temtick, (temtick.name for temtick in definitions.temticks.values()))
        )
    measured = zip(record.marks.names, record.marks.measured.tolist(), strict=True)
    return replace(temtick, ticks=tuple(Mark(name, x, y) for name, (x, y) in measured))
