"""The project's coordinate reference system: what it must be, and ground coordinates to geographic ones and back.

Ground coordinates are X easting, Y northing, Z height whatever order the register gives its axes. Geographic
coordinates are longitude and latitude (radians, from the system's own prime meridian) and height above the ellipsoid
(metres), all of the system's own datum: no datum is changed here, and a projected system needs no grid.
"""

from __future__ import annotations

import warnings as python_warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from orip.errors import Complaint, InputError, ProjectWarning
from orip.units import DEGREES_PER_RADIAN, METRES_PER_GROUND_UNIT

if TYPE_CHECKING:
    import pyproj
    from pyproj.transformer import TransformerGroup

FloatArray = NDArray[np.float64]

_SAME_UNIT = 1e-9
"""Relative difference of two units that are the same; foot and US survey foot differ by 2e-6."""

_AROUND_ORIGIN = 0.1
"""Degrees around the origin in which a transformation of heights must be valid: a block's size."""

_OUTSIDE = 1.0
"""Degrees outside a system's area of use at which a warning is due; neighbouring zones are used across their edge."""

_LONGEST_SHOWN = 60
"""A crs that is given as a longer text (WKT) is shown by its name."""


@dataclass(frozen=True, slots=True)
class GroundCrs:
    """A projected system with heights.

    Parameters
    ----------
    shown, name : str
        What the user wrote, and what the register calls it.
    heights : str
        What Z is.
    ellipsoid : str
    semi_axes : (float, float)
        Of the ellipsoid, metres.
    metres_per_unit : float
        Of X, Y and Z.
    radians_per_angle : float
        Per unit of the system's longitude and latitude.
    prime_meridian : float
        Longitude of the system's prime meridian from Greenwich, radians.
    horizontal : pyproj.Transformer
        X, Y to longitude, latitude.
    vertical : pyproj.Transformer or None
        X, Y, Z to longitude, latitude, height, of which only the height is taken; None: Z is above the ellipsoid.
    metres_per_height : float
        Per unit of the heights that `vertical` gives.
    warnings : tuple of ProjectWarning
    """

    shown: str
    name: str
    heights: str
    ellipsoid: str
    semi_axes: tuple[float, float]
    metres_per_unit: float
    radians_per_angle: float
    prime_meridian: float
    horizontal: pyproj.Transformer
    vertical: pyproj.Transformer | None
    metres_per_height: float
    warnings: tuple[ProjectWarning, ...]

    def to_geographic(self, xyz: FloatArray) -> FloatArray:
        """Return longitude, latitude (radians), height (metres), array (n, 3); NaN where there is none."""
        x, y, z = xyz.T
        longitude, latitude = self._angles(x, y)
        if self.vertical is None:
            height = z * self.metres_per_unit
        else:
            height = _finite(self.vertical.transform(x, y, z)[2]) * self.metres_per_height
        return _rows(longitude * self.radians_per_angle, latitude * self.radians_per_angle, height)

    def _angles(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return longitude and latitude, array (2, n), in the system's unit.

        PROJ inverts some projections by a short series (LAEA: 0.5 mm). What the result misses is put right once.
        """
        angles = _finite(self.horizontal.transform(x, y))
        back = _finite(self.horizontal.transform(*angles, direction="INVERSE"))
        return _finite(self.horizontal.transform(2.0 * x - back[0], 2.0 * y - back[1]))

    def from_geographic(self, geographic: FloatArray) -> FloatArray:
        """Return X, Y, Z of longitude, latitude (radians), height (metres), array (n, 3); NaN where there are none."""
        longitude, latitude = geographic.T[:2] / self.radians_per_angle
        x, y = self.horizontal.transform(longitude, latitude, direction="INVERSE")
        if self.vertical is None:
            z = geographic[:, 2] / self.metres_per_unit
        else:
            height = geographic[:, 2] / self.metres_per_height
            z = self.vertical.transform(longitude, latitude, height, direction="INVERSE")[2]
        return _rows(x, y, z)


def ground_crs(crs: str, ground_unit: str, origin: FloatArray) -> GroundCrs:
    """Return the project's system, fit for use around an origin.

    Parameters
    ----------
    crs : str
        Anything that PROJ understands: ``EPSG:25832``, ``EPSG:25832+7837``, WKT.
    ground_unit : str
        Must be the unit of the system's axes.
    origin : array (3,)
        X, Y, Z of a place in the middle of the block.

    Raises
    ------
    InputError
        If the system is unknown, not projected, mirrored or turned to the south, in another unit than the project, if
        the origin is not in it, or if its heights cannot be taken to the ellipsoid with what is installed.
    """
    whole = _known(crs)
    if whole.is_bound and whole.source_crs is not None:
        whole = whole.source_crs
    shown = crs if len(crs) <= _LONGEST_SHOWN else whole.name
    horizontal = _horizontal(whole, shown)
    complaints = [*_axis_complaints(horizontal, shown), *_unit_complaints(whole, shown, ground_unit)]
    if complaints:
        raise InputError(complaints)
    from pyproj import Transformer

    geodetic = horizontal.geodetic_crs
    meridian = geodetic.prime_meridian
    result = GroundCrs(
        shown=shown,
        name=whole.name,
        heights="height above the ellipsoid",
        ellipsoid=geodetic.ellipsoid.name,
        semi_axes=(geodetic.ellipsoid.semi_major_metre, geodetic.ellipsoid.semi_minor_metre),
        metres_per_unit=whole.axis_info[0].unit_conversion_factor,
        radians_per_angle=geodetic.axis_info[0].unit_conversion_factor,
        prime_meridian=meridian.longitude * meridian.unit_conversion_factor,
        horizontal=Transformer.from_crs(horizontal.to_2d(), geodetic.to_2d(), always_xy=True),
        vertical=None,
        metres_per_height=1.0,
        warnings=(),
    )
    place = result.to_geographic(origin[None])[0]
    if not np.isfinite(place).all():
        raise InputError.single(_no_place(result, origin))
    warnings = _area_warnings(result, whole, place)
    if whole.is_compound:
        return _with_vertical(result, whole, horizontal, origin, place, warnings)
    if len(whole.axis_info) == 2:
        warnings = [*warnings, _heights_warning(shown)]
    return replace(result, warnings=tuple(warnings))


def degrees_at(crs: GroundCrs, place: FloatArray) -> tuple[float, float]:
    """Return longitude from Greenwich and latitude, degrees, of a geographic place (3,)."""
    longitude = (place[0] + crs.prime_meridian) * DEGREES_PER_RADIAN
    return float((longitude + 180.0) % 360.0 - 180.0), float(place[1] * DEGREES_PER_RADIAN)


def _finite(values: Any) -> FloatArray:  # pyproj's return types are Any
    """Return an array with NaN for PROJ's infinity, which says that there is no such place."""
    result = np.array(values, dtype=np.float64)
    result[~np.isfinite(result)] = np.nan
    return result


def _rows(first: Any, second: Any, third: Any) -> FloatArray:
    """Return an array (n, 3), a row with anything missing NaN throughout."""
    result = _finite(np.stack([first, second, third], axis=1))
    result[np.isnan(result).any(axis=1)] = np.nan
    return result


def _known(crs: str) -> pyproj.CRS:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input(crs)
    except CRSError as error:
        message = (
            f'crs "{crs}" is not known to PROJ ({error}); give the code of a projected system, such as "EPSG:25832", '
            'with heights "EPSG:25832+7837"'
        )
        raise InputError.single(message) from error


def _horizontal(whole: pyproj.CRS, shown: str) -> pyproj.CRS:
    """Return the projected part, bare of a transformation to another datum that may be bound to it."""
    part = whole.sub_crs_list[0] if whole.is_compound else whole
    if part.is_bound and part.source_crs is not None:
        part = part.source_crs
    geodetic = part.geodetic_crs
    if part.is_projected and geodetic is not None and geodetic.is_geographic:
        return part
    message = (
        f"crs {shown} ({whole.name}) is no projected system but: {part.type_name}; X and Y must be metres or feet on "
        "a map grid. Name a projected crs and give the coordinates in it, or leave crs out where X, Y, Z are a plain "
        "right-handed system"
    )
    raise InputError.single(message)


def _axis_complaints(horizontal: pyproj.CRS, shown: str) -> list[Complaint]:
    directions = {axis.direction for axis in horizontal.axis_info[:2]}
    # at the poles both axes of a right-handed system leave along meridians, both to the north or both to the south
    if directions in ({"east", "north"}, {"north"}, {"south"}):
        return []
    axes = " and ".join(f"{axis.name} ({axis.direction})" for axis in horizontal.axis_info[:2])
    return [
        Complaint(
            f"crs {shown} counts {axes}; X must grow to the east and Y to the north. Name the system's variant with "
            "eastings and northings (as EPSG:5514 is for EPSG:5513), and give the coordinates in it"
        )
    ]


def _unit_complaints(whole: pyproj.CRS, shown: str, ground_unit: str) -> list[Complaint]:
    axes = whole.axis_info
    units = [_unit(axis.unit_conversion_factor, axis.unit_name) for axis in axes]
    if len(axes) == 3 and axes[2].direction != "up":
        text = f"crs {shown} counts Z {axes[2].direction}; Z must grow upwards. Name a system of heights, not of depths"
        return [Complaint(text)]
    if len(set(units)) > 1:
        text = (
            f"crs {shown} ({whole.name}) counts {', '.join(units)} along its axes; X, Y and Z must have one unit. "
            f"Name heights in {units[0]} and give Z in it"
        )
        return [Complaint(text)]
    if units[0] not in METRES_PER_GROUND_UNIT:
        known = ", ".join(METRES_PER_GROUND_UNIT)
        text = f"crs {shown} ({whole.name}) is in {units[0]}, which orip does not know; name a crs in one of: {known}"
        return [Complaint(text)]
    if units[0] != ground_unit:
        text = (
            f'ground_unit is "{ground_unit}", but crs {shown} ({whole.name}) is in {units[0]}; '
            f'set ground_unit = "{units[0]}", or name a crs in {ground_unit}'
        )
        return [Complaint(text)]
    return []


def _unit(metres: float, name: str) -> str:
    """Return orip's name of a unit, or the register's."""
    same = (known for known, length in METRES_PER_GROUND_UNIT.items() if abs(metres / length - 1.0) < _SAME_UNIT)
    return next(same, name)


def _no_place(crs: GroundCrs, origin: FloatArray) -> str:
    at = ", ".join(f"{value:.3f}" for value in origin)
    return (
        f"crs {crs.shown} ({crs.name}) has no place with the coordinates {at}, the middle of the block; they must lie "
        "in it. Check crs, and that X is the easting and Y the northing"
    )


def _heights_warning(shown: str) -> ProjectWarning:
    return ProjectWarning(
        "crs-without-heights", f"crs {shown}",
        "has no heights: Z is taken as height above its ellipsoid. Where Z is above sea level, lengths are wrong by "
        "1.6 mm per km for every 10 m of geoid height, and control takes that up; name the heights with the crs, "
        'as in "EPSG:25832+7837", to have it right',
    )  # fmt: skip


def _area_warnings(crs: GroundCrs, whole: pyproj.CRS, place: FloatArray) -> list[ProjectWarning]:
    area = whole.area_of_use
    if area is None:
        return []
    longitude, latitude = degrees_at(crs, place)
    # the area may cross the 180th meridian, west is then greater than east
    half = 0.5 * ((area.east - area.west) % 360.0 or 360.0)
    off = abs((longitude - area.west - half + 180.0) % 360.0 - 180.0) - half
    if max(off, latitude - area.north, area.south - latitude) <= _OUTSIDE:
        return []
    return [
        ProjectWarning(
            "crs-outside-area", f"crs {crs.shown}",
            f"is made for {area.name or 'another area'} ({area.west}° to {area.east}° E, {area.south}° to "
            f"{area.north}° N), but the middle of the block is at {longitude:.3f}° E {latitude:.3f}° N; check crs, and "
            "that X is the easting and Y the northing",
        )
    ]  # fmt: skip


def _with_vertical(
    crs: GroundCrs, whole: pyproj.CRS, horizontal: pyproj.CRS, origin: FloatArray, place: FloatArray,
    warnings: list[ProjectWarning],
) -> GroundCrs:  # fmt: skip
    """Return the system with its heights, or refuse.

    PROJ goes on without a missing grid and leaves heights as they are; only the group of transformations, ballpark ones
    excluded, tells.
    """
    from pyproj.transformer import AreaOfInterest, TransformerGroup

    heights = whole.sub_crs_list[1].name
    spatial = horizontal.geodetic_crs.to_3d()
    longitude, latitude = degrees_at(crs, place)
    area = AreaOfInterest(
        max(longitude - _AROUND_ORIGIN, -180.0), max(latitude - _AROUND_ORIGIN, -90.0),
        min(longitude + _AROUND_ORIGIN, 180.0), min(latitude + _AROUND_ORIGIN, 90.0),
    )  # fmt: skip
    with python_warnings.catch_warnings():
        # said below as an error
        python_warnings.filterwarnings("ignore", message="Best transformation is not available")
        group = TransformerGroup(whole, spatial, always_xy=True, allow_ballpark=False, area_of_interest=area)
    if not group.best_available or not group.transformers:
        raise InputError.single(_heights_refused(group, crs.shown, heights))
    result = replace(
        crs,
        heights=heights,
        vertical=group.transformers[0],
        metres_per_height=spatial.axis_info[2].unit_conversion_factor,
        warnings=tuple(warnings),
    )
    if not np.isfinite(result.to_geographic(origin[None])).all():
        message = (
            f"crs {crs.shown}: {group.transformers[0].description} does not reach the middle of the block, "
            f"{longitude:.3f}° E {latitude:.3f}° N; the heights must be of a system that does. {_WITHOUT_HEIGHTS}"
        )
        raise InputError.single(message)
    return result


_WITHOUT_HEIGHTS = (
    "Name other heights, or the projected crs alone if Z may be taken as height above the ellipsoid "
    "(10 m of geoid height then change lengths by 1.6 mm per km)"
)


def _heights_refused(group: TransformerGroup, shown: str, heights: str) -> str:
    """Return what to install, from the best transformation that PROJ knows of."""
    import pyproj

    start = f"crs {shown}: Z in {heights} cannot be taken to the ellipsoid:"
    # a better one that is missing some grid comes first
    missing = [[grid for grid in operation.grids if not grid.available] for operation in group.unavailable_operations]
    if not missing or not missing[0]:
        return f"{start} PROJ knows no transformation for it at this place. {_WITHOUT_HEIGHTS}"
    steps = []
    for grid in missing[0]:
        if grid.url and grid.direct_download:
            steps.append(f"run 'pyproj sync --file {grid.short_name}' (or 'projsync --file {grid.short_name}')")
        else:
            folder = pyproj.datadir.get_user_data_dir()
            steps.append(f"get {grid.short_name} from its publisher and copy it into {folder}")
    names = ", ".join(grid.short_name for grid in missing[0])
    return (
        f"{start} the grid {names} is not installed, and without it PROJ would leave heights unchanged. "
        f"To have it, {'; '.join(steps)}. {_WITHOUT_HEIGHTS}"
    )
