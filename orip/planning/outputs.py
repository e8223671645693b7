"""Planned exposures as files for pilots and maps; what heights are above is said in each."""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
import zipfile
from collections.abc import Callable, Mapping, Sequence
from xml.sax.saxutils import escape

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.geometry.other_crs import crs_from_geographic, geographic_from_crs
from orip.geometry.rotation import rotation_from_angles
from orip.planning.designed import Given
from orip.records.control import Station
from orip.units import DEGREES_PER_RADIAN

_ABOVE_GROUND = "above the ground of the plan"
_ABOVE_ELLIPSOID = "above the ellipsoid of WGS 84"
_ABOVE_START = "above the ground of the plan below the first photo, where the flight has to start"
_OF_PROJECT = "those of the project"


class _Waypoints(Struct, frozen=True):
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


def exported(form: str, stations: Sequence[Station], given: Given) -> tuple[bytes, str]:
    """Return the bytes of a file in one of the `FORMATS`, and what its heights are above.

    Raises
    ------
    InputError
        If the format has longitude and latitude, and the project no crs.
    """
    if form == "csv" or (form == "geojson" and given.state.project.definition.crs is None):
        return _LOCAL[form](stations), _OF_PROJECT
    write, heights = _GEOGRAPHIC[form]
    return write(_waypoints(stations, given)), heights


def _waypoints(stations: Sequence[Station], given: Given) -> _Waypoints:
    crs = given.state.project.definition.crs
    if crs is None:
        message = "the project has no crs, so that exposures have no longitude and latitude; give crs in [project]"
        raise InputError.single(message, "orip.toml")
    places = np.array([station.position for station in stations])
    rotations = rotation_from_angles(np.array([station.angles for station in stations]))
    there = _geographic(places, crs)
    ahead = places.copy()
    ahead[:, :2] += rotations[:, :2, 1] / np.maximum(np.linalg.norm(rotations[:, :2, 1], axis=1, keepdims=True), 1e-12)
    step = _geographic(ahead, crs) - there
    heading = np.arctan2(step[:, 0] * np.cos(np.radians(there[:, 1])), step[:, 1]) * DEGREES_PER_RADIAN
    ground = given.terrain(places[:, :2])
    pitch = np.arcsin(np.clip(-rotations[:, 2, 2], -1.0, 1.0)) * DEGREES_PER_RADIAN
    return _Waypoints(
        stations, there[:, 0], there[:, 1], there[:, 2], places[:, 2] - ground, places[:, 2] - ground[0],
        np.mod(heading, 360.0), pitch, _speed(stations),
    )  # fmt: skip


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


def _csv(stations: Sequence[Station]) -> bytes:
    stream = io.StringIO()
    rows = csv.writer(stream, lineterminator="\n")
    rows.writerow(["photo", "X", "Y", "Z", "OMEGA", "PHI", "KAPPA", "time", "strip"])
    for one in stations:
        angles = [f"{angle * DEGREES_PER_RADIAN:.6f}" for angle in one.angles]
        rows.writerow([one.photo, *(f"{value:.4f}" for value in one.position), *angles, one.time, one.strip])
    return stream.getvalue().encode()


def _plain_geojson(stations: Sequence[Station]) -> bytes:
    note = "those of the project, which has no crs: not longitude and latitude"
    return _collection([list(one.position) for one in stations], stations, {"coordinates": note})


def _geojson(given: _Waypoints) -> bytes:
    places = np.column_stack([given.longitude, given.latitude, given.ellipsoid]).tolist()
    return _collection(places, given.stations, {"heights": _ABOVE_ELLIPSOID})


def _collection(places: list[list[float]], stations: Sequence[Station], said: Mapping[str, str]) -> bytes:
    features = [
        {
            "type": "Feature",
            "properties": {"name": one.photo, "strip": one.strip},
            "geometry": {"type": "Point", "coordinates": place},
        }
        for one, place in zip(stations, places, strict=True)
    ]
    path = {
        "type": "Feature",
        "properties": {"name": "path"},
        "geometry": {"type": "LineString", "coordinates": places},
    }
    whole = {"type": "FeatureCollection", **said, "features": [*features, path]}
    return (json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _kml(given: _Waypoints) -> bytes:
    places = [f"{x:.9f},{y:.9f},{z:.3f}" for x, y, z in zip(given.longitude, given.latitude, given.ground, strict=True)]
    marks = "".join(
        f"<Placemark><name>{escape(one.photo)}</name><Point><altitudeMode>relativeToGround</altitudeMode>"
        f"<coordinates>{place}</coordinates></Point></Placemark>\n"
        for one, place in zip(given.stations, places, strict=True)
    )
    path = (
        "<Placemark><name>path</name><LineString><altitudeMode>relativeToGround</altitudeMode>"
        f"<coordinates>{' '.join(places)}</coordinates></LineString></Placemark>\n"
    )
    return _xml(
        f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document><description>heights {_ABOVE_GROUND}</description>\n'
        f"{marks}{path}</Document></kml>"
    )


def _kmz(given: _Waypoints) -> bytes:
    return _zipped({"doc.kml": _kml(given)})


def _gpx(given: _Waypoints) -> bytes:
    points = "".join(
        f'<rtept lat="{y:.9f}" lon="{x:.9f}"><ele>{z:.3f}</ele><name>{escape(one.photo)}</name></rtept>\n'
        for one, x, y, z in zip(given.stations, given.longitude, given.latitude, given.ellipsoid, strict=True)
    )
    return _xml(
        '<gpx version="1.1" creator="orip" xmlns="http://www.topografix.com/GPX/1/1">'
        f"<rte><desc>ele is {_ABOVE_ELLIPSOID}</desc>\n{points}</rte></gpx>"
    )


_WAYPOINT, _TRIGGER, _RELATIVE = 16, 203, 3
"""MAVLink: MAV_CMD_NAV_WAYPOINT, MAV_CMD_DO_DIGICAM_CONTROL, MAV_FRAME_GLOBAL_RELATIVE_ALT."""


def _qgc(given: _Waypoints) -> bytes:
    items: list[dict[str, object]] = []
    rows = zip(given.longitude, given.latitude, given.start, given.heading, strict=True)
    for x, y, z, heading in rows:
        common = {"type": "SimpleItem", "autoContinue": True, "frame": _RELATIVE}
        place = {"AltitudeMode": 1, "Altitude": round(float(z), 3), "AMSLAltAboveTerrain": None}
        where = [0, 0, 0, round(float(heading), 2), float(y), float(x), round(float(z), 3)]
        items.append({**common, **place, "command": _WAYPOINT, "doJumpId": len(items) + 1, "params": where})
        shoot = {"type": "SimpleItem", "autoContinue": True, "frame": 2, "command": _TRIGGER}
        items.append({**shoot, "doJumpId": len(items) + 1, "params": [0, 0, 0, 0, 1, 0, 0]})
    speed = round(given.speed, 2)
    home = [float(given.latitude[0]), float(given.longitude[0]), 0]
    mission = {
        "version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": speed, "hoverSpeed": speed,
        "plannedHomePosition": home, "items": items,
    }  # fmt: skip
    whole = {
        "fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": mission,
        "geoFence": {"version": 2, "circles": [], "polygons": []}, "rallyPoints": {"version": 2, "points": []},
    }  # fmt: skip
    return (json.dumps(whole, indent=1) + "\n").encode()


_WPML = "http://www.dji.com/wpmz/1.0.2"


def _dji(given: _Waypoints) -> bytes:
    config = (
        "<wpml:missionConfig><wpml:flyToWaylineMode>safely</wpml:flyToWaylineMode>"
        "<wpml:finishAction>goHome</wpml:finishAction><wpml:exitOnRCLost>executeLostAction</wpml:exitOnRCLost>"
        "<wpml:executeRCLostAction>goBack</wpml:executeRCLostAction>"
        f"<wpml:globalTransitionalSpeed>{given.speed:.2f}</wpml:globalTransitionalSpeed></wpml:missionConfig>"
    )
    marks = "".join(map(_dji_mark, range(len(given.stations)), *_columns(given)))
    head = f'<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="{_WPML}"><Document>{config}'
    waylines = (
        f"{head}<Folder><wpml:templateId>0</wpml:templateId><wpml:executeHeightMode>WGS84</wpml:executeHeightMode>"
        f"<wpml:waylineId>0</wpml:waylineId><wpml:autoFlightSpeed>{given.speed:.2f}</wpml:autoFlightSpeed>\n"
        f"{marks}</Folder></Document></kml>"
    )
    template = f"{head}</Document></kml>"
    return _zipped({"wpmz/template.kml": _xml(template), "wpmz/waylines.wpml": _xml(waylines)})


def _columns(given: _Waypoints) -> tuple[list[float], ...]:
    table = (given.longitude, given.latitude, given.ellipsoid, given.heading, given.pitch)
    return tuple(column.tolist() for column in table)


def _dji_mark(number: int, x: float, y: float, z: float, heading: float, pitch: float) -> str:
    turned = (heading + 180.0) % 360.0 - 180.0
    return (
        f"<Placemark><Point><coordinates>{x:.9f},{y:.9f}</coordinates></Point><wpml:index>{number}</wpml:index>"
        f"<wpml:executeHeight>{z:.3f}</wpml:executeHeight><wpml:waypointHeadingParam><wpml:waypointHeadingMode>"
        f"smoothTransition</wpml:waypointHeadingMode><wpml:waypointHeadingAngle>{turned:.2f}"
        "</wpml:waypointHeadingAngle></wpml:waypointHeadingParam><wpml:waypointTurnParam><wpml:waypointTurnMode>"
        "toPointAndStopWithDiscontinuityCurvature</wpml:waypointTurnMode></wpml:waypointTurnParam>"
        f"<wpml:actionGroup><wpml:actionGroupId>{number}</wpml:actionGroupId><wpml:actionGroupStartIndex>{number}"
        f"</wpml:actionGroupStartIndex><wpml:actionGroupEndIndex>{number}</wpml:actionGroupEndIndex>"
        "<wpml:actionTrigger><wpml:actionTriggerType>reachPoint</wpml:actionTriggerType></wpml:actionTrigger>"
        "<wpml:action><wpml:actionId>0</wpml:actionId><wpml:actionActuatorFunc>gimbalRotate</wpml:actionActuatorFunc>"
        f"<wpml:actionActuatorFuncParam><wpml:gimbalPitchRotateAngle>{pitch:.2f}</wpml:gimbalPitchRotateAngle>"
        "</wpml:actionActuatorFuncParam></wpml:action><wpml:action><wpml:actionId>1</wpml:actionId>"
        "<wpml:actionActuatorFunc>takePhoto</wpml:actionActuatorFunc></wpml:action></wpml:actionGroup></Placemark>\n"
    )


def _litchi(given: _Waypoints) -> bytes:
    stream = io.StringIO()
    rows = csv.writer(stream, lineterminator="\n")
    rows.writerow(
        ["latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir", "gimbalmode",
         "gimbalpitchangle", "actiontype1", "actionparam1", "altitudemode", "speed(m/s)"]
    )  # fmt: skip
    for x, y, z, heading, pitch in zip(
        given.longitude, given.latitude, given.ground, given.heading, given.pitch, strict=True
    ):
        # gimbal mode 2 interpolates to the angle given, action 1 takes a photo, altitude mode 1 is above ground
        rows.writerow(
            [
                f"{y:.9f}",
                f"{x:.9f}",
                f"{z:.3f}",
                f"{heading:.2f}",
                0,
                0,
                2,
                f"{pitch:.2f}",
                1,
                0,
                1,
                round(given.speed, 2),
            ]
        )
    return stream.getvalue().encode()


def _xml(text: str) -> bytes:
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _zipped(files: Mapping[str, bytes]) -> bytes:
    """Return an archive; no clock goes in, so that equal plans give equal files."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)
    return stream.getvalue()


_LOCAL: Mapping[str, Callable[[Sequence[Station]], bytes]] = {"csv": _csv, "geojson": _plain_geojson}
_GEOGRAPHIC: Mapping[str, tuple[Callable[[_Waypoints], bytes], str]] = {
    "geojson": (_geojson, _ABOVE_ELLIPSOID),
    "kml": (_kml, _ABOVE_GROUND),
    "kmz": (_kmz, _ABOVE_GROUND),
    "gpx": (_gpx, _ABOVE_ELLIPSOID),
    "qgc": (_qgc, _ABOVE_START),
    "dji": (_dji, _ABOVE_ELLIPSOID),
    "litchi": (_litchi, _ABOVE_GROUND),
}
FORMATS = (*_GEOGRAPHIC, "csv")
