"""Planned exposures as waypoints, and as DJI's WPML: a KMZ of what the drone executes, and of the template for Pilot 2.

After the tables of elements in https://github.com/dji-sdk/Cloud-API-Doc, docs/en/60.api-reference/00.dji-wpml. The
drone itself (droneInfo, payloadInfo) is not named, as no plan knows it.
"""

from __future__ import annotations

import io
import itertools
import math
import zipfile
from collections.abc import Mapping, Sequence
from typing import TypeAlias

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


Content: TypeAlias = "str | float | Mapping[str, Content] | list[Mapping[str, Content]]"
"""Of an element: text, or elements by name, in their order; a list is one element for each."""

_NAMESPACE = "http://www.dji.com/wpmz/1.0.2"
_FASTEST_TRANSITION = 15.0
_LOWEST, _HIGHEST = 2.0, 1500.0
"""Metres a second, and metres above the start: what the format allows."""

_STOP = "toPointAndStopWithDiscontinuityCurvature"


class _Waypoint(Struct, frozen=True):
    """A waypoint: degrees, metres above the ellipsoid and above the start."""

    number: int
    longitude: float
    latitude: float
    ellipsoid: float
    start: float
    heading: float
    pitch: float


def wpml_bytes(given: Waypoints) -> bytes:
    """Return the archive."""
    columns = (given.longitude, given.latitude, given.ellipsoid, given.start, given.heading, given.pitch)
    rows = [_Waypoint(number, *row) for number, row in enumerate(zip(*(one.tolist() for one in columns), strict=True))]
    speed = round(given.speed, 2)
    mission: dict[str, Content] = {"missionConfig": _mission(rows, speed)}
    template = _document(mission, _template(rows, speed), [_of_template(row) for row in rows], rows)
    executed: dict[str, Content] = {
        "templateId": 0,
        "executeHeightMode": "WGS84",
        "waylineId": 0,
        "autoFlightSpeed": speed,
    }
    waylines = _document(mission, executed, [_executed(row, speed) for row in rows], rows)
    return zipped({"wpmz/template.kml": template, "wpmz/waylines.wpml": waylines})


def _mission(rows: Sequence[_Waypoint], speed: float) -> dict[str, Content]:
    heights = [row.start for row in rows]
    return {
        "flyToWaylineMode": "safely",
        "finishAction": "goHome",
        "exitOnRCLost": "executeLostAction",
        "executeRCLostAction": "goBack",
        # up to the flight before anything else, and home above all of it
        "takeOffSecurityHeight": _height(min(max(min(heights), _LOWEST), _HIGHEST)),
        "globalTransitionalSpeed": min(speed, _FASTEST_TRANSITION),
        "globalRTHHeight": _height(min(max(*heights, _LOWEST), _HIGHEST)),
    }


def _template(rows: Sequence[_Waypoint], speed: float) -> dict[str, Content]:
    return {
        "templateType": "waypoint",
        "templateId": 0,
        "waylineCoordinateSysParam": {"coordinateMode": "WGS84", "heightMode": "relativeToStartPoint"},
        "autoFlightSpeed": speed,
        "gimbalPitchMode": "usePointSetting",
        "globalHeight": _height(rows[0].start),
        "globalWaypointHeadingParam": _heading(rows[0]),
        "globalWaypointTurnMode": _STOP,
        "globalUseStraightLine": 1,
    }


def _of_template(row: _Waypoint) -> dict[str, Content]:
    return {
        "index": row.number,
        "ellipsoidHeight": _height(row.ellipsoid),
        "height": _height(row.start),
        "useGlobalHeight": 0,
        "useGlobalSpeed": 1,
        "useGlobalHeadingParam": 0,
        "waypointHeadingParam": _heading(row),
        "useGlobalTurnParam": 1,
        "gimbalPitchAngle": f"{row.pitch:.2f}",
        "actionGroup": _photo(row),
    }


def _executed(row: _Waypoint, speed: float) -> dict[str, Content]:
    return {
        "index": row.number,
        "executeHeight": _height(row.ellipsoid),
        "waypointSpeed": speed,
        "waypointHeadingParam": _heading(row),
        "waypointTurnParam": {"waypointTurnMode": _STOP, "waypointTurnDampingDist": 0},
        "useStraightLine": 1,
        "actionGroup": _photo(row),
    }


def _heading(row: _Waypoint) -> dict[str, Content]:
    turned = (round(row.heading) + 180) % 360 - 180  # whole degrees
    return {
        "waypointHeadingMode": "smoothTransition",
        "waypointHeadingAngle": turned,
        "waypointHeadingPathMode": "followBadArc",
    }


def _photo(row: _Waypoint) -> dict[str, Content]:
    return {
        "actionGroupId": row.number,
        "actionGroupStartIndex": row.number,
        "actionGroupEndIndex": row.number,
        "actionGroupMode": "sequence",
        "actionTrigger": {"actionTriggerType": "reachPoint"},
        "action": [
            {
                "actionId": 0,
                "actionActuatorFunc": "gimbalRotate",
                "actionActuatorFuncParam": {
                    "payloadPositionIndex": 0,
                    "gimbalHeadingYawBase": "north",
                    "gimbalRotateMode": "absoluteAngle",
                    "gimbalPitchRotateEnable": 1,
                    "gimbalPitchRotateAngle": f"{row.pitch:.2f}",
                    "gimbalRollRotateEnable": 0,
                    "gimbalRollRotateAngle": 0,
                    "gimbalYawRotateEnable": 0,
                    "gimbalYawRotateAngle": 0,
                    "gimbalRotateTimeEnable": 0,
                    "gimbalRotateTime": 0,
                },
            },
            {
                "actionId": 1,
                "actionActuatorFunc": "takePhoto",
                "actionActuatorFuncParam": {
                    "payloadPositionIndex": 0,
                    "fileSuffix": f"point{row.number + 1}",
                    "payloadLensIndex": "wide",
                    "useGlobalPayloadLensIndex": 0,
                },
            },
        ],
    }


def _height(value: float) -> str:
    return f"{value:.3f}"


def _document(
    mission: Mapping[str, Content],
    folder: Mapping[str, Content],
    waypoints: Sequence[Mapping[str, Content]],
    rows: Sequence[_Waypoint],
) -> bytes:
    marks = "".join(
        f"<Placemark><Point><coordinates>{row.longitude:.9f},{row.latitude:.9f}</coordinates></Point>"
        f"{_elements(waypoint)}</Placemark>\n"
        for waypoint, row in zip(waypoints, rows, strict=True)
    )
    return xml_bytes(
        f'<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="{_NAMESPACE}"><Document>{_elements(mission)}\n'
        f"<Folder>{_elements(folder)}\n{marks}</Folder></Document></kml>"
    )


def _elements(content: Mapping[str, Content]) -> str:
    return "".join(
        f"<wpml:{name}>{_elements(one) if isinstance(one, Mapping) else one}</wpml:{name}>"
        for name, value in content.items()
        for one in (value if isinstance(value, list) else [value])
    )


def xml_bytes(text: str) -> bytes:
    """Return a document of XML."""
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def zipped(files: Mapping[str, bytes]) -> bytes:
    """Return an archive; no clock goes in, so that equal plans give equal files."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)
    return stream.getvalue()
