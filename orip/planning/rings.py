"""Networks round an object: stations on rings that look at its centre, and the convergent rays that its points get."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.errors import InputError
from orip.geometry.rotation import looking_along, rotation_from_angles
from orip.planning.geometry import Frame
from orip.planning.plan import PlannedFlight, frame_of, planned_station
from orip.records.camera import Camera
from orip.records.control import ControlPoint, Station
from orip.records.plan import PlanSettings
from orip.units import RADIANS_PER_DEGREE

_MOST_STATIONS = 60
"""On a ring: more of them are closer together than convergent rays are."""


class Object(Struct, frozen=True):
    """What a network is round: its points (n, 3), their middle (3,), and the radius of the sphere round them."""

    points: FloatArray
    centre: FloatArray
    radius: float


def object_of(settings: PlanSettings, control: Sequence[ControlPoint]) -> Object:
    """Return the object: the points of the .PNT file, or points spread over a box.

    Raises
    ------
    InputError
        If the .PNT file has fewer than three points with all coordinates, or all at one place.
    """
    if not settings.object:
        points = points_of_box(settings.centre, settings.size, settings.tie_points)
        return Object(points, np.array(settings.centre), 0.5 * math.hypot(*settings.size))
    points = np.array(
        [p.coordinates for p in control if None not in p.coordinates and not p.rejected], dtype=np.float64
    )
    if len(points) < 3 or not np.ptp(points, axis=0).any():
        message = (
            'object = "control" needs three points at least with X, Y and Z in the .PNT file; or give centre and size'
        )
        raise InputError.single(message, "orip.toml")
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return Object(points, centre, float(np.linalg.norm(points - centre, axis=1).max()))


def plan_rings(settings: PlanSettings, camera: Camera, seen: Object) -> PlannedFlight:
    """Return stations on rings round an object, all looking at its centre, with the camera turned about its axis.

    The distance at which the object fills the frame is that at which the sphere round it does. Where `rays` are asked
    for, each ring gets the least number of stations with which each point has them.

    Raises
    ------
    InputError
        If the distance is within the object, no station is left, or no number of stations gives the rays.
    """
    frame = frame_of(camera, settings.across)
    half = math.atan(0.5 * min(frame.along, frame.across) / frame.c)
    distance = seen.radius / math.sin(half) if settings.distance is None else settings.distance
    if distance <= seen.radius:
        message = f"distance = {distance:g} is within the object, which reaches {seen.radius:.3g} from its centre"
        raise InputError.single(message, "orip.toml")
    for count in range(settings.stations, max(settings.stations, _MOST_STATIONS) + 1):
        stations = _on_rings(settings, seen.centre, distance, count)
        rays = convergent_rays(seen.points, stations, frame_of(camera, "height"), settings.convergence)
        if not settings.rays or rays.min() >= settings.rays:
            pixel = frame.pixel * distance / frame.c
            return PlannedFlight(tuple(stations), distance, pixel, math.nan, math.nan, 0.0, 0.0, 0, 0, int(rays.min()))
    message = (
        f"rays = {settings.rays} is not reached with {count} stations on each ring: {np.sum(rays < settings.rays)} of "
        f"{len(rays)} points have fewer, the worst {rays.min()}, that enclose {settings.convergence:g} degrees; give "
        "more elevations, a greater distance, or a smaller convergence"
    )
    raise InputError.single(message, "orip.toml")


def _on_rings(settings: PlanSettings, centre: FloatArray, distance: float, count: int) -> list[Station]:
    turned = _turned_to(np.array(settings.axis))
    stations: list[Station] = []
    for ring, elevation in enumerate(settings.elevations):
        # rings are turned by half a step, so that rays of two do not lie in one plane
        azimuths = (np.arange(count) + 0.5 * (ring % 2)) * 2.0 * math.pi / count
        for azimuth in azimuths.tolist():
            direction = turned @ _direction(azimuth, elevation * RADIANS_PER_DEGREE)
            place = centre + distance * direction
            if settings.lowest is not None and place[2] < settings.lowest:
                continue
            for roll in settings.rolls:
                rotation = looking_along(-direction, roll * RADIANS_PER_DEGREE)
                stations.append(planned_station(len(stations) + 1, place, rotation, settings, 0.0, f"R{ring + 1}"))
    if not stations:
        message = f"all stations are below lowest = {settings.lowest:g}; check centre, distance and elevations"
        raise InputError.single(message, "orip.toml")
    return stations


def convergent_rays(points: FloatArray, stations: Sequence[Station], frame: Frame, least: float) -> IntArray:
    """Return how many rays (n,) of each point enclose an angle with each other, of photos whose frame it is in.

    Two rays from opposite sides are on one line, and do not intersect; of photos from one place one counts. Rays are
    taken in the order of the photos where they enclose enough with all before: there may be better choices, never a
    worse one.

    Parameters
    ----------
    points : array (n, 3)
    frame : Frame
        Along and across are the photo's x and y.
    least : float
        Between two rays, degrees.
    """
    limit = math.cos(least * RADIANS_PER_DEGREE) + 1e-9
    half = 0.5 * np.array([frame.along, frame.across])
    chosen: list[tuple[FloatArray, FloatArray]] = []
    found = np.zeros(len(points), dtype=np.int64)
    rotations = rotation_from_angles(np.array([station.angles for station in stations]))
    for station, rotation in zip(stations, rotations, strict=True):
        ray = points - station.position
        u = ray @ rotation
        front = u[:, 2] < 0.0
        xy = -frame.c * u[:, :2] / np.where(front, u[:, 2], -np.inf)[:, None]
        taken = front & (np.abs(xy) <= half).all(axis=1)
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        for other, there in chosen:
            taken &= ~(there & (np.abs(np.einsum("ij,ij->i", ray, other)) > limit))
        chosen.append((ray, taken))
        found += taken
    return found


def points_of_box(centre: Sequence[float], size: Sequence[float], count: int) -> FloatArray:
    """Return points (n, 3) spread over a box, about so many."""
    side = max(2, round(count ** (1.0 / 3.0)))
    parts = np.linspace(-0.45, 0.45, side)
    grid = np.stack(np.meshgrid(parts, parts, parts, indexing="ij"), axis=-1).reshape(-1, 3)
    # a grid in planes through the axes would leave distortion less determined than an object does
    shift = 0.05 * np.sin(np.arange(3 * len(grid)).reshape(-1, 3) * 2.399963)
    return np.asarray(centre + (grid + shift) * size)


def _direction(azimuth: float, elevation: float) -> FloatArray:
    flat = math.cos(elevation)
    return np.array([flat * math.sin(azimuth), flat * math.cos(azimuth), math.sin(elevation)])


def _turned_to(axis: FloatArray) -> FloatArray:
    """Return the least rotation (3, 3) that takes Z to an axis.

    Raises
    ------
    InputError
        If the axis is no direction.
    """
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        message = "axis = [0, 0, 0] is no direction; give [0, 0, 1] for rings about a vertical axis"
        raise InputError.single(message, "orip.toml")
    x, y, z = (axis / length).tolist()
    if z < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    turned = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.asarray(np.eye(3) + turned + turned @ turned / (1.0 + z))
