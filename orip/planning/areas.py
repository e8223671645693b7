"""Areas and lines of a plan: corners, GeoJSON or KML, taken to the project's system."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.files.text.lines import read_bytes
from orip.geometry.ground_crs import OUTSIDE, known_crs, outside_area
from orip.geometry.other_crs import crs_from_geographic, geographic_from_crs

_EARTH = 6.4e6
"""Metres of a radian on the ground, nearly."""

_LEAST_AREA = 3.0
"""Ground units; nobody flies over a smaller extent, and degrees of an area differ by less."""

_SAME_PLACE = 1.0
"""Metres between a corner and what its longitude and latitude give back, where the system has such a place."""


class _Shape(NamedTuple):
    """An area, or a line, and its corners (n, 2)."""

    is_area: bool
    corners: FloatArray


def read_outline(path: Path, shown: str, crs: str | None, *, is_line: bool) -> FloatArray:
    """Return the corners (n, 2) of the area, or line, of a GeoJSON or KML file, in the project's system.

    Both have longitude and latitude of WGS 84. Where longitudes jump by more than 180 degrees the area lies over the
    180th meridian. GeoJSON with a member ``coordinates`` has the project's own, as `orip export geojson` writes them
    without a crs.

    Raises
    ------
    InputError
        If it cannot be read, has not one such shape, or the project's system has no such place.
    """
    data, complaints = read_bytes(path, shown)
    if data is None:
        raise InputError(complaints)
    try:
        shapes, is_own = (_of_kml if path.suffix.lower() == ".kml" else _of_geojson)(data)
    except (ValueError, KeyError, TypeError, IndexError, RecursionError):
        message = (
            "this is no GeoJSON (.geojson, .json) or KML (.kml) with sound coordinates; draw the area or line in a map "
            "program, and save it as one of them"
        )
        raise InputError.single(message, shown) from None
    found = [shape.corners for shape in shapes if shape.is_area != is_line]
    if len(found) != 1:
        what = "line" if is_line else "area"
        number = f"{len(found)} {what}s, a plan has one; leave one {what} in it" if found else f"no {what}; draw one"
        message = f"it has {number}, or give corners in [plan]"
        raise InputError.single(message, shown)
    corners = found[0]
    if is_own:
        return corners
    if crs is None:
        message = (
            "the file has longitude and latitude, but the project has no crs; give crs in [project], or corners in "
            "[plan] in the project's own coordinates"
        )
        raise InputError.single(message, shown)
    return _in_project(corners, crs, shown)


def refuse_other_system(corners: FloatArray, crs: str | None, shown: str) -> None:
    """Raise an error of corners that are longitude and latitude, or have the northing before the easting.

    Without a crs the latter cannot be told.

    Parameters
    ----------
    corners : array (n, 2)
        Given as those of the project's system.

    Raises
    ------
    InputError
    """
    if (np.abs(corners) <= [360.0, 90.0]).all() and np.ptp(corners, axis=0).max(initial=0.0) < _LEAST_AREA:
        message = (
            "they seem to be longitude and latitude in degrees, as an area of a few ground units is not flown over; "
            "give them in the project's coordinates, or as area = a GeoJSON or KML file, with a crs in [project]"
        )
        raise InputError.single(message, shown)
    if crs is None:
        return
    x, y = np.mean(corners, axis=0)
    whole = known_crs(crs)
    places, _ = geographic_from_crs(np.array([[x, y, 0.0], [y, x, 0.0]]), crs, crs)
    (longitude, latitude), exchanged = np.degrees(places[:, :2])
    far = outside_area(whole, longitude, latitude)
    if not far <= OUTSIDE and outside_area(whole, *exchanged) <= OUTSIDE:
        message = f"X = {x:.0f}, Y = {y:.0f} is far outside crs {crs}, but within it if exchanged; X is the easting"
        raise InputError.single(message, shown)


def checked_outline(corners: FloatArray, shown: str, *, is_line: bool) -> FloatArray:
    """Return corners without the last one where it repeats the first, if they are a simple area or a line.

    Raises
    ------
    InputError
        If there are too few, the area crosses itself or has no size, or a corner comes twice in a row.
    """
    if not is_line and len(corners) > 1 and np.array_equal(corners[0], corners[-1]):
        corners = corners[:-1]
    fewest = 2 if is_line else 3
    if len(corners) < fewest:
        message = f"it has {len(corners)} corners; {'a line' if is_line else 'an area'} needs {fewest} at least"
        raise InputError.single(message, shown)
    ends = corners[1:] if is_line else np.roll(corners, -1, axis=0)
    sides = np.linalg.norm(ends - corners[: len(ends)], axis=1)
    if (sides == 0.0).any():
        message = f"corner {int(np.argmin(sides)) + 2} is the same as the one before; remove one of the two"
        raise InputError.single(message, shown)
    if is_line:
        return corners
    crossing = _crossing(corners)
    if crossing is not None:
        message = "sides {} and {} of the area cross each other; give the corners in their order along the border"
        raise InputError.single(message.format(*crossing), shown)
    extent = float(np.ptp(corners, axis=0).max())
    if abs(area_of(corners)) < 1e-9 * extent**2:
        message = "the area has no size: all its corners are on one line; for a corridor give its width"
        raise InputError.single(message, shown)
    return corners


def area_of(corners: FloatArray) -> float:
    """Return the area of a polygon, positive where its corners run counter-clockwise."""
    x, y = (corners - corners[0]).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _of_geojson(data: bytes) -> tuple[Sequence[_Shape], bool]:
    document = json.loads(data)
    is_own = isinstance(document, dict) and "coordinates" in document and "features" in document
    return list(_shapes(document)), is_own


def _shapes(document: Any) -> Iterator[_Shape]:
    if not isinstance(document, dict):
        return
    kind, places = str(document.get("type", "")), document.get("coordinates") or []
    for one in places if kind.startswith("Multi") else [places]:
        if kind.endswith("Polygon"):
            yield _Shape(True, _sound([place[:2] for place in one[0]]))
        elif kind.endswith("LineString"):
            yield _Shape(False, _sound([place[:2] for place in one]))
    for one in [*document.get("features", ()), *document.get("geometries", ()), document.get("geometry")]:
        yield from _shapes(one)


def _sound(rows: list[Any]) -> FloatArray:
    """Return coordinates (n, 2); ValueError where they are none."""
    corners = np.array(rows, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise ValueError
    return corners


def _of_kml(data: bytes) -> tuple[Sequence[_Shape], bool]:
    # entities are never expanded: a file of a stranger's may hold any
    from xml.parsers import expat

    inside: list[str] = []
    words: list[str] = []
    found: list[_Shape] = []

    def start(name: str, _attributes: object) -> None:
        inside.append(name.rpartition(":")[2])
        words.clear()

    def end(_name: str) -> None:
        is_area = "Polygon" in inside
        if inside.pop() != "coordinates" or "innerBoundaryIs" in inside or not {"Polygon", "LineString"} & {*inside}:
            return
        rows = [[float(number) for number in place.split(",")[:2]] for place in "".join(words).split()]
        found.append(_Shape(is_area, _sound(rows)))

    def refuse(*_given: object) -> None:
        raise ValueError

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = words.append
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ValueError from error
    return found, False


def _in_project(corners: FloatArray, crs: str, shown: str) -> FloatArray:
    longitude, latitude = corners.T
    if (np.abs(latitude) > 90.0).any() or (np.abs(longitude) > 360.0).any():
        message = "longitude and latitude are out of range; GeoJSON and KML give the longitude first, in degrees"
        raise InputError.single(message, shown)
    if np.ptp(longitude) > 180.0:  # over the 180th meridian
        longitude = np.where(longitude < 0.0, longitude + 360.0, longitude)
    _refuse_exchanged(float(np.median(longitude)), float(np.median(latitude)), crs, shown)
    given = np.column_stack([longitude, latitude, np.zeros(len(corners))])
    try:
        geographic, _ = geographic_from_crs(given, "EPSG:4979", crs)
        found = crs_from_geographic(geographic, crs, crs)
        back, _ = geographic_from_crs(found, crs, crs)
    except InputError as error:
        message = f"the area is outside crs {crs} ({error}); choose a crs for its place"
        raise InputError.single(message, shown) from None
    off = np.abs(np.mod(back[:, :2] - geographic[:, :2] + np.pi, 2.0 * np.pi) - np.pi)
    off[:, 0] *= np.cos(geographic[:, 1])
    if not np.isfinite(found).all() or not (off * _EARTH < _SAME_PLACE).all():
        message = f"the area is where crs {crs} does not reach; choose a crs for its place (polar for the poles)"
        raise InputError.single(message, shown)
    return found[:, :2]


def _refuse_exchanged(longitude: float, latitude: float, crs: str, shown: str) -> None:
    whole = known_crs(crs)
    if outside_area(whole, longitude, latitude) > OUTSIDE and outside_area(whole, latitude, longitude) <= OUTSIDE:
        message = (
            f"the area is at {longitude:.3f}° E {latitude:.3f}° N, far outside crs {crs}, but within it if exchanged; "
            "GeoJSON and KML give the longitude first"
        )
        raise InputError.single(message, shown)


def _crossing(corners: FloatArray) -> tuple[int, int] | None:
    """Return two sides, counted from 1, that meet elsewhere than in a common corner; None: there are none."""
    count, ends = len(corners), np.roll(corners, -1, axis=0)
    for one in range(count):
        others = np.arange(one + 2, count - (one == 0))
        a, b, c, d = corners[one], ends[one], corners[others], ends[others]
        met = (_side(a, b, c) * _side(a, b, d) <= 0.0) & (_side(c, d, a) * _side(c, d, b) <= 0.0)
        # sides on one line meet only where their extents do
        low, high = np.minimum(a, b), np.maximum(a, b)
        met &= ((np.minimum(c, d) <= high) & (np.maximum(c, d) >= low)).all(axis=1)
        if met.any():
            return one + 1, int(others[np.argmax(met)]) + 1
    return None


def _side(a: FloatArray, b: FloatArray, p: FloatArray) -> FloatArray:
    one, other = b - a, p - a
    return np.asarray(np.sign(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]))
