"""Terrain of a plan: one height, heights of control, or a GeoTIFF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError, UsageError
from orip.files.text.lines import read_bytes
from orip.geometry.ground_crs import known_crs
from orip.planning.geometry import Terrain
from orip.records.control import ControlPoint


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
    """Return terrain of the first band of a GeoTIFF, bilinear; its heights are those of the project.

    Places are taken to the raster's system where it has one, and the project has another.

    Raises
    ------
    InputError
        If it cannot be read; and when heights are asked for where it has none.
    UsageError
        Without rasterio.
    """
    try:
        import rasterio
    except ImportError:
        message = "a GeoTIFF is read by rasterio: pip install 'orip[terrain]'"
        raise UsageError(message) from None
    from scipy.ndimage import map_coordinates

    data, complaints = read_bytes(path, shown)
    if data is None:
        raise InputError(complaints)
    try:
        with rasterio.MemoryFile(data) as memory, memory.open() as source:
            values = source.read(1, masked=True).astype(np.float64).filled(np.nan)
            inverse, own = ~source.transform, source.crs
    except rasterio.errors.RasterioError as error:
        message = f"this is no raster that can be read ({error}); give a GeoTIFF of heights"
        raise InputError.single(message, shown) from None

    to_raster = _to_raster(crs, None if own is None else own.to_wkt())

    def heights(places: FloatArray) -> FloatArray:
        column, row = _applied(inverse, to_raster(places))
        # pixels are areas: a height is that of the middle of its pixel
        at = np.array([row - 0.5, column - 0.5])
        size = np.array(values.shape)[:, None]
        inside = ((at > -0.5 - 1e-9) & (at < size - 0.5 + 1e-9)).all(axis=0)
        found = map_coordinates(values, np.clip(at, 0.0, size - 1.0), order=1, mode="nearest")
        if not np.isfinite(found[inside]).all() or not inside.all():
            missing = places[~inside | ~np.isfinite(found)][0]
            message = (
                f"the terrain has no height at {missing[0]:.1f}, {missing[1]:.1f}, and at "
                f"{int((~inside | ~np.isfinite(found)).sum())} of {len(places)} places asked for; fill its holes, or "
                "give a raster that reaches beyond the border by a photo"
            )
            raise InputError.single(message, shown)
        return np.asarray(found)

    return heights


def _to_raster(crs: str | None, own: str | None) -> Callable[[FloatArray], FloatArray]:
    """Return what takes places (n, 2) of the project to the system of a raster."""
    if crs is None or own is None:
        return lambda places: places
    from pyproj import Transformer

    raster = known_crs(own)
    transformer = Transformer.from_crs(known_crs(crs).to_2d(), raster.to_2d(), always_xy=True)
    return lambda places: np.column_stack(transformer.transform(places[:, 0], places[:, 1]))


def _applied(transform: Any, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the column and row of places, by the six numbers of an affine transformation."""
    a, b, c, d, e, f = tuple(transform)[:6]
    return a * places[:, 0] + b * places[:, 1] + c, d * places[:, 0] + e * places[:, 1] + f
