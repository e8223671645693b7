"""Coordinates in another system than the project's: geographic, geocentric, or another projection."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.geometry.ground_crs import geodetic_of, known_crs
from orip.geometry.ground_ellipsoid import heights_to_ellipsoid

if TYPE_CHECKING:
    import pyproj


def geographic_from_crs(xyz: FloatArray, source: str, target: str) -> tuple[FloatArray, bool]:
    """Return longitude, latitude (radians) and height (m) on the datum of a projected system.

    Parameters
    ----------
    xyz : array (n, 3)
        In `source`: X easting or longitude (degrees), Y northing or latitude, Z height; or geocentric X, Y, Z.
    source : str
        Anything that PROJ understands; a system without heights has them above its ellipsoid.
    target : str
        The project's system.

    Returns
    -------
    array (n, 3), bool
        True: the axes of `source` are geocentric.

    Raises
    ------
    InputError
        If a system is unknown, or the transformation lacks a grid.
    """
    transformer, whole, spatial = _to_geographic(source, target, np.median(xyz, axis=0))
    found = np.column_stack(transformer.transform(*xyz.T)).astype(np.float64)
    found[:, :2] *= spatial.axis_info[0].unit_conversion_factor
    if not np.isfinite(found).all():
        row = int(np.flatnonzero(~np.isfinite(found).all(axis=1))[0])
        message = f"crs {source} ({whole.name}) has no place with the coordinates {xyz[row, 0]:.3f}, {xyz[row, 1]:.3f}"
        raise InputError.single(message)
    return found, bool(whole.is_geocentric)


def crs_from_geographic(geographic: FloatArray, source: str, target: str) -> FloatArray:
    """Return coordinates (n, 3) of longitude, latitude (radians) and height (m), the inverse of `geographic_from_crs`.

    Parameters
    ----------
    geographic : array (n, 3)
        On the datum of `target`.
    source, target : str
        As for `geographic_from_crs`; the coordinates are in `source`.

    Raises
    ------
    InputError
        If a system is unknown, or the transformation lacks a grid.
    """
    from pyproj import Transformer

    spatial = geodetic_of(target).to_3d()
    angle = spatial.axis_info[0].unit_conversion_factor
    given = geographic / [angle, angle, 1.0]
    whole = known_crs(source)
    whole = whole.to_3d() if len(whole.axis_info) == 2 else whole
    middle = Transformer.from_crs(spatial, whole, always_xy=True).transform(*np.median(given, axis=0))
    transformer, _, _ = _to_geographic(source, target, np.array(middle))
    x, y, z = given.T
    return np.column_stack(transformer.transform(x, y, z, direction="INVERSE")).astype(np.float64)


def _to_geographic(source: str, target: str, middle: FloatArray) -> tuple[pyproj.Transformer, pyproj.CRS, pyproj.CRS]:
    """Return the best transformation at a place, the system that it begins in, and the geographic one."""
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    whole = known_crs(source)
    if not (whole.is_geographic or whole.is_projected or whole.is_geocentric):
        message = f"crs {source} ({whole.name}) has no places on the earth; name a geographic or projected system"
        raise InputError.single(message)
    if len(whole.axis_info) == 2:
        whole = whole.to_3d()
    spatial = geodetic_of(target).to_3d()
    try:
        longitude, latitude = np.array(Transformer.from_crs(whole, spatial, always_xy=True).transform(*middle))[:2]
    except ProjError as error:
        message = f"crs {source} ({whole.name}) cannot be taken to {target}: {error}"
        raise InputError.single(message) from error
    if not np.isfinite([longitude, latitude]).all():
        message = f"crs {source} ({whole.name}) has no place with the coordinates {middle[0]:.3f}, {middle[1]:.3f}"
        raise InputError.single(message)
    found = heights_to_ellipsoid(whole, spatial, source, float(longitude), float(latitude))
    return found, whole, spatial
