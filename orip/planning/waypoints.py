"""Planned exposures as waypoints: longitude and latitude, and heights above all that a pilot's program may want."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.geometry.other_crs import crs_from_geographic, geographic_from_crs
from orip.geometry.rotation import rotation_from_angles
from orip.planning.designed import Given
from orip.records.control import Station
from orip.units import DEGREES_PER_RADIAN


class Waypoints(Struct, frozen=True):
    """n exposures for a pilot: degrees, metres; heading from true north, pitch of the view from the horizon."""

    stations: Sequence[Station]
    longitude: FloatArray
    latitude: FloatArray
    ellipsoid: FloatArray
    ground: FloatArray
    start: FloatArray
    heading: FloatArray
    pitch: FloatArray
    speed: float


_ROLLED = math.sin(math.radians(1.0))
"""Rise of a photo's lower edge, in its length, above which no gimbal that is upright takes it."""


def waypoints_of(stations: Sequence[Station], given: Given) -> Waypoints:
    """Return planned exposures for a pilot.

    Raises
    ------
    InputError
        If the project has no crs, or the terrain no height at a place.
    """
    crs = given.state.project.definition.crs
    if crs is None:
        message = "the project has no crs, so that exposures have no longitude and latitude; give crs in [project]"
        raise InputError.single(message, "orip.toml")
    places = np.array([station.position for station in stations])
    rotations = rotation_from_angles(np.array([station.angles for station in stations]))
    there = _geographic(places, crs)
    ahead = places.copy()
    # to the left of x: y is upright where the view is level
    left = np.column_stack([-rotations[:, 1, 0], rotations[:, 0, 0]])
    ahead[:, :2] += left / np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-12)
    step = _geographic(ahead, crs) - there
    heading = np.arctan2(step[:, 0] * np.cos(np.radians(there[:, 1])), step[:, 1]) * DEGREES_PER_RADIAN
    ground = given.terrain(places[:, :2])
    pitch = np.arcsin(np.clip(-rotations[:, 2, 2], -1.0, 1.0)) * DEGREES_PER_RADIAN
    return Waypoints(
        stations, there[:, 0], there[:, 1], there[:, 2], places[:, 2] - ground, places[:, 2] - ground[0],
        np.mod(heading, 360.0), pitch, _speed(stations),
    )  # fmt: skip


def require_upright(stations: Sequence[Station]) -> None:
    """Refuse photos that are turned about the camera's axis, which a drone with heading and pitch cannot take.

    Raises
    ------
    InputError
    """
    axes = rotation_from_angles(np.array([station.angles for station in stations]))[:, 2]
    rolled = np.flatnonzero((np.abs(axes[:, 0]) > _ROLLED) | (axes[:, 1] < -_ROLLED))
    if len(rolled):
        message = (
            f"photo {stations[rolled[0]].photo} and {len(rolled) - 1} more are turned about the camera's axis, but a "
            "drone has heading and pitch alone; write rolls = [0.0] in [plan], or export as csv"
        )
        raise InputError.single(message)


def _geographic(places: FloatArray, crs: str) -> FloatArray:
    """Return longitude, latitude (degrees) and height above the ellipsoid (m), WGS 84."""
    geographic, _ = geographic_from_crs(places, crs, crs)
    return crs_from_geographic(geographic, "EPSG:4979", crs)


def _speed(stations: Sequence[Station]) -> float:
    """Return the speed between photos of a strip; 1 where the plan has no times."""
    found = [
        math.dist(one.position, other.position) / (other.time - one.time)
        for one, other in itertools.pairwise(stations)
        if one.strip == other.strip and other.time > one.time
    ]
    return float(np.median(found)) if found else 1.0
