"""Places on the ellipsoid, ellipsoidal and geocentric, and heights of vertical systems above it."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.wording import agreeing

if TYPE_CHECKING:
    import pyproj
    from pyproj.transformer import TransformerGroup


# Geographic coordinates are longitude and latitude (radians) and height above the ellipsoid (metres); geocentric ones
# are metres from the centre of the ellipsoid, the third along its axis. An ellipsoid is given by its two semi-axes,
# metres.

_ROUNDS = 3
"""Steps of Bowring's iteration: one gives 0.3 micrometres at a height of 5 km, two are exact to rounding."""


def geocentric_from_geographic(geographic: FloatArray, semi_axes: tuple[float, float]) -> FloatArray:
    """Return geocentric coordinates (n, 3) of geographic ones (n, 3)."""
    major, minor = semi_axes
    longitude, latitude, height = geographic.T
    sine, cosine = np.sin(latitude), np.cos(latitude)
    normal = major**2 / np.hypot(major * cosine, minor * sine)
    from_axis = (normal + height) * cosine
    along_axis = ((minor / major) ** 2 * normal + height) * sine
    return np.stack([from_axis * np.cos(longitude), from_axis * np.sin(longitude), along_axis], axis=1)


def geographic_from_geocentric(geocentric: FloatArray, semi_axes: tuple[float, float]) -> FloatArray:
    """Return longitude, latitude and height: the inverse of `geocentric_from_geographic`.

    Parameters
    ----------
    geocentric : array (n, 3)
        Not near the centre of the earth.
    semi_axes : (float, float)

    Returns
    -------
    array (n, 3)

    Notes
    -----
    Bowring (1976), Transformation from spatial to geographical coordinates, Survey Review 23 (181), 323-327, iterated;
    the height by a formula that holds at the poles too.
    """
    major, minor = semi_axes
    from_axis, along_axis = np.hypot(geocentric[:, 0], geocentric[:, 1]), geocentric[:, 2]
    linear = major**2 - minor**2
    reduced = np.arctan2(major * along_axis, minor * from_axis)
    latitude = reduced
    for _ in range(_ROUNDS):
        latitude = np.arctan2(
            along_axis + linear / minor * np.sin(reduced) ** 3, from_axis - linear / major * np.cos(reduced) ** 3
        )
        reduced = np.arctan2(minor * np.sin(latitude), major * np.cos(latitude))
    sine, cosine = np.sin(latitude), np.cos(latitude)
    height = from_axis * cosine + along_axis * sine - np.hypot(major * cosine, minor * sine)
    return np.stack([np.arctan2(geocentric[:, 1], geocentric[:, 0]), latitude, height], axis=1)


def place_axes(geographic: FloatArray) -> FloatArray:
    """Return the directions of east, north and up (along the ellipsoid's normal) at places, geocentric.

    `geographic` is an array (n, 3), the result (n, 3, 3) with the directions in its rows.
    """
    sine_of_longitude, cosine_of_longitude = np.sin(geographic[:, 0]), np.cos(geographic[:, 0])
    sine, cosine, zero = np.sin(geographic[:, 1]), np.cos(geographic[:, 1]), np.zeros(len(geographic))
    rows = [
        [-sine_of_longitude, cosine_of_longitude, zero],
        [-sine * cosine_of_longitude, -sine * sine_of_longitude, cosine],
        [cosine * cosine_of_longitude, cosine * sine_of_longitude, sine],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def metres_per_radian(geographic: FloatArray, semi_axes: tuple[float, float]) -> FloatArray:
    """Return metres per radian of longitude and of latitude at places (n, 3), and 1 for the height.

    By the radii of curvature of the prime vertical and of the meridian.
    """
    major, minor = semi_axes
    latitude, height = geographic[:, 1], geographic[:, 2]
    root = np.hypot(major * np.cos(latitude), minor * np.sin(latitude))
    normal, meridian = major**2 / root, (major * minor) ** 2 / root**3
    return np.column_stack([(normal + height) * np.cos(latitude), meridian + height, np.ones(len(geographic))])


# Where a grid of a geoid or of a datum is missing PROJ silently leaves coordinates unchanged, even when asked for the
# best transformation only. Only a transformation group tells which transformation would be possible with all grids, and
# which grids are installed.

_AROUND_PLACE = 0.1
"""Degrees around the place in which a transformation must be valid: the size of a block."""

WITHOUT_HEIGHTS = (
    "Else name other heights, or the projected crs alone if Z may be taken as height above the ellipsoid "
    "(10 m of geoid height then change lengths by 1.6 mm per km)"
)
"""What to do about heights that cannot be had."""


def best_transformation(
    whole: pyproj.CRS, spatial: pyproj.CRS, shown: str, longitude: float, latitude: float
) -> pyproj.Transformer:
    """Return the best transformation of a system, of heights or of another datum, to ellipsoidal coordinates.

    Parameters
    ----------
    whole : pyproj.CRS
        With heights: compound of a projected and a vertical one, or spatial.
    spatial : pyproj.CRS
        Longitude, latitude and height on the datum that is wanted.
    shown : str
        What the user calls it.
    longitude, latitude : float
        From Greenwich, degrees: the place that counts.

    Raises
    ------
    InputError
        If the best transformation lacks a grid, or there is none but a "ballpark" one, which leaves heights and datum
        unchanged.
    """
    from pyproj.transformer import AreaOfInterest, TransformerGroup

    area = AreaOfInterest(
        max(longitude - _AROUND_PLACE, -180.0),
        max(latitude - _AROUND_PLACE, -90.0),
        min(longitude + _AROUND_PLACE, 180.0),
        min(latitude + _AROUND_PLACE, 90.0),
    )
    with warnings.catch_warnings():
        # said as an error below
        warnings.filterwarnings("ignore", message="Best transformation is not available")
        group = TransformerGroup(whole, spatial, always_xy=True, allow_ballpark=False, area_of_interest=area)
    if not group.best_available or not group.transformers:
        raise InputError.single(_refusal(group, shown, whole, spatial))
    return group.transformers[0]


def _refusal(group: TransformerGroup, shown: str, whole: pyproj.CRS, spatial: pyproj.CRS) -> str:
    """Return what to install for the best transformation that PROJ knows of."""
    # documented there, but not in its __all__
    from pyproj.datadir import get_user_data_dir  # type: ignore[attr-defined]

    if whole.is_compound:
        start = f"crs {shown}: Z in {whole.sub_crs_list[1].name} cannot be taken to the ellipsoid:"
        unchanged, otherwise = "heights", WITHOUT_HEIGHTS
    else:
        start = f"crs {shown}: coordinates in {whole.name} cannot be taken to the datum of {spatial.name}:"
        unchanged, otherwise = "coordinates", f"Else give them in a system on the datum of {spatial.name}"
    best = group.unavailable_operations[:1]
    missing = [grid for operation in best for grid in operation.grids if not grid.available]
    if not missing:
        return f"{start} PROJ knows no transformation for it at this place. {otherwise}"
    steps = [
        f"run 'pyproj sync --file {grid.short_name}'"
        if grid.url and grid.direct_download
        else f"get {grid.short_name} from its publisher and copy it into {get_user_data_dir()}"
        for grid in missing
    ]
    names = ", ".join(grid.short_name for grid in missing)
    what = f"{agreeing(len(missing), 'grid')} {names} {agreeing(len(missing), 'is', 'are')}"
    return (
        f"{start} the {what} not installed, and PROJ would silently leave {unchanged} unchanged. "
        f"To install, {' and '.join(steps)}. {otherwise}"
    )
