"""Ground coordinates of other programs in one plain system: east, north and up at a place, metres.

Programs that adjust on the earth do so in geocentric coordinates, or in those of a plane that touches the ellipsoid,
and have control and positions of photos in longitude and latitude or on a map. All of them are taken to the touching
plane's system, which is Cartesian: nothing is distorted, and no `crs` is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.exchange.conversion.poses import exchanged_poses, orip_poses
from orip.geometry.ground_crs import known_crs
from orip.geometry.ground_ellipsoid import geocentric_from_geographic, geographic_from_geocentric, place_axes
from orip.geometry.other_crs import crs_from_geographic, geographic_from_crs
from orip.geometry.rotation import navigation_from_rotation, rotation_from_navigation
from orip.records.control import NOT_GIVEN, ControlPoint, Station, StationReference
from orip.records.exchanged import ExchangedProject, GroundFrame, MappedPlaces
from orip.structs import replace

_WGS84 = (6_378_137.0, 6_356_752.314245)
"""Semi-axes, metres."""

_ON_WGS84 = "EPSG:32631"
"""A projected system on WGS 84; what is taken from it is its datum."""

_PLACES = 4
"""Decimals of a degree to which a new origin is rounded, so that it is the same when the project is read again."""


class LocalGround(Struct, frozen=True):
    """A system of east, north and up.

    Parameters
    ----------
    geographic : array (3,)
        Longitude, latitude (radians) and ellipsoidal height (m) of its origin, WGS 84.
    """

    geographic: FloatArray

    @property
    def origin(self) -> FloatArray:
        """Return the geocentric coordinates (3,) of the origin."""
        return np.asarray(geocentric_from_geographic(self.geographic[None], _WGS84)[0])

    @property
    def axes(self) -> FloatArray:
        """Return east, north and up in the rows of a matrix (3, 3), geocentric."""
        return np.asarray(place_axes(self.geographic[None])[0])

    def from_geocentric(self, geocentric: FloatArray) -> FloatArray:
        """Return east, north and up (n, 3) of geocentric coordinates (n, 3)."""
        return np.asarray((geocentric - self.origin) @ self.axes.T)

    def to_geocentric(self, local: FloatArray) -> FloatArray:
        """Return geocentric coordinates (n, 3) of east, north and up (n, 3)."""
        return np.asarray(local @ self.axes + self.origin)

    def from_crs(self, xyz: FloatArray, crs: str) -> FloatArray:
        """Return east, north and up (n, 3) of coordinates (n, 3) in another system, x or longitude first.

        Raises
        ------
        InputError
            If the system is not known, or has no such places.
        """
        geographic, _ = geographic_from_crs(xyz, crs, _ON_WGS84)
        return self.from_geocentric(geocentric_from_geographic(geographic, _WGS84))

    def to_crs(self, local: FloatArray, crs: str) -> FloatArray:
        """Return coordinates (n, 3) in another system of east, north and up (n, 3), the inverse of `from_crs`.

        Raises
        ------
        InputError
            If the system is not known, or has no such places.
        """
        geographic = geographic_from_geocentric(self.to_geocentric(local), _WGS84)
        return crs_from_geographic(geographic, crs, _ON_WGS84)


def local_ground(project: ExchangedProject) -> LocalGround | None:
    """Return the local system of a project on the earth; None of one in a plain system."""
    if project.frame.kind == "topocentric":
        longitude, latitude, height = project.frame.origin
        return LocalGround(np.array([np.radians(longitude), np.radians(latitude), height]))
    if project.frame.kind == "plain":
        return None
    _, centres = orip_poses(project.photos, project.readings[0])
    known = centres[np.isfinite(centres).all(axis=1)]
    if not len(known):
        return None
    return _rounded(geographic_from_geocentric(np.median(known, axis=0)[None], _WGS84)[0])


def local_ground_at(place: FloatArray, crs: str) -> LocalGround:
    """Return the local system at a place (3,) in another system, x or longitude first.

    Raises
    ------
    InputError
        If the system is not known, or has no such place.
    """
    return _rounded(geographic_from_crs(place[None], crs, _ON_WGS84)[0][0])


def _rounded(geographic: FloatArray) -> LocalGround:
    degrees = np.round(np.degrees(geographic[:2]), _PLACES)
    return LocalGround(np.array([*np.radians(degrees), np.round(geographic[2])]))


def in_local_ground(project: ExchangedProject, ground: LocalGround) -> ExchangedProject:
    """Return a project with everything in a local system.

    Raises
    ------
    InputError
        If control or positions are in a system that is not known.
    """
    is_geocentric = project.frame.kind == "geocentric"
    turned = _turned(project, ground) if is_geocentric else project
    reference = project.station_reference
    stations = project.stations
    if reference.crs or is_geocentric:
        places = np.array([station.position for station in stations]).reshape(-1, 3)
        stations = _stations(stations, _local(places, ground, reference.crs), ground, is_turned=reference.navigation)
    return replace(
        turned,
        control=_control(project.control, ground, project.control_crs, is_geocentric=is_geocentric),
        control_crs="",
        stations=stations,
        station_reference=StationReference(navigation=reference.navigation),
        crs=None,
        ground_unit="m",
        frame=GroundFrame(),
        notes=(*project.notes, *said_of_ground(ground, project.control_crs, reference.crs)),
    )


def from_local_ground(project: ExchangedProject, ground: LocalGround, crs: str = "") -> ExchangedProject:
    """Return a project in a local system in geocentric coordinates; its readings are kept.

    Parameters
    ----------
    crs : str
        The system of control and of observed positions, of which those in the local system are taken there, angles are
        left out; empty: they are geocentric, too.

    Raises
    ------
    InputError
        If the system is not known.
    """
    rotations, centres = orip_poses(project.photos, project.readings[0])
    coordinates = project.points.coordinates

    def out_of_local(places: FloatArray) -> FloatArray:
        known = np.isfinite(places).all(axis=1)
        found = np.full_like(places, np.nan)
        if known.any():
            found[known] = ground.to_crs(places[known], crs) if crs else ground.to_geocentric(places[known])
        return found

    placed = _placed(
        project, ground.axes.T @ rotations, ground.to_geocentric(centres), ground.to_geocentric(coordinates)
    )
    stations = project.stations
    if not project.station_reference.crs:
        places = out_of_local(np.array([station.position for station in stations]).reshape(-1, 3))
        stations = tuple(_moved(station, place) for station, place in zip(stations, places.tolist(), strict=True))
    return replace(
        placed,
        control=_with_places(project.control, out_of_local, 0.0),
        control_crs=crs,
        stations=stations,
        station_reference=StationReference(project.station_reference.crs or crs),
        frame=GroundFrame("geocentric"),
        mapped=MappedPlaces(out_of_local(centres), out_of_local(coordinates)) if crs else None,
    )


def _turned(project: ExchangedProject, ground: LocalGround) -> ExchangedProject:
    rotations, centres = orip_poses(project.photos, project.readings[0])
    points = ground.from_geocentric(project.points.coordinates)
    return _placed(project, ground.axes @ rotations, ground.from_geocentric(centres), points)


def _placed(
    project: ExchangedProject, rotations: FloatArray, centres: FloatArray, points: FloatArray
) -> ExchangedProject:
    """Return a project with other rotations, projection centres and points; their deviations are those of before."""
    numbers, positions = exchanged_poses(rotations, centres, project.readings[0])
    photos = tuple(
        replace(photo, rotation=tuple(numbers[n].tolist()), position=tuple(positions[n].tolist()))
        if photo.rotation and photo.position
        else photo
        for n, photo in enumerate(project.photos)
    )
    return replace(project, photos=photos, points=replace(project.points, coordinates=points))


def _local(places: FloatArray, ground: LocalGround, crs: str) -> FloatArray:
    if not len(places):
        return places
    return ground.from_crs(places, crs) if crs else ground.from_geocentric(places)


def _control(
    control: Sequence[ControlPoint], ground: LocalGround, crs: str, *, is_geocentric: bool
) -> tuple[ControlPoint, ...]:
    """Return control in the local system; points without all coordinates keep those that they have.

    Where the height is not known, X and Y are converted at the height of the origin.
    """
    if not control or not (crs or is_geocentric):
        return tuple(control)
    return _with_places(control, lambda places: _local(places, ground, crs), float(ground.geographic[2]))


def _with_places(
    control: Sequence[ControlPoint], moved: Callable[[FloatArray], FloatArray], height: float
) -> tuple[ControlPoint, ...]:
    """Return control points with X and Y at other places; those without a height are moved at the height given."""
    complete = [point for point in control if None not in point.coordinates[:2]]
    places = np.array(
        [[height if value is None else value for value in point.coordinates] for point in complete], dtype=np.float64
    ).reshape(-1, 3)
    return tuple(
        replace(point, coordinates=(x, y, None if point.coordinates[2] is None else z))
        for point, (x, y, z) in zip(complete, moved(places).tolist(), strict=True)
    )


def _stations(
    stations: Sequence[Station], places: FloatArray, ground: LocalGround, *, is_turned: bool
) -> tuple[Station, ...]:
    """Return stations at local places; roll, pitch and heading refer to the local axes then, other angles are lost."""
    if not is_turned or not stations:
        return tuple(_moved(station, place) for station, place in zip(stations, places.tolist(), strict=True))
    angles = np.array([station.angles for station in stations])
    there = place_axes(geographic_from_geocentric(ground.to_geocentric(places), _WGS84))
    turned = ground.axes @ np.swapaxes(there, -1, -2) @ rotation_from_navigation(angles)
    return tuple(
        replace(_moved(station, place), angles=(roll, pitch, heading), angle_error=station.angle_error)
        for station, place, (roll, pitch, heading) in zip(
            stations, places.tolist(), navigation_from_rotation(turned).tolist(), strict=True
        )
    )


def _moved(station: Station, place: Sequence[float]) -> Station:
    """Return a station at another place, without angles, motion and covariances."""
    x, y, z = place
    return replace(station, position=(x, y, z), angles=NOT_GIVEN, angle_error=NOT_GIVEN, covariance=None, motion=None)


def _said_of_feet(systems: Iterable[str]) -> Iterator[str]:
    """Yield a sentence for each system whose map is not in metres and which has no heights of its own."""
    for crs in sorted({*systems} - {""}):
        whole = known_crs(crs)
        axis = whole.axis_info[0]
        if whole.is_projected and len(whole.axis_info) == 2 and axis.unit_conversion_factor != 1.0:
            yield (
                f"X and Y in {crs} ({whole.name}) are in {axis.unit_name}, and it has no heights: Z counts in metres; "
                "convert Z, or name a system of heights too, if it is not."
            )


def said_of_ground(ground: LocalGround, *systems: str) -> Iterator[str]:
    """Yield a sentence that names the place of a local system, and those on heights of systems that came into it."""
    longitude, latitude = np.degrees(ground.geographic[:2]).tolist()
    yield (
        f"Coordinates are east, north and up, in metres, at longitude {longitude:.9f}, latitude {latitude:.9f}, "
        f"ellipsoidal height {ground.geographic[2]:.3f} m; heights of control and photos count as ellipsoidal unless "
        "their system says otherwise."
    )
    yield from _said_of_feet(systems)
