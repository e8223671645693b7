"""AliceVision's and Meshroom's scenes as JSON (``.sfm``): views, intrinsics, poses and structure; numbers are texts.

A pose takes ground to camera axes (x right, y down, z forward), x = R (X - C). The nine numbers of R go down its
columns, so that by rows they are those of the transposed matrix, from camera to ground. Measurements are those of the
feature detectors, which count from the centre of the upper left pixel; the principal point counts from half the width
and height. Distortion is Brown's at ideal coordinates, the decentring terms are OpenCV's.

What a version of the format means: up to 1.1 one focal length and the principal point in pixels; 1.2.0 two focal
lengths; from 1.2.1 on the principal point from the middle; from 1.2.2 on one focal length in millimetres, and the ratio
of both (fx by fy up to 1.2.4, fy by fx afterwards; from 1.2.11 on the millimetres are those of fy).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from orip.exchange.format import WITHOUT_GROUND, Conventions, Format, never
from orip.exchange.sources.json_tree import JsonValue, read_json
from orip.exchange.sources.text import Faults
from orip.exchange.vision.openmvg import (
    AXES,
    Landmark,
    Pose,
    View,
    WrittenLandmark,
    landmark,
    number_of,
    numbered,
    project_of,
    require_plain,
    written_landmarks,
)
from orip.files.text.decimal_numbers import parse_number
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed
from orip.records.exchanged import ExchangedCamera, ExchangedProject, Lens, PoseReading
from orip.wording import counted

READING = PoseReading("y_down", "to_ground", "matrix", "radian", "centre")

_PLANE = ("fx", "fy", "cx", "cy")
_BROWN = ("k1", "k2", "k3", "p1", "p2")
_FISHEYE = ("k1", "k2", "k3", "k4")
ALICEVISION_TERMS = (*_PLANE, *_BROWN)
ALICEVISION_FISHEYE_TERMS = (*_PLANE, *_FISHEYE)

_RADIAL_1: tuple[Lens, tuple[str, ...]] = ("opencv", ("k1",))
_RADIAL_3: tuple[Lens, tuple[str, ...]] = ("opencv", ("k1", "k2", "k3"))
_LENSES: Mapping[str, tuple[Lens, tuple[str, ...]]] = MappingProxyType(
    {
        "pinhole": ("opencv", ()),
        "none": ("opencv", ()),
        "radial1": _RADIAL_1,
        "radialk1": _RADIAL_1,
        "radial3": _RADIAL_3,
        "radialk3": _RADIAL_3,
        "brown": ("opencv", _BROWN),
        "fisheye4": ("equidistant", _FISHEYE),
        "fisheye1": ("fov", ("omega",)),
    }
)
"""Formula of each type of camera, or of distortion, with its terms in their order."""

_WRITTEN = ("1", "2", "6")
"""Version: older programs read it, and newer ones know what it means."""

_SENSOR_MM = 36.0
"""Width of the sensor where a file does not say it, as AliceVision takes it."""

_BEGINNING = 4000
_PARTS = ('"views"', '"featuresFolders"', '"matchesFolders"', '"intrinsics"')


def is_alicevision(source: Path) -> bool:
    """Return whether a file has the ending of a scene, and begins as one does."""
    if source.suffix.lower() not in (".sfm", ".json"):
        return False
    head = beginning(source, _BEGINNING)
    return '"version"' in head and any(part in head for part in _PARTS)


def read_alicevision(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a scene."""
    faults = Faults(shown)
    document = read_json(source, faults)
    found = None if document is None else _decimals(document, "version", 3)
    if document is None or found is None:
        return Parsed(None, tuple(faults.complaints))
    version = (found[0], found[1], found[2])
    cameras = {
        number: _camera(number, value, version) for number, value in _entries(document, "intrinsics", "intrinsicId")
    }
    poses = {number: _pose(value) for number, value in _entries(document, "poses", "poseId")}
    views = {number: _view(number, value) for number, value in _entries(document, "views", "viewId")}
    structure = (_landmark(number, value) for number, value in _entries(document, "structure", "landmarkId"))
    return project_of(document, cameras, poses, views, structure, READING, notes=_notes(document))


def _notes(document: JsonValue) -> list[str]:
    notes = []
    control = document.get("controlPoints")
    if control is not None and isinstance(control.value, list) and control.value:
        notes.append(f"{counted(len(control.value), 'control point')} without names, left out.")
    rigs = document.get("rigs")
    if rigs is not None and rigs.value:
        notes.append("The photos of a rig are independent of one another here: orip has no rigs.")
    return notes


def _entries(document: JsonValue, key: str, number: str) -> Iterator[tuple[str, JsonValue]]:
    part = document.get(key)
    values = () if part is None or part.value == "" else part.items()  # an empty list is written as an empty text
    yield from numbered((value, number_of(value, number)) for value in values)


def _decimal(value: JsonValue, key: str, missing: float | None = None) -> float | None:
    """Return a number that may be written as a text; `missing` where there is none."""
    found = value.get(key)
    if found is None or not isinstance(found.value, str):
        return value.number(key, missing)
    try:
        return parse_number(found.value)
    except ValueError as fault:
        found.complain(str(fault))
        return None


def _decimals(value: JsonValue, key: str, count: int) -> tuple[float, ...] | None:
    found = value.required(key)
    if found is None:
        return None
    numbers = found.value
    if numbers == "" and not count:
        return ()
    if isinstance(numbers, list) and len(numbers) == count:
        read = [_decimal(JsonValue({key: number}, value.source, value.place), key) for number in numbers]
        return None if None in read else tuple(number for number in read if number is not None)
    found.complain(f"{count} numbers should be here; correct them")
    return None


def _is_true(value: JsonValue, key: str) -> bool:
    found = value.get(key)
    return found is not None and str(found.value).lower() in ("1", "true")


def _camera(number: str, value: JsonValue, version: tuple[float, float, float]) -> ExchangedCamera | None:
    width, height = _decimal(value, "width"), _decimal(value, "height")
    kind = value.text("type")
    if kind is None or width is None or height is None:
        return None
    if min(width, height) < 1:
        value.complain("width and height have to be above 0; correct them")
        return None
    columns, rows = int(width), int(height)
    kind = _kind_of_distortion(value, kind)
    if kind not in _LENSES:
        return ExchangedCamera(number, columns, rows, "unsupported", {}, kind)
    lens, terms = _LENSES[kind]
    sensor = _decimal(value, "sensorWidth", _SENSOR_MM)
    point = _decimals(value, "principalPoint", 2)
    has_terms = bool(terms) and value.get("distortionParams") is not None and value.value["distortionParams"] != ""
    distortion = _decimals(value, "distortionParams", len(terms)) if has_terms else ()
    focal = None if sensor is None else _focal_lengths(value, version, columns, sensor if sensor > 0 else _SENSOR_MM)
    if sensor is None or point is None or distortion is None or focal is None:
        return None
    if min(focal) <= 0:
        value.complain("the focal length has to be above 0; correct it")
        return None
    middle = (0.0, 0.0) if version < (1, 2, 1) else (columns / 2.0, rows / 2.0)
    parameters = {"fx": focal[0], "fy": focal[1], "cx": middle[0] + point[0], "cy": middle[1] + point[1]}
    parameters |= dict(zip(terms, distortion, strict=False))
    sensor_mm = (sensor, sensor * rows / columns) if sensor > 0 else None
    return ExchangedCamera(
        number, columns, rows, lens, parameters, kind, AXES, AXES, sensor_mm, free=_free(value, terms)
    )  # fmt: skip


def _kind_of_distortion(value: JsonValue, kind: str) -> str:
    """Return the type of the distortion; that of the camera where it has another projection, or says both in one."""
    distortion, undistortion = (value.get(key) for key in ("distortionType", "undistortionType"))
    if undistortion is not None and undistortion.value != "none":
        return f"undistortion {undistortion.value}"
    return kind if kind != "pinhole" or distortion is None else str(distortion.value)


def _focal_lengths(
    value: JsonValue, version: tuple[float, float, float], columns: int, sensor_mm: float
) -> tuple[float, float] | None:
    if version < (1, 2, 0):
        focal = _decimal(value, "pxFocalLength")
        return None if focal is None else (focal, focal)
    if version < (1, 2, 2):
        both = _decimals(value, "pxFocalLength", 2)
        return None if both is None else (both[0], both[1])
    focal, ratio = _decimal(value, "focalLength"), _decimal(value, "pixelRatio", 1.0)
    if focal is None or ratio is None:
        return None
    if ratio <= 0:
        value.complain("pixelRatio has to be above 0; correct it")
        return None
    if (1, 2, 8) < version < (1, 2, 11) and ratio != 1.0:
        value.complain(
            "what a pixelRatio other than 1 means in versions 1.2.9 and 1.2.10 is not known; convert the scene"
        )
        return None
    pixels = focal / sensor_mm * columns
    if version < (1, 2, 5):
        return pixels, pixels / ratio
    return (pixels, pixels * ratio) if version < (1, 2, 11) else (pixels / ratio, pixels)


def _free(value: JsonValue, terms: tuple[str, ...]) -> tuple[str, ...]:
    """Return what AliceVision estimates of a camera: what it has not locked."""
    if _is_true(value, "locked"):
        return ()
    parts = (("scaleLocked", _PLANE[:2]), ("offsetLocked", _PLANE[2:]), ("distortionLocked", terms))
    return tuple(name for key, names in parts if not _is_true(value, key) for name in names)


def _pose(value: JsonValue) -> Pose | None:
    pose = value.required("pose")
    if pose is None or (pose.get("valid") is not None and not _is_true(pose, "valid")):
        return None
    transform = pose.required("transform")
    if transform is None:
        return None
    rotation, centre = _decimals(transform, "rotation", 9), _decimals(transform, "center", 3)
    return None if rotation is None or centre is None else (rotation, centre)


def _view(number: str, value: JsonValue) -> View | None:
    """Return a view; one without the number of a pose or camera is not oriented."""
    name = value.text("path")
    if (
        value.get("rigId") is not None
        and value.get("isPoseIndependant") is not None
        and not _is_true(value, "isPoseIndependant")
    ):
        value.complain(
            "the pose is that of a rig, which is not read; export the scene with ConvertSfMFormat to another format"
        )
    camera, pose = (number_of(value, key) if value.get(key) is not None else "" for key in ("intrinsicId", "poseId"))
    return (
        None if name is None or camera is None or pose is None else View(name or f"view{number}", camera, pose, value)
    )


def _landmark(number: str, value: JsonValue) -> Landmark | None:
    return landmark(number, _decimals(value, "X", 3), _observations(value))


def _observations(value: JsonValue) -> Iterator[tuple[str | None, tuple[float, ...] | None]]:
    seen = value.get("observations")
    for item in seen.items() if seen is not None and seen.value != "" else ():
        view = number_of(item, "observationId")
        # scenes may be saved without features
        yield view, _decimals(item, "x", 2) if item.get("x") is not None else None


def write_alicevision(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:  # noqa: ARG001  # new
    """Return ``orip.sfm``: all cameras as ``brown`` or ``fisheye4``, and all points as structure."""
    document = {
        "version": list(_WRITTEN),
        "views": [
            {
                "viewId": str(n),
                "poseId": str(n),
                "intrinsicId": str(photo.camera),
                "path": photo.name,
                "width": str(project.cameras[photo.camera].columns),
                "height": str(project.cameras[photo.camera].rows),
                "metadata": "",
            }
            for n, photo in enumerate(project.photos)
        ],
        "intrinsics": [_written_camera(n, camera) for n, camera in enumerate(project.cameras)],
        "poses": [
            {
                "poseId": str(n),
                "pose": {
                    "transform": {"rotation": _texts(photo.rotation), "center": _texts(photo.position)},
                    "locked": "0",
                },
            }
            for n, photo in enumerate(project.photos)
            if photo.rotation and photo.position
        ],
        "structure": [_written_landmark(one) for one in written_landmarks(project)],
    }
    return {"orip.sfm": json.dumps(document, indent=4, ensure_ascii=False).encode()}


def _texts(values: Any) -> list[str]:
    return [repr(float(value)) for value in values]


def _written_camera(n: int, camera: ExchangedCamera) -> dict[str, Any]:
    require_plain(camera)
    value = camera.parameters
    is_fisheye = camera.lens == "equidistant"
    width = _SENSOR_MM if camera.sensor_mm is None else camera.sensor_mm[0]
    return {
        "intrinsicId": str(n),
        "width": str(camera.columns),
        "height": str(camera.rows),
        "sensorWidth": repr(width),
        "sensorHeight": repr(width * camera.rows / camera.columns),
        "serialNumber": camera.name,
        "type": "fisheye4" if is_fisheye else "brown",
        "initializationMode": "calibrated",
        "initialFocalLength": "-1",
        "focalLength": repr(value["fx"] * width / camera.columns),
        "pixelRatio": repr(value["fy"] / value["fx"]),
        "pixelRatioLocked": "true",
        "principalPoint": _texts((value["cx"] - camera.columns / 2.0, value["cy"] - camera.rows / 2.0)),
        "distortionInitializationMode": "calibrated",
        "distortionParams": _texts(value.get(term, 0.0) for term in (_FISHEYE if is_fisheye else _BROWN)),
        "undistortionOffset": ["0", "0"],
        "undistortionParams": "",
        "locked": "false",
    }


def _written_landmark(one: WrittenLandmark) -> dict[str, Any]:
    rays = [
        {"observationId": str(view), "featureId": str(feature), "x": _texts(image), "scale": "0"}
        for view, feature, image in one.observations
    ]
    return {
        "landmarkId": one.number,
        "descType": "unknown",
        "color": ["255", "255", "255"],
        "X": _texts(one.coordinates),
        "observations": rays,
    }


ALICEVISION_FORMAT = Format(
    "alicevision", "AliceVision, Meshroom: scene as JSON (.sfm)", read_alicevision, is_alicevision,
    write_alicevision,
    Conventions(
        "opencv", READING, AXES, AXES, fisheye_lens="equidistant", terms=ALICEVISION_TERMS,
        fisheye_terms=ALICEVISION_FISHEYE_TERMS, is_copied=never, lacks=WITHOUT_GROUND,
    ),
    is_file=True,
)  # fmt: skip
