"""The project's coordinate reference system: what it must be, and ground coordinates to geographic ones and back.

Ground coordinates are X easting, Y northing, Z height whatever order the register gives its axes. Geographic
coordinates are longitude and latitude (radians, from the system's own prime meridian) and height above the ellipsoid
(metres), all of the system's own datum: no datum is changed here, and a projected system needs no grid.
"""

from __future__ import annotations

import re
import textwrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint, InputError, ProjectWarning
from orip.geometry.ground_ellipsoid import WITHOUT_HEIGHTS, best_transformation
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN, METRES_PER_GROUND_UNIT

if TYPE_CHECKING:
    import pyproj


_SAME_UNIT = 1e-9
"""Relative difference of two units that are the same; foot and US survey foot differ by 2e-6."""

_A_CODE = 'give the code of a projected system, such as "EPSG:25832", with heights "EPSG:25832+7837"'
_LONGEST_AREA = 60
"""Characters of a name of an area: PROJ lists all states in it."""

OUTSIDE = 1.0
"""Degrees outside a system's area of use at which a warning is due; neighbouring zones are used across their edge."""

_LONGEST_SHOWN = 60
"""A crs that is given as a longer text (WKT) is shown by its name."""


class GroundCrs(Struct, frozen=True):
    """A projected system with heights.

    Parameters
    ----------
    shown, name : str
        What the user wrote, and what the register calls it.
    heights : str
        What Z is.
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

        PROJ inverts some projections by short series (LAEA: 0.5 mm off). Correcting by the misclosure removes that.
        """
        angles = _finite(self.horizontal.transform(x, y))
        back = _finite(self.horizontal.transform(angles[0], angles[1], direction="INVERSE"))
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
    whole, shown, geodetic, result = checked_crs(crs, ground_unit)
    place = result.to_geographic(origin[None])[0]
    if not np.isfinite(place).all():
        raise InputError.single(_no_place(result, origin))
    warnings = _area_warnings(result, whole, place)
    if whole.is_compound:
        result = _with_heights(result, whole, geodetic, origin)
    elif len(whole.axis_info) == 2:
        warnings.append(_heights_warning(shown))
    return replace(result, warnings=tuple(warnings))


def near_place(crs: str, ground_unit: str, geographic: FloatArray) -> FloatArray:
    """Return X, Y, Z (3,) of a place in the project's system; its height is not changed.

    For the `origin` of `ground_crs` where only longitude, latitude (radians, from the system's own prime meridian) and
    height (metres) of a place are known.

    Raises
    ------
    InputError
        If the system is unknown, not projected or has no such place.
    """
    whole, shown, _, result = checked_crs(crs, ground_unit)
    place = result.from_geographic(geographic[None])[0]
    if not np.isfinite(place).all():
        longitude, latitude = degrees_at(result, geographic)
        message = f"crs {shown} ({whole.name}) does not reach {longitude:.6f}° E {latitude:.6f}° N; check crs"
        raise InputError.single(message)
    return np.asarray(place)


class CheckedCrs(NamedTuple):
    """A projected system as a whole, its name in messages, its geographic system, and it with Z above the ellipsoid."""

    whole: pyproj.CRS
    shown: str
    geodetic: pyproj.CRS
    ground: GroundCrs


def checked_crs(crs: str, ground_unit: str) -> CheckedCrs:
    """Return a system, with all complaints about its axes and units at once."""
    whole, shown = _whole(crs)
    horizontal, geodetic = _horizontal(whole, shown)
    complaints = [*_axis_complaints(horizontal, shown), *_unit_complaints(whole, shown, ground_unit)]
    if complaints:
        raise InputError(complaints)
    return CheckedCrs(whole, shown, geodetic, _of_ellipsoid(whole, horizontal, geodetic, shown))


def _whole(crs: str) -> tuple[pyproj.CRS, str]:
    """Return a system, without any transformation to another datum that is bound to it, and its name in messages."""
    whole = known_crs(crs)
    if whole.is_bound and whole.source_crs is not None:
        whole = whole.source_crs
    return whole, crs if len(crs) <= _LONGEST_SHOWN else whole.name


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


def geodetic_of(crs: str) -> pyproj.CRS:
    """Return the geographic system that a projected one is projected from."""
    return _horizontal(*_whole(crs))[1]


def known_crs(crs: str) -> pyproj.CRS:
    """Return the system that a text names.

    Raises
    ------
    InputError
        If PROJ does not know it.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input(crs)
    except CRSError as error:
        code = re.search(r"[1-9]\d{3,5}", crs)
        meant = f'did you mean "EPSG:{code[0]}"?' if code and not crs.upper().startswith("EPSG:") else ""
        unknown = re.search(r"crs not found: \w+:\w+", str(error))
        reason = f" ({unknown[0]})" if unknown else ""
        message = f'crs "{crs}" is not known to PROJ{reason}; {meant or _A_CODE}'
        raise InputError.single(message) from error


def _horizontal(whole: pyproj.CRS, shown: str) -> tuple[pyproj.CRS, pyproj.CRS]:
    """Return the projected part, without any bound transformation to another datum, and its geographic system.

    Raises
    ------
    InputError
    """
    part = whole.sub_crs_list[0] if whole.is_compound else whole
    if part.is_bound and part.source_crs is not None:
        part = part.source_crs
    geodetic = part.geodetic_crs
    if part.is_projected and geodetic is not None and geodetic.is_geographic:
        return part, geodetic
    message = (
        f"crs {shown} ({whole.name}) is not a projected system but: {part.type_name}; X and Y must be metres or feet "
        "on a map grid. Name a projected crs and give the coordinates in it, or leave crs out where X, Y, Z are a "
        "plain right-handed system"
    )
    raise InputError.single(message)


def _of_ellipsoid(whole: pyproj.CRS, horizontal: pyproj.CRS, geodetic: pyproj.CRS, shown: str) -> GroundCrs:
    """Return the system with Z above the ellipsoid."""
    from pyproj import Transformer

    ellipsoid, meridian = geodetic.ellipsoid, geodetic.prime_meridian
    if ellipsoid is None or meridian is None:
        message = f"crs {shown} ({whole.name}) has no ellipsoid; name a projected crs with one"
        raise InputError.single(message)
    return GroundCrs(
        shown=shown,
        name=whole.name,
        heights="height above the ellipsoid",
        ellipsoid=ellipsoid.name,
        semi_axes=(float(ellipsoid.semi_major_metre), float(ellipsoid.semi_minor_metre)),
        metres_per_unit=whole.axis_info[0].unit_conversion_factor,
        radians_per_angle=geodetic.axis_info[0].unit_conversion_factor,
        prime_meridian=float(meridian.longitude) * float(meridian.unit_conversion_factor),
        # without heights: a conversion on one datum, exact and without a grid
        horizontal=Transformer.from_crs(horizontal.to_2d(), geodetic.to_2d(), always_xy=True),
        vertical=None,
        metres_per_height=1.0,
        warnings=(),
    )


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


def outside_area(whole: pyproj.CRS, longitude: float, latitude: float) -> float:
    """Return how far a place (degrees) is outside the area that a system is made for, degrees; 0 or less: it is not."""
    area = whole.area_of_use
    if area is None:
        return 0.0
    # the area may cross the 180th meridian, west is then greater than east
    half = 0.5 * ((area.east - area.west) % 360.0 or 360.0)
    off = abs((longitude - area.west - half + 180.0) % 360.0 - 180.0) - half
    return float(max(off, latitude - area.north, area.south - latitude))


def _area_warnings(crs: GroundCrs, whole: pyproj.CRS, place: FloatArray) -> list[ProjectWarning]:
    area = whole.area_of_use
    longitude, latitude = degrees_at(crs, place)
    if area is None or outside_area(whole, longitude, latitude) <= OUTSIDE:
        return []
    name = textwrap.shorten(area.name or "another area", _LONGEST_AREA, placeholder=" ...")
    is_exchanged = outside_area(whole, latitude, longitude) <= OUTSIDE
    remedy = (
        "exchange longitude and latitude" if is_exchanged else "check crs, and that X is the easting and Y the northing"
    )
    text = (
        f"is made for {name} ({_span(area.west, area.east, 'EW')}, {_span(area.south, area.north, 'NS')}), but the "
        f"middle of the block is at {_side(longitude, 'EW', 3)} {_side(latitude, 'NS', 3)}; {remedy}"
    )
    return [ProjectWarning("crs-outside-area", f"crs {crs.shown}", text)]


def _span(first: float, last: float, sides: str) -> str:
    return f"{_side(first, sides, 1)} to {_side(last, sides, 1)}"


def _side(degrees: float, sides: str, decimals: int) -> str:
    """Return a longitude or latitude with the letter of its hemisphere."""
    return f"{abs(degrees):.{decimals}f}° {sides[degrees < 0.0]}"


def _with_heights(crs: GroundCrs, whole: pyproj.CRS, geodetic: pyproj.CRS, origin: FloatArray) -> GroundCrs:
    """Return the system with the heights of its vertical part, or refuse."""
    longitude, latitude = degrees_at(crs, crs.to_geographic(origin[None])[0])
    spatial = geodetic.to_3d()
    vertical = best_transformation(whole, spatial, crs.shown, longitude, latitude)
    result = replace(
        crs,
        heights=whole.sub_crs_list[1].name,
        vertical=vertical,
        metres_per_height=spatial.axis_info[2].unit_conversion_factor,
    )
    if not np.isfinite(result.to_geographic(origin[None])).all():
        message = (
            f"crs {crs.shown}: {vertical.description} does not reach the middle of the block, {longitude:.3f}° E "
            f"{latitude:.3f}° N; the heights must be of a system that does. {WITHOUT_HEIGHTS}"
        )
        raise InputError.single(message)
    return result
