"""The store of cameras (.CAM)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, get_args

from orip.files.stores.definitions import Definitions, Parts, StoredRecord, definition_table
from orip.files.stores.marks import given_marks_table, mark_rows, marks_of
from orip.files.stores.store import Store
from orip.files.stores.table import all_or_none, integer, list_table, real, text
from orip.records.camera import CAMERA_PARAMETERS, AdditionalSet, Camera, DistortionArgument, Sensor

ISP = ("isp_R0", "isp_A1", "isp_A2", "isp_A3")
FRAME = ("frame_x", "frame_y")
SENSOR = ("sensor_columns", "sensor_rows", "sensor_width", "sensor_height")

CAMERA = definition_table(
    "camera",
    (
        *(real(parameter) for parameter in CAMERA_PARAMETERS),
        text("distortion_at", get_args(DistortionArgument)),
        text("additional_set", get_args(AdditionalSet), optional=True),
        *(real(name, "none") for name in (*ISP, *FRAME)),
        *(integer(name, f"{name} > 0", optional=True) for name in SENSOR[:2]),
        *(real(name, "none", f"{name} > 0") for name in SENSOR[2:]),
    ),
    checks=(all_or_none(*ISP), all_or_none(*FRAME), all_or_none(*SENSOR)),
)
FIDUCIAL = given_marks_table("fiducial", "camera")
UNKNOWN = list_table("unknown_parameter", "camera", (text("parameter", CAMERA_PARAMETERS),), "parameter")
CURVE = list_table("distortion_point", "camera", (real("radius"), real("distortion")))
TABLES = (CAMERA, FIDUCIAL, UNKNOWN, CURVE)


def read(store: Store) -> tuple[StoredRecord[Camera], ...]:
    """Return all cameras in their order. A distortion curve without points is read as none given."""
    return _CAMERAS.read(store)


def write(store: Store, stored: Iterable[StoredRecord[Camera]]) -> None:
    """Replace all cameras."""
    _CAMERAS.write(store, stored)


def _apart(camera: Camera) -> Parts:
    if len(camera.parameters) != len(CAMERA_PARAMETERS):
        message = f"camera '{camera.name}' has {len(camera.parameters)} parameters, not {len(CAMERA_PARAMETERS)}"
        raise ValueError(message)
    sensor = camera.sensor
    values = (
        *camera.parameters,
        camera.distortion_at,
        camera.additional_set,
        *(camera.distortion_isp or (None,) * len(ISP)),
        *(camera.frame or (None,) * len(FRAME)),
        *((sensor.columns, sensor.rows, sensor.width, sensor.height) if sensor else (None,) * len(SENSOR)),
    )
    unknown = [(parameter,) for parameter in camera.unknown]
    return Parts(values, (mark_rows(camera.fiducials), unknown, camera.distortion_curve or ()))


def _together(name: str, parts: Parts) -> Camera:
    count = len(CAMERA_PARAMETERS)
    distortion_at, additional_set, *groups = parts.values[count:]
    isp, frame, sensor = groups[:4], groups[4:6], groups[6:]
    fiducials, unknown, curve = parts.lists
    return Camera(
        name=name,
        parameters=parts.values[:count],
        distortion_at=distortion_at,
        distortion_isp=_known(isp),
        distortion_curve=_known(curve),
        frame=_known(frame),
        fiducials=marks_of(fiducials),
        sensor=None if sensor[0] is None else Sensor(*sensor),
        unknown=tuple(row[0] for row in unknown),
        additional_set=additional_set,
    )


def _known(values: Sequence[Any]) -> Any:
    """Return the values as a tuple, or None if there are none or they are not known."""
    return tuple(values) if values and values[0] is not None else None


_CAMERAS = Definitions(CAMERA, (FIDUCIAL, UNKNOWN, CURVE), _apart, _together)
