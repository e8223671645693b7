"""Control and positions of the photos that are in different systems or units: far apart, and near if read otherwise."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.geometry.other_crs import readings_in_another_grid
from orip.mistakes.mistake import STATIONS_OFF, Consequence, declare
from orip.mistakes.other_units import LENGTH_UNITS
from orip.records.control import Control
from orip.records.names import record_key
from orip.wording import counted_names

_OTHER_SIZES = Consequence(warnings=("error-unit", "errors-too-small", "distance-unit"), groups=("distance",))
"""Coordinates in another unit make their errors those of no survey."""

GROUND_SYSTEM, IN_DEGREES = CODES = (
    declare(
        "ground-system", "control and positions of the photos are in different systems", STATIONS_OFF, _OTHER_SIZES,
        explains_misfit=True, comes_first=True,
    ),
    declare(
        "degrees", "longitude and latitude in degrees stand beside coordinates in units of length", STATIONS_OFF,
        _OTHER_SIZES, explains_misfit=True, comes_first=True,
    ),
)  # fmt: skip

OUTSIDE_AREA = declare("crs-outside-area", comes_first=True)
"""Of a block that lies far outside the area that its crs is made for; found where the crs is."""

_FAR, _NEAR = 20.0, 3.0
"""Distances of control and photos, as parts of the larger extent of the two: what cannot be, and what is usual."""

_FEWEST_PLACES = 3

_ZONE = 1e6
"""Eastings have six digits before the decimal point; what precedes them is the zone."""

_ZONES = (1, 60)

_METRES_PER_DEGREE = 1.1e5

_NEAR_EQUATOR = 3e5
"""Metres that a northing is from the length of the meridian at most."""

_LARGEST_AREA = 5.0
"""Degrees from one end of a block to the other."""

_OF_ONE_BLOCK = 30.0
"""Ratio of the extents of control and photos up to which they are those of one block."""

_ANGLES = np.array([180.0, 90.0])

Reading = tuple[FloatArray, FloatArray, str]
"""Control and photos (n, 2) as they were probably meant, and what is wrong then."""


def contradicting_ground_systems(control: Control, given: FloatArray) -> list[ProjectWarning]:
    """Return a warning if control is far from where the photos were taken, and near it if read differently.

    Parameters
    ----------
    control : Control
        Of the project, with its exposure stations in the project's coordinates.
    given : array (n, 2)
        X0 and Y0 of the photos, NaN where not given.
    """
    in_project = not control.station_reference.crs
    observed = [station.position[:2] for station in control.stations if station.has_position and in_project]
    in_elements = _centres_of_elements(control)
    of_stations, observed = bool(observed), [*observed, *in_elements]
    places = np.vstack([np.array(observed, dtype=np.float64).reshape(-1, 2), given])
    places = places[np.isfinite(places).all(axis=1)]
    known = [point for point in control.points if None not in point.coordinates[:2]]
    if len(places) < _FEWEST_PLACES or not known:
        return []
    points = np.array([point.coordinates[:2] for point in known], dtype=np.float64)
    if _apart(points, places) < _FAR:
        return []
    where = counted_names("control point", [point.name for point in known])
    file = ".STA" if of_stations else ".ELE" if in_elements else "orip.toml"
    if text := _degrees(points, places, file):
        return [
            ProjectWarning(
                IN_DEGREES, where if text.endswith("of these") else f"positions of the photos in {file}", text
            )
        ]
    other = "exposure stations" if of_stations else "photos"
    readings = chain(
        _units(points, places, other),
        _zones(points, places, other),
        _exchanged(points, places, other, file),
        _grids(points, places, other),
    )
    tried = (
        (_apart(read, photos), text)
        for read, photos, text in readings
        if np.isfinite(read).all() and _are_of_one_block(read, photos)
    )
    apart, text = min(tried, key=lambda found: found[0] if np.isfinite(found[0]) else np.inf, default=(np.inf, ""))
    return [ProjectWarning(GROUND_SYSTEM, where, text)] if apart < _NEAR else []


def _centres_of_elements(control: Control) -> list[tuple[float, float]]:
    """Return X0 and Y0 of the photos of which both are observed."""
    values: dict[str, dict[str, float]] = {}
    for element in control.elements:
        if element.group == "PHOTO":
            values.setdefault(record_key(element.name), {})[element.kind] = element.value
    return [(found["X0"], found["Y0"]) for found in values.values() if {"X0", "Y0"} <= set(found)]


def _degrees(points: FloatArray, places: FloatArray, file: str) -> str:
    """Return that positions of the photos, or the control, are in degrees; "" where neither is."""
    for concerned, others in ((places, points), (points, places)):
        extent, other = (float(np.ptp(which, axis=0).max()) for which in (concerned, others))
        # latitude may come first
        are_angles = any((np.abs(concerned[:, order]) <= _ANGLES).all() for order in ([0, 1], [1, 0]))
        is_length = bool((np.abs(np.median(others, axis=0)) > _ANGLES.max()).any())
        if not (are_angles and is_length and 0.0 < extent < _LARGEST_AREA and other > 0.0):
            continue
        if not _is_like(extent * _METRES_PER_DEGREE, other):
            continue
        x, y = np.median(concerned, axis=0).tolist()
        northing = float(np.median(others[:, 1]))
        # northings count from the equator, or near it
        is_reversed = abs(northing - x * _METRES_PER_DEGREE) < _NEAR_EQUATOR < abs(northing - y * _METRES_PER_DEGREE)
        names = "latitude and longitude" if is_reversed else "longitude and latitude"
        are = f"X and Y, about {x:.6g} and {y:.6g}, are {names} in degrees"
        if concerned is points:
            return (
                f"{are}, unlike the positions of "
                f"the photos in {file}: convert the control to easting and northing in the system of these"
            )
        text = (
            f"{are}, and the control is in units "
            "of length: convert them to easting and northing in the system of the control"
        )
        by_heading = (
            f"; or {'exchange them, ' if is_reversed else ''}write 'CRS EPSG:4326' as the first line of the .STA file, "
            "and the system of the control as crs in [project]"
        )
        return f"{text}{by_heading if file == '.STA' else ''}"
    return ""


def _apart(points: FloatArray, places: FloatArray) -> float:
    """Return the distance of the middles of points and places over the larger extent of the two."""
    extent = max(float(np.ptp(points, axis=0).max()), float(np.ptp(places, axis=0).max()), 1e-9)
    return float(np.linalg.norm(np.median(points, axis=0) - np.median(places, axis=0))) / extent


def _are_of_one_block(points: FloatArray, places: FloatArray) -> bool:
    """Tell whether the extents of points and places are those of one block; of a single point nothing is known."""
    extents = [float(np.ptp(which, axis=0).max()) for which in (points, places)]
    return min(extents) == 0.0 or _is_like(*extents)


def _is_like(extent: float, other: float) -> bool:
    return bool(abs(np.log(extent / other)) < np.log(_OF_ONE_BLOCK))


def _units(points: FloatArray, places: FloatArray, other: str) -> Iterator[Reading]:
    for factor, (unit, of_others) in LENGTH_UNITS.items():
        feet = " (US survey feet: 1200/3937 m, international feet: 0.3048 m)" if "feet" in (unit, of_others) else ""
        text = (
            f"they are near the {other} when multiplied by {factor:.5g}: they seem to be in {unit}, and the {other} in "
            f"{of_others}; write both in one unit{feet}"
        )
        yield points * factor, places, text


def _grids(points: FloatArray, places: FloatArray, other: str) -> Iterator[Reading]:
    remedy = "convert one of the two, so that both are in one system, as a program for map grids does"
    for read, own, others in readings_in_another_grid(points, places):
        yield read, places, f"they seem to be {own}, and those of the {other} {others}: {remedy}"
    for read, own, others in readings_in_another_grid(places, points):
        yield points, read, f"they seem to be {others}, and those of the {other} {own}: {remedy}"


def _zones(points: FloatArray, places: FloatArray, other: str) -> Iterator[Reading]:
    for concerned, is_control in ((points, True), (places, False)):
        zones = np.unique(np.floor(concerned[:, 0] / _ZONE))
        if len(zones) == 1 and _ZONES[0] <= zones[0] <= _ZONES[1]:
            zone = int(zones[0])
            without = concerned - [zone * _ZONE, 0.0]
            own, others = ("their X", f"those of the {other}") if is_control else (f"X of the {other}", "theirs")
            text = (
                f"{own} begins with the number of a zone, {zone}, and {others} {'do' if is_control else 'does'} not: "
                "write eastings of six digits before the decimal point in all files"
            )
            yield (without, places, text) if is_control else (points, without, text)


def _exchanged(points: FloatArray, places: FloatArray, other: str, file: str) -> Iterator[Reading]:
    easting, northing = np.median(points, axis=0).tolist()
    control, photos = "the control file", "orip.toml" if file == "orip.toml" else f"the {file} file"
    # what has six digits before the decimal point is the easting, where the other one has seven
    wrong = photos if 0.0 < easting < _ZONE <= northing else control if northing < _ZONE <= easting else ""
    text = (
        f"they are near the {other} when X and Y are exchanged: X is the easting, Y the northing; exchange the columns "
        f"X and Y of {wrong or f'{control}, or those of {photos}'}"
    )
    yield points[:, ::-1], places, text
