"""Areas and terrain of a plan: corners, GeoJSON or KML in the project's system; heights of control or a GeoTIFF."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.files.height_raster import read_height_raster
from orip.files.text.lines import read_bytes
from orip.geometry.height_grid import other_system, surface_at
from orip.geometry.other_crs import crs_from_geographic, geographic_from_crs
from orip.planning.geometry import Terrain
from orip.records.control import ControlPoint

_EARTH = 6.4e6
"""Metres of a radian on the ground, nearly."""

_SAME_PLACE = 1.0
"""Metres between a corner and what its longitude and latitude give back, where the system has such a place."""


def read_outline(path: Path, shown: str, crs: str | None, *, is_line: bool) -> FloatArray:
    """Return the corners (n, 2) of the first area, or line, of a GeoJSON or KML file, in the project's system.

    Both have longitude and latitude of WGS 84. Where longitudes jump by more than 180 degrees the area lies over the
    180th meridian. GeoJSON with a member ``coordinates`` has the project's own, as `orip export geojson` writes them
    without a crs.

    Raises
    ------
    InputError
        If it cannot be read, has no such shape, or the project's system has no such place.
    """
    data, complaints = read_bytes(path, shown)
    if data is None:
        raise InputError(complaints)
    corners, is_own = _of_kml(data, shown) if path.suffix.lower() == ".kml" else _of_geojson(data, shown, is_line)
    if is_own:
        return corners
    if crs is None:
        message = (
            "the file has longitude and latitude, but the project has no crs; give crs in [project], or corners in "
            "[plan] in the project's own coordinates"
        )
        raise InputError.single(message, shown)
    return _in_project(corners, crs, shown)


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


def level(height: float) -> Terrain:
    """Return terrain of one height."""
    return lambda places: np.full(len(places), height)


def terrain_of_points(points: Sequence[ControlPoint], shown: str) -> Terrain:
    """Return terrain through the points of a .PNT file: linear in their triangles, the nearest one outside.

    Raises
    ------
    InputError
        If fewer than three have all coordinates.
    """
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

    known = np.array([p.coordinates for p in points if None not in p.coordinates and not p.rejected], dtype=np.float64)
    if len(known) < 3 or np.linalg.matrix_rank(known[:, :2] - known[:1, :2]) < 2:
        message = 'terrain = "control" needs three points at least with X, Y and Z, not on one line; or give ground'
        raise InputError.single(message, shown)
    inside, outside = LinearNDInterpolator(known[:, :2], known[:, 2]), NearestNDInterpolator(known[:, :2], known[:, 2])

    def heights(places: FloatArray) -> FloatArray:
        found: FloatArray = inside(places)
        return np.where(np.isnan(found), outside(places), found)

    return heights


def terrain_of_raster(path: Path, shown: str, crs: str | None) -> Terrain:
    """Return terrain of the first band of a GeoTIFF in the project's system.

    Raises
    ------
    InputError
        If it cannot be read or is in another system; and when heights are asked for where it has none.
    UsageError
        Without rasterio.
    """
    grid = read_height_raster(path, shown)
    if (difference := other_system(grid, crs)) is not None:
        message = f"{difference}; convert the raster into the project's system (gdalwarp), and give that"
        raise InputError.single(message, shown)

    def heights(places: FloatArray) -> FloatArray:
        found = surface_at(grid, places)
        if not found.known.all():
            x, y = places[~found.known][0].tolist()
            message = (
                f"the terrain has no height at {x:.1f}, {y:.1f}, and at {int((~found.known).sum())} of {len(places)} "
                "places asked for; fill its holes, or give a raster that reaches beyond the border by a photo"
            )
            raise InputError.single(message, shown)
        return found.height

    return heights


def _of_geojson(data: bytes, shown: str, is_line: bool) -> tuple[FloatArray, bool]:
    wanted = "LineString" if is_line else "Polygon"
    try:
        document = json.loads(data)
        shape = next(_shapes(document, wanted), None)
        if shape is None:
            message = f"there is no {wanted} in it; draw one, or give corners in [plan]"
            raise InputError.single(message, shown)
        ring = shape["coordinates"] if is_line else shape["coordinates"][0]
        corners = _sound([place[:2] for place in ring])
    except (ValueError, KeyError, TypeError, IndexError, RecursionError):
        message = "this is no GeoJSON with sound coordinates; write a FeatureCollection with a Polygon or LineString"
        raise InputError.single(message, shown) from None
    return corners, isinstance(document, dict) and "coordinates" in document and "features" in document


def _sound(rows: list[Any]) -> FloatArray:
    """Return coordinates (n, 2); ValueError where they are none."""
    corners = np.array(rows, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise ValueError
    return corners


def _shapes(document: Any, wanted: str) -> Any:
    if not isinstance(document, dict):
        return
    if document.get("type") == wanted:
        yield document
    for one in document.get("features", ()):
        yield from _shapes(one, wanted)
    yield from _shapes(document.get("geometry"), wanted)


def _of_kml(data: bytes, shown: str) -> tuple[FloatArray, bool]:
    # entities are never expanded: a file of a stranger's may hold any
    from xml.parsers import expat

    words: list[str] = []
    inside: list[bool] = [False]

    def start(name: str, _attributes: object) -> None:
        inside[0] = name.rpartition(":")[2] == "coordinates" and not words

    def end(_name: str) -> None:
        inside[0] = False

    def text(part: str) -> None:
        if inside[0]:
            words.append(part)

    def refuse(*_given: object) -> None:
        raise ValueError

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, text
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
        rows = [[float(number) for number in place.split(",")[:2]] for place in "".join(words).split()]
        corners = _sound(rows)
    except (expat.ExpatError, ValueError):
        message = "this is no KML with sound coordinates; write a Placemark with a Polygon or LineString"
        raise InputError.single(message, shown) from None
    return corners, False


def _in_project(corners: FloatArray, crs: str, shown: str) -> FloatArray:
    longitude, latitude = corners.T
    if (np.abs(latitude) > 90.0).any() or (np.abs(longitude) > 360.0).any():
        message = "longitude and latitude are out of range; GeoJSON and KML give the longitude first, in degrees"
        raise InputError.single(message, shown)
    if np.ptp(longitude) > 180.0:  # over the 180th meridian
        longitude = np.where(longitude < 0.0, longitude + 360.0, longitude)
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
