"""A plan: the exposures of a flight, their times, and what they cost."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint, InputError, ProjectWarning
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.planning.geometry import (
    Frame,
    Strip,
    Terrain,
    Wanted,
    best_azimuth,
    height_of_pixel,
    strips_along,
    strips_over,
)
from orip.records.camera import Camera
from orip.records.control import ANGLES_ONLY_COMPARED, NOT_GIVEN, ONLY_COMPARED, Station
from orip.records.plan import PlanSettings
from orip.structs import replace
from orip.units import METRES_PER_GROUND_UNIT, RADIANS_PER_DEGREE

_LARGEST_PIXEL = 1.0
"""Metres on the ground; photos of larger ones are taken from space."""


class PlannedFlight(Struct, frozen=True):
    """A plan and what it costs.

    Parameters
    ----------
    stations : tuple of Station
        Planned exposures: position, omega, phi and kappa with their a-priori errors, time since the start, strip.
    height, pixel : float
        Above ground, and of a pixel on the ground.
    base, spacing : float
        Between photos and strips; NaN where there is one alone.
    rays : int
        Convergent rays that each point of an object gets at least; 0: it is a flight.
    """

    stations: tuple[Station, ...]
    height: float
    pixel: float
    base: float
    spacing: float
    speed: float
    seconds: float
    turns: int
    batteries: int
    rays: int = 0


def frame_of(camera: Camera, across: str) -> Frame:
    """Return the camera with one of its sides across the flight.

    Raises
    ------
    InputError
        If it has neither sensor nor frame.
    """
    size = camera.sensor.size if camera.sensor is not None else camera.frame
    if size is None:
        message = f"camera {camera.name} has no format; give sensor = {{ ... }}, or frame = [x, y] (mm)"
        raise InputError.single(message, "orip.toml")
    along, over = (size[1], size[0]) if across == "width" else size
    # of film what a scan of 0.02 mm shows
    pixel = size[0] / camera.sensor.columns if camera.sensor is not None else 0.02
    return Frame(camera.parameters[0], along, over, pixel)


def plan_flight(settings: PlanSettings, camera: Camera, outline: FloatArray, terrain: Terrain) -> PlannedFlight:
    """Return the flight over an area, or along a line where a corridor is asked for.

    Parameters
    ----------
    outline : array (n, 2)

    Raises
    ------
    InputError
        If the settings contradict each other.
    """
    _refuse_fractions(settings)
    frame = frame_of(camera, settings.across)
    wanted = Wanted(
        _height(settings, frame),
        settings.forward / 100.0,
        settings.side / 100.0,
        settings.crab * RADIANS_PER_DEGREE,
        settings.margin,
        settings.follow,
    )

    def flown(azimuth: float) -> list[Strip]:
        return strips_over(outline, frame, wanted, terrain, azimuth)

    if settings.corridor > 0.0:
        strips = strips_along(outline, settings.corridor, frame, wanted, terrain)
    else:
        azimuth = (
            best_azimuth(outline, lambda at: _seconds(flown(at), settings, frame, wanted.height))
            if settings.direction is None
            else settings.direction * RADIANS_PER_DEGREE
        )
        strips = flown(azimuth)
    crossing = _cross_strips(settings, outline, frame, wanted, terrain, strips)
    tilts = [0.0] * len(strips) + [settings.cross_tilt * RADIANS_PER_DEGREE] * len(crossing)
    return _planned(settings, frame, wanted.height, [*strips, *crossing], tilts)


def _refuse_fractions(settings: PlanSettings) -> None:
    """Raise an error of overlaps that are written as a fraction of one, where percents are meant."""
    overlaps = (("forward", settings.forward), ("side", settings.side))
    complaints = [
        Complaint(
            f"{key} = {part:g} of [plan] is less than 1 percent; write percents: {key} = {100 * part:g}", "orip.toml"
        )
        for key, part in overlaps
        if 0.0 < part < 1.0
    ]
    if complaints:
        raise InputError(complaints)


def _height(settings: PlanSettings, frame: Frame) -> float:
    if (settings.pixel is None) == (settings.height is None):
        message = "give one of pixel (size on the ground), height (above ground) and sd (of heights) in [plan]"
        raise InputError.single(message, "orip.toml")
    if settings.height is not None:
        return settings.height
    assert settings.pixel is not None
    return height_of_pixel(frame, settings.pixel)


def size_warnings(settings: PlanSettings, ground_unit: str) -> Iterator[ProjectWarning]:
    """Warn of pixels of more than a metre on the ground, which are rather meant in another unit."""
    metres = (settings.pixel or 0.0) * METRES_PER_GROUND_UNIT.get(ground_unit, 0.0)
    if metres > _LARGEST_PIXEL:
        text = (
            f"pixel = {settings.pixel:g} is {metres:g} m on the ground; it is in the ground unit, {ground_unit}: "
            f"if this is in cm, write pixel = {0.01 * metres / METRES_PER_GROUND_UNIT[ground_unit]:g}"
        )
        yield ProjectWarning("large-pixel", "[plan] in orip.toml", text)


def _cross_strips(
    settings: PlanSettings,
    outline: FloatArray,
    frame: Frame,
    wanted: Wanted,
    terrain: Terrain,
    strips: Sequence[Strip],
) -> list[Strip]:
    """Return strips across all others, as many as are asked for, evenly over the area."""
    if not settings.cross_strips:
        return []
    if settings.corridor > 0.0:
        message = "cross_strips are for areas; give cross_strips = 0 with a corridor"
        raise InputError.single(message, "orip.toml")
    crossing = replace(wanted, height=wanted.height * settings.cross_height)
    found = strips_over(outline, frame, crossing, terrain, strips[0].azimuth + 0.5 * math.pi)
    if settings.cross_strips == 1:
        return [found[len(found) // 2]]
    places = np.linspace(0, len(found) - 1, min(settings.cross_strips, len(found))).round().astype(int)
    chosen = [found[place] for place in np.unique(places).tolist()]
    return [one if number % 2 == 0 else _turned(one, chosen[0]) for number, one in enumerate(chosen)]


def _turned(strip: Strip, first: Strip) -> Strip:
    """Return a strip flown against the first one."""
    if math.cos(strip.azimuth - first.azimuth) < 0.0:
        return strip
    return Strip(strip.places[::-1], strip.azimuth + math.pi)


def _planned(
    settings: PlanSettings, frame: Frame, height: float, strips: Sequence[Strip], tilts: Sequence[float]
) -> PlannedFlight:
    speed = _speed(settings, frame, height, strips)
    stations: list[Station] = []
    time = 0.0
    for number, (strip, tilt) in enumerate(zip(strips, tilts, strict=True)):
        rotation = _flown(strip.azimuth, tilt, settings.across)
        before = None
        for place in strip.places:
            time += 0.0 if before is None else float(np.linalg.norm(place - before)) / speed
            stations.append(planned_station(len(stations) + 1, place, rotation, settings, time, f"S{number + 1}"))
            before = place
        time += settings.turn
    seconds = _seconds(strips, settings, frame, height)
    gaps = [
        float(np.linalg.norm(strip.places[1, :2] - strip.places[0, :2])) for strip in strips if len(strip.places) > 1
    ]
    return PlannedFlight(
        tuple(stations),
        height,
        height * frame.pixel / frame.c,
        min(gaps, default=math.nan),
        _spacing(strips),
        speed,
        seconds,
        len(strips) - 1,
        math.ceil(seconds / (60.0 * settings.battery)),
    )


def _spacing(strips: Sequence[Strip]) -> float:
    if len(strips) < 2:
        return math.nan
    one, other = strips[0], strips[1]
    right = np.array([math.cos(one.azimuth), -math.sin(one.azimuth)])
    return abs(float((other.places[0, :2] - one.places[0, :2]) @ right))


def _speed(settings: PlanSettings, frame: Frame, height: float, strips: Sequence[Strip]) -> float:
    """Return the ground speed: the fastest that blur and the camera's interval allow.

    Raises
    ------
    InputError
        If it is so slow that nothing flies like that.
    """
    pixel = height * frame.pixel / frame.c
    speed = settings.speed if settings.shutter == 0.0 else min(settings.speed, settings.blur * pixel / settings.shutter)
    steps = [np.linalg.norm(np.diff(strip.places, axis=0), axis=1) for strip in strips if len(strip.places) > 1]
    least = min((float(step.min()) for step in steps), default=math.inf)
    if settings.interval > 0.0 and math.isfinite(least):
        speed = min(speed, least / settings.interval)
    if speed < _SLOWEST * settings.speed:
        message = (
            f"with a base of {least:.3g}, interval = {settings.interval:g} s, shutter = {settings.shutter:g} s and "
            f"blur = {settings.blur:g} pixels it would fly at {speed:.3g} a second, less than a hundredth of speed = "
            f"{settings.speed:g}: the camera is not fast enough; fly higher, or with less overlap"
        )
        raise InputError.single(message, "orip.toml")
    return speed


_SLOWEST = 0.01
"""Part of the fastest speed below which a flight makes no sense."""


def _seconds(strips: Sequence[Strip], settings: PlanSettings, frame: Frame, height: float) -> float:
    speed = _speed(settings, frame, height, strips)
    lengths = sum(float(np.linalg.norm(np.diff(strip.places, axis=0), axis=1).sum()) for strip in strips)
    between = sum(
        float(np.linalg.norm(after.places[0] - before.places[-1])) for before, after in itertools.pairwise(strips)
    )
    return (lengths + between) / speed + settings.turn * (len(strips) - 1)


def _flown(azimuth: float, tilt: float, across: str) -> FloatArray:
    """Return the rotation of photos of a strip: level, or looking forward by an angle."""
    kappa = -azimuth if across == "width" else 0.5 * math.pi - azimuth
    level: FloatArray = rotation_from_angles(np.array([[0.0, 0.0, kappa]]))[0]
    if tilt == 0.0:
        return level
    ahead = np.array([math.sin(azimuth), math.cos(azimuth), 0.0])
    right = np.array([ahead[1], -ahead[0], 0.0])
    axes = np.column_stack([right, ahead, [0.0, 0.0, 1.0]])
    forward = rotation_from_angles(np.array([[tilt, 0.0, 0.0]]))[0]
    return np.asarray(axes @ forward @ axes.T @ level)


def planned_station(
    number: int, place: FloatArray, rotation: FloatArray, settings: PlanSettings, time: float, strip: str
) -> Station:
    """Return a planned exposure; angles and positions that are not observed have negative errors."""
    angles = angles_from_rotation(rotation[None])[0]
    x, y, z = place.tolist()
    omega, phi, kappa = angles.tolist()
    degrees = settings.angle_error
    return Station(
        f"P{number:04d}",
        (x, y, z),
        settings.position_error or ONLY_COMPARED,
        (omega, phi, kappa),
        ANGLES_ONLY_COMPARED
        if degrees is None
        else (degrees[0] * RADIANS_PER_DEGREE, degrees[1] * RADIANS_PER_DEGREE, degrees[2] * RADIANS_PER_DEGREE),
        None,
        time,
        strip,
    )


def observed(stations: Sequence[Station]) -> Iterator[Station]:
    """Yield stations with what is observed of them: what is only planned has no error and is left out."""
    for station in stations:
        position = station.position_error[0] >= 0.0
        angles = station.angle_error[0] >= 0.0
        if position or angles:
            yield replace(
                station,
                position=station.position if position else NOT_GIVEN,
                position_error=station.position_error if position else NOT_GIVEN,
                angles=station.angles if angles else NOT_GIVEN,
                angle_error=station.angle_error if angles else NOT_GIVEN,
            )
