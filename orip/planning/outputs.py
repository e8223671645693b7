"""Planned exposures as files for pilots and maps; what heights are above is said in each."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from xml.sax.saxutils import escape

import numpy as np

from orip.planning.designed import Given
from orip.planning.wpml import Waypoints, require_upright, waypoints_of, wpml_bytes, xml_bytes, zipped
from orip.records.control import Station
from orip.units import DEGREES_PER_RADIAN

_ABOVE_GROUND = "above the ground of the plan"
_ABOVE_ELLIPSOID = "above the ellipsoid of WGS 84"
_ABOVE_START = "above the ground of the plan below the first photo, where the flight has to start"
_OF_WPML = f"{_ABOVE_ELLIPSOID}; in the template for editing {_ABOVE_START}"
_OF_PROJECT = "those of the project"


def exported(form: str, stations: Sequence[Station], given: Given) -> tuple[bytes, str]:
    """Return the bytes of a file in one of the `FORMATS`, and what its heights are above.

    Raises
    ------
    InputError
        If the format has longitude and latitude, and the project no crs; or a drone cannot take a photo.
    """
    if form == "csv" or (form == "geojson" and given.state.project.definition.crs is None):
        return _LOCAL[form](stations), _OF_PROJECT
    write, heights = _GEOGRAPHIC[form]
    if form in _FOR_DRONES:
        require_upright(stations)
    return write(waypoints_of(stations, given)), heights


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


def _geojson(given: Waypoints) -> bytes:
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


def _kml(given: Waypoints) -> bytes:
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
    return xml_bytes(
        f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document><description>heights {_ABOVE_GROUND}</description>\n'
        f"{marks}{path}</Document></kml>"
    )


def _kmz(given: Waypoints) -> bytes:
    return zipped({"doc.kml": _kml(given)})


def _gpx(given: Waypoints) -> bytes:
    points = "".join(
        f'<rtept lat="{y:.9f}" lon="{x:.9f}"><ele>{z:.3f}</ele><name>{escape(one.photo)}</name></rtept>\n'
        for one, x, y, z in zip(given.stations, given.longitude, given.latitude, given.ellipsoid, strict=True)
    )
    return xml_bytes(
        '<gpx version="1.1" creator="orip" xmlns="http://www.topografix.com/GPX/1/1">'
        f"<rte><desc>ele is {_ABOVE_ELLIPSOID}</desc>\n{points}</rte></gpx>"
    )


_WAYPOINT, _TRIGGER, _GIMBAL = 16, 203, 205
"""MAVLink: MAV_CMD_NAV_WAYPOINT, MAV_CMD_DO_DIGICAM_CONTROL, MAV_CMD_DO_MOUNT_CONTROL."""

_RELATIVE, _MISSION, _BY_ANGLES = 3, 2, 2
"""MAV_FRAME_GLOBAL_RELATIVE_ALT, MAV_FRAME_MISSION, MAV_MOUNT_MODE_MAVLINK_TARGETING."""


def _qgc(given: Waypoints) -> bytes:
    items: list[dict[str, object]] = []

    def add(frame: int, code: int, params: list[float], **more: object) -> None:
        common = {"type": "SimpleItem", "autoContinue": True, "frame": frame, "command": code}
        items.append({**common, **more, "doJumpId": len(items) + 1, "params": params})

    before = None
    rows = zip(given.longitude, given.latitude, given.start, given.heading, given.pitch, strict=True)
    for x, y, z, heading, pitch in rows:
        height, turned = round(float(z), 3), round(float(pitch), 2)
        where = [0, 0, 0, round(float(heading), 2), float(y), float(x), height]
        add(_RELATIVE, _WAYPOINT, where, AltitudeMode=1, Altitude=height, AMSLAltAboveTerrain=None)
        if turned != before:
            add(_MISSION, _GIMBAL, [turned, 0, 0, 0, 0, 0, _BY_ANGLES])
        add(_MISSION, _TRIGGER, [0, 0, 0, 0, 1, 0, 0])
        before = turned
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


def _litchi(given: Waypoints) -> bytes:
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


_LOCAL: Mapping[str, Callable[[Sequence[Station]], bytes]] = {"csv": _csv, "geojson": _plain_geojson}
_GEOGRAPHIC: Mapping[str, tuple[Callable[[Waypoints], bytes], str]] = {
    "geojson": (_geojson, _ABOVE_ELLIPSOID),
    "kml": (_kml, _ABOVE_GROUND),
    "kmz": (_kmz, _ABOVE_GROUND),
    "gpx": (_gpx, _ABOVE_ELLIPSOID),
    "qgc": (_qgc, _ABOVE_START),
    "dji": (wpml_bytes, _OF_WPML),
    "litchi": (_litchi, _ABOVE_GROUND),
}
_FOR_DRONES = ("qgc", "dji", "litchi")
FORMATS = (*_GEOGRAPHIC, "csv")
