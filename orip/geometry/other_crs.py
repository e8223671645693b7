"""Coordinates in another system than the project's, or in another zone of a grid; stations as a .STA file has them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.errors import Complaint, InputError
from orip.geometry.ground_crs import checked_crs, geodetic_of, known_crs, near_place
from orip.geometry.ground_ellipsoid import best_transformation, place_axes
from orip.geometry.ground_frame import GroundFrame, ground_frame
from orip.geometry.rotation import angles_from_rotation, rotation_from_navigation
from orip.records.control import IN_PROJECT, Station, StationMotion, StationReference
from orip.structs import replace

if TYPE_CHECKING:
    import pyproj


def crs_complaints(crs: str, ground_unit: str) -> tuple[Complaint, ...]:
    """Return why a system is not fit for a project, wherever its block is; see `ground_crs`."""
    try:
        checked_crs(crs, ground_unit)
    except InputError as error:
        return error.complaints
    return ()


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


def to_wgs84(crs: str | None) -> Callable[[FloatArray], FloatArray]:
    """Return the conversion of places (n, 3) of a project to longitude and latitude (degrees) and ellipsoidal height.

    Without a crs they stay as they are.

    Raises
    ------
    InputError
        If the system is not known; by the conversion, if it has no longitude and latitude at a place.
    """
    if crs is None:
        return lambda xyz: xyz
    from pyproj import CRS, Transformer
    from pyproj.exceptions import CRSError, ProjError

    try:
        whole = CRS.from_user_input(crs)
        metres = 1.0
        if len(whole.axis_info) == 2:  # heights are in the unit of the map then, above the ellipsoid
            metres = whole.axis_info[0].unit_conversion_factor
            whole = whole.to_3d()
        transformer = Transformer.from_crs(whole, CRS.from_epsg(4979), always_xy=True)
    except (CRSError, ProjError) as fault:
        message = f"crs {crs}: {fault}; correct it in orip.toml"
        raise InputError.single(message) from fault

    def convert(xyz: FloatArray) -> FloatArray:
        found = np.column_stack(transformer.transform(xyz[:, 0], xyz[:, 1], xyz[:, 2] * metres)).astype(np.float64)
        if not np.isfinite(found).all():
            x, y, _ = xyz[int(np.flatnonzero(~np.isfinite(found).all(axis=1))[0])].tolist()
            message = f"crs {crs} has no longitude and latitude at {x:.3f}, {y:.3f}; check crs in orip.toml"
            raise InputError.single(message)
        return found

    return convert


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
    found = best_transformation(whole, spatial, source, float(longitude), float(latitude))
    return found, whole, spatial


def stations_of_reference(
    stations: Sequence[Station], reference: StationReference, crs: str | None, ground_unit: str
) -> tuple[Station, ...]:
    """Return stations in the project's coordinates, with omega, phi and kappa against its axes.

    Motions and standard deviations of positions are along east, north and up, or along geocentric axes where positions
    are geocentric; standard deviations of roll and pitch become that of omega and phi, the larger of both, that of
    heading that of kappa.

    Raises
    ------
    InputError
        If the system is unknown, needs a grid that is not installed, or the project has none to go to.
    """
    if reference == IN_PROJECT or not stations:
        return tuple(stations)
    position = np.array([station.position for station in stations], dtype=np.float64)
    known: BoolArray = np.asarray(np.isfinite(position).all(axis=1), dtype=np.bool_)
    turn = np.broadcast_to(np.eye(3), (len(stations), 3, 3)).copy()
    to_grid = turn.copy()
    if reference.crs:
        if crs is None:
            message = f"positions are in {reference.crs}, but the project has no crs; name it in orip.toml"
            raise InputError.single(message)
        place, is_geocentric = geographic_from_crs(position[known], reference.crs, crs)
        frame = ground_frame(crs, ground_unit, near_place(crs, ground_unit, np.median(place, axis=0)))
        position[known] = frame.crs.from_geographic(place)
        to_grid[known] = frame.grid_axes_at(position[known])
        turn[known] = to_grid[known] @ place_axes(place) if is_geocentric else to_grid[known]
    elif crs is not None and known.any():
        to_grid[known] = _frame(crs, ground_unit, position[known]).grid_axes_at(position[known])
    moved = [
        _moved(station, position[row], turn[row]) if known[row] and reference.crs else station
        for row, station in enumerate(stations)
    ]
    return tuple(_turned(moved, to_grid, known) if reference.navigation else moved)


def _frame(crs: str, ground_unit: str, position: FloatArray) -> GroundFrame:
    return ground_frame(crs, ground_unit, np.median(position, axis=0))


def _moved(station: Station, position: FloatArray, turn: FloatArray) -> Station:
    """Return a station at a position, its errors along turned axes where all of them are used or compared alike."""
    x, y, z = position.tolist()
    station = replace(station, position=(x, y, z), motion=motion_along(station.motion, turn))
    errors = np.array(station.position_error)
    if not ((errors > 0.0).all() or (errors < 0.0).all()):
        return station
    given = np.diag(errors**2) if station.covariance is None else np.array(station.covariance)
    covariance = turn @ given @ turn.T
    first, second, third = (np.sign(errors) * np.sqrt(np.diag(covariance))).tolist()
    rows = tuple((float(row[0]), float(row[1]), float(row[2])) for row in covariance)
    return replace(station, position_error=(first, second, third), covariance=rows)


def motion_along(motion: StationMotion | None, turn: FloatArray, per_unit: float = 1.0) -> StationMotion | None:
    """Return a motion along and about axes to which a rotation (3, 3) takes those that it is along.

    `per_unit` is how much of its unit of length the new one has.
    """
    if motion is None:
        return None
    turned = [turn @ np.array(motion.velocity) / per_unit, turn @ np.array(motion.rate)]
    errors = [
        np.sqrt(turn**2 @ np.square(motion.velocity_error)) / per_unit, np.sqrt(turn**2 @ np.square(motion.rate_error)),
    ]  # fmt: skip
    velocity, rate, velocity_error, rate_error = ((one[0], one[1], one[2]) for one in map(list, [*turned, *errors]))
    return StationMotion(velocity, velocity_error, rate, rate_error)


def _turned(stations: Sequence[Station], to_grid: FloatArray, known: BoolArray) -> list[Station]:
    """Return stations whose roll, pitch and heading are turned to omega, phi and kappa."""
    angles = np.array([station.angles for station in stations], dtype=np.float64)
    rotation = to_grid @ rotation_from_navigation(angles)
    found = angles_from_rotation(rotation)
    result = []
    for row, station in enumerate(stations):
        if not station.has_angles:
            result.append(station)
            continue
        if not known[row]:
            message = f"roll, pitch and heading of photo {station.photo} need its position; give X, Y and Z"
            raise InputError.single(message, line=station.line)
        roll, pitch, heading = station.angle_error
        level = roll if abs(roll) >= abs(pitch) else pitch
        omega, phi, kappa = found[row].tolist()
        result.append(replace(station, angles=(omega, phi, kappa), angle_error=(level, level, heading)))
    return result


_SHORT, _LONG = (1e4, 1e6), (1e6, 6e6)
"""Metres: eastings of UTM, and of Gauss-Krüger with its zones 1 to 5."""

_ZONE, _MIDDLE = 1e6, 5e5
"""Metres: what a zone of Gauss-Krüger adds to the easting, and the easting of any central meridian."""

_UTM_ZONES = 60

_NEXT = (1, -1, 2, -2)
"""Zones of UTM that an area is given in by mistake, from its own."""

_DHDN = "+ellps=bessel +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7"
"""Datum of the German system; those of its neighbours differ by some hundred metres."""


def readings_in_another_grid(xy: FloatArray, others: FloatArray) -> Iterator[tuple[FloatArray, str, str]]:
    """Yield coordinates as they are in a grid that others may have, and what both then are.

    Parameters
    ----------
    xy, others : arrays (n, 2), (m, 2)
        Easting and northing, metres.

    Yields
    ------
    array (n, 2), str, str
        `xy` in the other grid; what `xy` is given in, and what the others are.
    """
    own, other = (float(np.median(of[:, 0])) for of in (xy, others))
    if _is_long(own) and _SHORT[0] < other < _SHORT[1]:
        yield from _in_utm(xy, int(own // _ZONE))
    elif _is_long(own) and _is_long(other) and own // _ZONE != other // _ZONE:
        zones = int(own // _ZONE), int(other // _ZONE)
        for width in (3, 6):
            source, target = (_gauss_krueger(zone, width) for zone in zones)
            own_zone, other_zone = (f"Gauss-Krüger coordinates of zone {zone}" for zone in zones)
            yield _transformed(xy, source, target), own_zone, other_zone
    elif all(_SHORT[0] < easting < _SHORT[1] for easting in (own, other)):
        for step in _NEXT:
            for side in ("", " +south"):
                source, target = (f"+proj=utm +zone={zone} +ellps=GRS80{side}" for zone in (30, 30 + step))
                sides = ("western", "eastern") if step > 0 else ("eastern", "western")
                own_zone, other_zone = (f"UTM coordinates of the {side} of two zones" for side in sides)
                yield _transformed(xy, source, target), own_zone, other_zone


def _is_long(easting: float) -> bool:
    return bool(_LONG[0] < easting < _LONG[1] and abs(easting % _ZONE - _MIDDLE) < 0.8 * _MIDDLE)


def _gauss_krueger(zone: int, width: int) -> str:
    meridian = 3 * zone if width == 3 else 6 * zone - 3
    return f"+proj=tmerc +lon_0={meridian} +k=1 +x_0={_MIDDLE + zone * _ZONE} {_DHDN}"


def _in_utm(xy: FloatArray, zone: int) -> Iterator[tuple[FloatArray, str, str]]:
    for width in (3, 6):
        source = _gauss_krueger(zone, width)
        longitude = float(_transformed(xy[:1], source, "+proj=longlat +ellps=GRS80")[0, 0])
        if not np.isfinite(longitude):
            continue
        natural = int((longitude + 180.0) // 6.0)
        for utm in ((natural + step) % _UTM_ZONES + 1 for step in (0, -1, 1)):
            target = f"+proj=utm +zone={utm} +ellps=GRS80"
            yield (
                _transformed(xy, source, target),
                f"Gauss-Krüger coordinates of zone {zone}",
                f"UTM coordinates of zone {utm}",
            )


def _transformed(xy: FloatArray, source: str, target: str) -> FloatArray:
    """Return coordinates (n, 2) in another system of PROJ, infinite where it has no such place."""
    import pyproj

    transformer = pyproj.Transformer.from_crs(f"{source} +type=crs", f"{target} +type=crs", always_xy=True)
    return np.column_stack(transformer.transform(xy[:, 0], xy[:, 1])).astype(np.float64)
