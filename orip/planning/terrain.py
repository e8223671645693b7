"""Terrain of a plan: one height, heights of control, or a GeoTIFF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.files.height_raster import read_height_raster
from orip.geometry.ground_crs import known_crs
from orip.geometry.height_grid import surface_at
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
    """Return terrain of the first band of a GeoTIFF; its heights are those of the project.

    Places are taken to the raster's system where it has one, and the project has another.

    Raises
    ------
    InputError
        If it cannot be read; and when heights are asked for where it has none.
    UsageError
        Without rasterio.
    """
    grid = read_height_raster(path, shown)
    to_raster = _to_raster(crs, grid.crs)

    def heights(places: FloatArray) -> FloatArray:
        found = surface_at(grid, to_raster(places))
        if not found.known.all():
            x, y = places[~found.known][0].tolist()
            message = (
                f"the terrain has no height at {x:.1f}, {y:.1f}, and at {int((~found.known).sum())} of {len(places)} "
                "places asked for; fill its holes, or give a raster that reaches beyond the border by a photo"
            )
            raise InputError.single(message, shown)
        return found.height

    return heights


def _to_raster(crs: str | None, own: str | None) -> Callable[[FloatArray], FloatArray]:
    """Return what takes places (n, 2) of the project to the system of a raster."""
    if crs is None or own is None:
        return lambda places: places
    from pyproj import Transformer

    raster = known_crs(own)
    transformer = Transformer.from_crs(known_crs(crs).to_2d(), raster.to_2d(), always_xy=True)
    return lambda places: np.column_stack(transformer.transform(places[:, 0], places[:, 1]))
