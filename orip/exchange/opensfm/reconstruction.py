"""Reconstructions of OpenSfM (``reconstruction.json``) and OpenDroneMap's orientations (``shots.geojson``)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

from msgspec import Struct

from orip.errors import Complaint
from orip.exchange.opensfm.control_marks import crs_of_heading
from orip.exchange.opensfm.rigs import RigReader
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.json_tree import JsonValue, read_json
from orip.exchange.sources.text import Faults
from orip.files.text.decimal_numbers import LARGEST_NUMBER
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed, shown_token
from orip.records.control import Station
from orip.records.exchanged import (
    ExchangedCamera,
    ExchangedExposure,
    ExchangedPhoto,
    ExchangedProject,
    ExchangedRig,
    GroundFrame,
    Lens,
    PoseReading,
)

# Lengths of a camera are divided by the longer side of its photos and counted from their centre, y down. A photo has a
# rotation vector from ground to camera and a translation. Coordinates are east, north and up at ``reference_lla``.

READING = PoseReading("y_down", "to_camera", "rotation_vector", "radian", "translation")

_RADIAL = ("k1", "k2", "k3", "k4")
_FISHEYE62 = (*_RADIAL, "k5", "k6", "p1", "p2")
_COUNTED_FROM_0 = {"s1": "s0", "s2": "s1", "s3": "s2", "s4": "s3"}

LENSES: Mapping[str, tuple[Lens, tuple[str, ...]]] = MappingProxyType(
    {
        "perspective": ("opencv", _RADIAL[:2]),
        "simple_radial": ("opencv", _RADIAL[:1]),
        "radial": ("opencv", _RADIAL[:2]),
        "brown": ("opencv", (*_RADIAL[:3], "p1", "p2")),
        "fisheye": ("equidistant", _RADIAL[:2]),
        "fisheye_opencv": ("equidistant", _RADIAL),
        "fisheye62": ("equidistant", _FISHEYE62),
        "fisheye624": ("equidistant", (*_FISHEYE62, "s1", "s2", "s3", "s4")),
    }
)
"""Formula of each projection type that can be converted, with the parameters of its distortion."""

_WITH_PRINCIPAL_POINT = ("brown", "fisheye_opencv", "fisheye62", "fisheye624")
"""Projection types whose principal point OpenSfM estimates with the rest."""

_WORST_ACCURACY = 1000.0
"""Metres; OpenSfM writes 999999 where a position is not known."""


class Reconstruction(Struct, frozen=True):
    """What is taken from the largest reconstruction of a file.

    Parameters
    ----------
    points : mapping of str to tuple of 3 floats
        Coordinates by track.
    stations : tuple of Station
        Positions observed by GNSS, in the frame.
    """

    cameras: tuple[ExchangedCamera, ...]
    photos: tuple[ExchangedPhoto, ...]
    points: dict[str, tuple[float, ...]]
    stations: tuple[Station, ...]
    frame: GroundFrame
    rigs: tuple[ExchangedRig, ...] = ()
    exposures: tuple[ExchangedExposure, ...] = ()
    notes: tuple[str, ...] = ()


def largest_reconstruction(document: JsonValue) -> Reconstruction | None:
    """Return the reconstruction with most photos; None, and a complaint kept, if there is none."""
    all_parts = list(document.items())
    parts = [part for part in all_parts if isinstance(part.value, dict) and isinstance(part.value.get("shots"), dict)]
    if not parts:
        document.complain("there is no reconstruction with shots; name the reconstruction.json of OpenSfM")
        return None
    largest = max(parts, key=lambda part: len(part.value["shots"]))
    notes = _notes(largest, parts)
    cameras = _cameras(largest)
    places = {camera.name: place for place, camera in enumerate(cameras)}
    photos, stations = _photos(largest, places)
    rigs = RigReader(largest, cameras, photos)
    return Reconstruction(
        rigs.cameras, rigs.photos, _points(largest), stations, _frame(largest), rigs.rigs, rigs.exposures, notes
    )


def _notes(largest: JsonValue, parts: list[JsonValue]) -> tuple[str, ...]:
    notes = []
    others = [len(part.value["shots"]) for part in parts if part is not largest]
    if others:
        sizes = ", ".join(map(str, sorted(others, reverse=True)[:10]))
        notes.append(f"Of {len(parts)} reconstructions the largest was taken; the others have {sizes} photos.")
    return tuple(notes)


def _cameras(part: JsonValue) -> tuple[ExchangedCamera, ...]:
    cameras = part.required("cameras")
    found = [camera_of(name, value) for name, value in cameras.entries()] if cameras is not None else []
    return tuple(camera for camera in found if camera is not None)


def camera_of(name: str, value: JsonValue) -> ExchangedCamera | None:
    """Return a camera; None, and complaints kept, if something of it is missing."""
    kind = value.text("projection_type")
    width, height = value.number("width"), value.number("height")
    if kind is None or width is None or height is None:
        return None
    if min(width, height) < 1:
        value.complain("width and height have to be above 0; correct them")
        return None
    if kind not in LENSES:
        return ExchangedCamera(name, int(width), int(height), "unsupported", {}, kind)
    lens, terms = LENSES[kind]
    longer = max(width, height)
    focal_x, focal_y = _focal_lengths(value)
    shift_x, shift_y = value.number("c_x", 0.0), value.number("c_y", 0.0)
    distortion = {term: value.number(_COUNTED_FROM_0.get(term, term), 0.0) for term in terms}
    if focal_x is None or focal_y is None or shift_x is None or shift_y is None:
        return None
    if min(focal_x, focal_y) <= 0:
        value.complain("the focal length has to be above 0; correct it")
        return None
    parameters = {
        "fx": focal_x * longer,
        "fy": focal_y * longer,
        "cx": width / 2.0 + shift_x * longer,
        "cy": height / 2.0 + shift_y * longer,
    }
    known = {term: number for term, number in distortion.items() if number is not None}
    free = ("fx", "fy", *(("cx", "cy") if kind in _WITH_PRINCIPAL_POINT else ()), *terms)
    return ExchangedCamera(name, int(width), int(height), lens, parameters | known, kind, free=free)


def _focal_lengths(value: JsonValue) -> tuple[float | None, float | None]:
    if value.get("focal_x") is None:
        focal = value.number("focal")
        return focal, focal
    focal_x = value.number("focal_x")
    return focal_x, value.number("focal_y", focal_x or 1.0)


def _photos(part: JsonValue, cameras: Mapping[str, int]) -> tuple[tuple[ExchangedPhoto, ...], tuple[Station, ...]]:
    photos: list[ExchangedPhoto] = []
    stations: list[Station] = []
    shots = part.required("shots")
    for name, shot in shots.entries() if shots is not None else ():
        rotation, translation = shot.numbers("rotation", 3), shot.numbers("translation", 3)
        camera = shot.text("camera")
        if rotation is None or translation is None or camera is None:
            continue
        if camera not in cameras:
            shot.complain(f"there is no camera '{shown_token(camera)}' in the file; export it again")
            continue
        photos.append(ExchangedPhoto(name, cameras[camera], rotation, translation, key=len(photos)))
        station = _station(name, shot)
        if station is not None:
            stations.append(station)
    return tuple(photos), tuple(stations)


def _station(name: str, shot: JsonValue) -> Station | None:
    if shot.get("gps_position") is None:
        return None
    position = shot.numbers("gps_position", 3)
    accuracy = shot.number("gps_dop", math.inf)
    if position is None or accuracy is None or not 0.0 < accuracy < _WORST_ACCURACY:
        return None
    x, y, z = position
    return Station(name, (x, y, z), (accuracy, accuracy, accuracy))


def _points(part: JsonValue) -> dict[str, tuple[float, ...]]:
    points = part.get("points")
    sound = {} if points is None else _sound_points(points.value)
    if sound:
        return sound
    found = {}
    for name, point in points.entries() if points is not None else ():
        coordinates = point.numbers("coordinates", 3)
        if coordinates is not None:
            found[name] = coordinates
    return found


def _sound_points(points: Any) -> dict[str, tuple[float, ...]]:
    """Return the coordinates of points where all of them are sound, which is quickly seen; else nothing."""
    if not isinstance(points, dict):
        return {}
    values = list(points.values())
    if not all(isinstance(value, dict) for value in values):
        return {}
    places = [value.get("coordinates") for value in values]
    if not all(isinstance(place, list) and len(place) == 3 for place in places):
        return {}
    numbers = list(chain.from_iterable(places))
    if not set(map(type, numbers)) <= {int, float} or not all(abs(number) <= LARGEST_NUMBER for number in numbers):
        return {}
    decimals = list(map(float, numbers))
    return dict(zip(points, zip(decimals[::3], decimals[1::3], decimals[2::3], strict=True), strict=True))


def _frame(part: JsonValue) -> GroundFrame:
    reference = part.get("reference_lla")
    if reference is None:
        return GroundFrame()
    longitude, latitude = reference.number("longitude"), reference.number("latitude")
    height = reference.number("altitude", 0.0)
    if longitude is None or latitude is None or height is None:
        return GroundFrame()
    if longitude == 0.0 == latitude:  # what OpenSfM writes where no photo has a position
        return GroundFrame()
    return GroundFrame("topocentric", (longitude, latitude, height), "reference_lla")


# A shot has the projection centre in the output's map projection (``translation``), the rotation vector from ground to
# camera, and the focal length divided by the longer side of the photo. There are neither distortion nor measurements.
# The projection is named in the first line of ``odm_georeferencing/coords.txt``.

SHOTS_READING = PoseReading("y_down", "to_camera", "rotation_vector", "radian", "centre")

_COORDS = "odm_georeferencing/coords.txt"
_FIRST_LINE = 300


def is_shots_geojson(source: Path) -> bool:
    """Return whether a file is such a report by its name."""
    return source.is_file() and source.suffix.lower() == ".geojson" and source.name.startswith("shots")


def read_shots_geojson(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read photos with their orientations, and cameras without distortion."""
    faults = Faults(shown)
    document = read_json(source, faults)
    features = None if document is None else document.required("features")
    cameras: dict[str, ExchangedCamera] = {}
    photos: list[ExchangedPhoto] = []
    for feature in features.items() if features is not None else ():
        properties = feature.required("properties")
        if properties is not None:
            _add_shot(properties, cameras, photos)
    if not faults.complaints and not photos:
        faults.complaints.append(Complaint("the file has no photo; name odm_report/shots.geojson", shown))
    if faults.complaints:
        return Parsed(None, tuple(faults.complaints))
    crs = crs_of_heading(beginning(source.parent.parent / _COORDS, _FIRST_LINE).partition("\n")[0])
    notes = ["The file has neither distortion nor measurements: photos are oriented, and nothing can be adjusted."]
    if crs is None:
        notes.append(f"There is no {_COORDS} that names the map projection: write crs into orip.toml.")
    return Parsed(
        ExchangedProject(
            name="",
            cameras=tuple(cameras.values()),
            photos=tuple(photos),
            points=CollectedPoints().points(),
            rays=CollectedRays().rays(),
            readings=(SHOTS_READING,),
            crs=crs,
            ground_unit="m",
            notes=tuple(notes),
        )
    )


def _add_shot(properties: JsonValue, cameras: dict[str, ExchangedCamera], photos: list[ExchangedPhoto]) -> None:
    name = properties.text("filename")
    focal, width, height = (properties.number(key) for key in ("focal", "width", "height"))
    position, rotation = properties.numbers("translation", 3), properties.numbers("rotation", 3)
    if name is None or position is None or rotation is None:
        return
    if focal is None or width is None or height is None:
        return
    if min(focal, width, height) <= 0 or max(width, height) > _LARGEST_SIDE:
        properties.complain(f"focal, width and height of '{shown_token(name)}' have to be above 0; correct them")
        return
    # older reports name no camera: one for each size and focal length
    camera = properties.text("camera") if properties.get("camera") is not None else f"{width:g}x{height:g} {focal:g}"
    if camera is None:
        return
    if camera not in cameras:
        pixels = focal * max(width, height)
        plane = {"fx": pixels, "fy": pixels, "cx": width / 2.0, "cy": height / 2.0}
        cameras[camera] = ExchangedCamera(camera, int(width), int(height), "opencv", plane, "perspective")
    place = list(cameras).index(camera)
    photos.append(ExchangedPhoto(name, place, rotation, position, key=len(photos)))


_LARGEST_SIDE = 1e6
"""Pixels that no photo has."""
