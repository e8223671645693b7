"""Reconstructions of OpenSfM (``reconstruction.json``): cameras, photos and points.

Lengths of a camera are divided by the longer side of its photos and counted from their centre, y down. A photo has a
rotation vector from ground to camera and a translation. Coordinates are east, north and up at ``reference_lla``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import chain
from types import MappingProxyType
from typing import Any

from msgspec import Struct

from orip.exchange.sources.json_tree import JsonValue
from orip.files.text.decimal_numbers import LARGEST_NUMBER
from orip.files.text.shown import shown_token
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, GroundFrame, Lens, PoseReading
from orip.records.observations.station import Station

READING = PoseReading("y_down", "to_camera", "rotation_vector", "radian", "translation")

_RADIAL = ("k1", "k2", "k3", "k4")

LENSES: Mapping[str, tuple[Lens, tuple[str, ...]]] = MappingProxyType(
    {
        "perspective": ("opencv", _RADIAL[:2]),
        "simple_radial": ("opencv", _RADIAL[:1]),
        "radial": ("opencv", _RADIAL[:2]),
        "brown": ("opencv", (*_RADIAL[:3], "p1", "p2")),
        "fisheye": ("equidistant", _RADIAL[:2]),
        "fisheye_opencv": ("equidistant", _RADIAL),
    }
)
"""Formula of each projection type that can be converted, with the parameters of its distortion."""

_WORST_ACCURACY = 1000.0
"""Metres; OpenSfM writes 999999 where a position is not known."""


class Reconstruction(Struct, frozen=True):
    """What is taken from the largest reconstruction of a file.

    Parameters
    ----------
    cameras : tuple of ExchangedCamera
    photos : tuple of ExchangedPhoto
    points : mapping of str to tuple of 3 floats
        Coordinates by track.
    stations : tuple of Station
        Positions observed by GNSS, in the frame.
    frame : GroundFrame
    notes : tuple of str
    """

    cameras: tuple[ExchangedCamera, ...]
    photos: tuple[ExchangedPhoto, ...]
    points: dict[str, tuple[float, ...]]
    stations: tuple[Station, ...]
    frame: GroundFrame
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
    return Reconstruction(cameras, photos, _points(largest), stations, _frame(largest), notes)


def _notes(largest: JsonValue, parts: list[JsonValue]) -> tuple[str, ...]:
    notes = []
    others = [len(part.value["shots"]) for part in parts if part is not largest]
    if others:
        sizes = ", ".join(map(str, sorted(others, reverse=True)[:10]))
        notes.append(f"Of {len(parts)} reconstructions the largest was taken; the others have {sizes} photos.")
    instances = largest.value.get("rig_instances")
    if isinstance(instances, dict) and any(
        isinstance(rig, dict) and len(rig.get("rig_camera_ids") or ()) > 1 for rig in instances.values()
    ):
        notes.append("The photos of a rig are independent of one another here: orip has no rigs.")
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
    distortion = {term: value.number(term, 0.0) for term in terms}
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
    return ExchangedCamera(name, int(width), int(height), lens, parameters | known, kind)


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
    return GroundFrame("topocentric", (longitude, latitude, height))
