"""DJI's WPML: a KMZ of what the drone executes, and of the template that Pilot 2 edits.

After the tables of elements in https://github.com/dji-sdk/Cloud-API-Doc, docs/en/60.api-reference/00.dji-wpml. The
drone itself (droneInfo, payloadInfo) is not named, as no plan knows it.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from typing import TypeAlias

from msgspec import Struct

from orip.planning.waypoints import Waypoints

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
