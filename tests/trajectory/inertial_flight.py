"""Flights with strips and turns, and what an inertial measurement unit and a receiver observe of them.

Nothing of orip's mechanisation is used: specific force and rates follow from closed forms of a path, differentiated.
"""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

from orip.geometry.ground_ellipsoid import geocentric_from_geographic, place_axes
from orip.records.epochs import SECONDS_PER_WEEK
from orip.stations.inertial.samples import Fixes, ImuNoise, ImuSamples, LocalGravity
from orip.stations.interpolation import WGS84

LATITUDE, HEIGHT = np.radians(50.0), 400.0
GRAVITY = LocalGravity(LATITUDE, HEIGHT)
EARTH = 7.292115e-5 * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
LEVER_ARM = np.array([0.4, -0.2, -1.1])

MEMS = ImuNoise(np.radians(0.004), 6e-4, np.radians(1e-4), 1e-5, np.radians(0.1), 0.03)
TACTICAL = ImuNoise(np.radians(0.0003), 2e-4, np.radians(1e-6), 1e-6, np.radians(0.0005), 0.005)


@dataclass(frozen=True)
class Flight:
    """The truth at the times of the samples: time (n,), place (n, 3), velocity, rotation (n, 3, 3) body to local."""

    time: np.ndarray
    place: np.ndarray
    velocity: np.ndarray
    rotation: np.ndarray
    force: np.ndarray
    rate: np.ndarray


def flight(strips: int = 3, straight: float = 30.0, rate: float = 200.0, speed: float = 12.0) -> Flight:
    """Return a flight of strips with turns between them; it begins with ten seconds of hovering."""
    knots, courses, speeds = [0.0, 10.0, 16.0], [0.3, 0.3, 0.3], [0.0, 0.0, speed]
    course, turn = 0.3, 12.0
    for strip in range(strips):
        knots += [knots[-1] + straight, knots[-1] + straight + turn]
        courses += [course, course + (np.pi if strip % 2 == 0 else -np.pi)]
        speeds += [speed, speed]
        course = courses[-1]
    time = np.arange(0.0, knots[-1], 1.0 / rate)
    # smooth: splines through the interpolated profiles at ten points a second
    coarse = np.arange(0.0, knots[-1] + 0.1, 0.1)
    course_of = CubicSpline(coarse, _smoothed(PchipInterpolator(knots, courses)(np.minimum(coarse, knots[-1]))))
    speed_of = CubicSpline(coarse, _smoothed(PchipInterpolator(knots, speeds)(np.minimum(coarse, knots[-1]))))
    course, course_rate = course_of(time), course_of(time, 1)
    way, gain = speed_of(time), speed_of(time, 1)
    climb = 0.4 * np.sin(0.35 * time)
    velocity = np.column_stack([way * np.sin(course), way * np.cos(course), climb])
    acceleration = np.column_stack([
        gain * np.sin(course) + way * course_rate * np.cos(course),
        gain * np.cos(course) - way * course_rate * np.sin(course),
        0.4 * 0.35 * np.cos(0.35 * time),
    ])  # fmt: skip
    primitive = CubicSpline(time, velocity).antiderivative()
    place = primitive(time)
    # heading, pitch and roll with their rates; the body leans into turns and nods
    bank = np.arctan2(way * course_rate, 9.81)
    bank_rate = CubicSpline(time, bank)(time, 1)
    roll, roll_rate = bank + 0.03 * np.sin(1.1 * time), bank_rate + 0.033 * np.cos(1.1 * time)
    pitch, pitch_rate = 0.05 * np.sin(0.7 * time), 0.035 * np.cos(0.7 * time)
    heading, heading_rate = course + 0.05, course_rate
    # north, east, down to east, north, up
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    rotation = swap @ Rotation.from_euler("ZYX", np.column_stack([heading, pitch, roll])).as_matrix()
    rates = np.column_stack([
        roll_rate - heading_rate * np.sin(pitch),
        pitch_rate * np.cos(roll) + heading_rate * np.sin(roll) * np.cos(pitch),
        -pitch_rate * np.sin(roll) + heading_rate * np.cos(roll) * np.cos(pitch),
    ])  # fmt: skip
    gravity = np.array([GRAVITY.at(point) for point in place])
    turned = np.swapaxes(rotation, 1, 2)
    force = np.einsum("nij,nj->ni", turned, acceleration - gravity + 2.0 * np.cross(EARTH, velocity))
    rates = rates + np.einsum("nij,j->ni", turned, EARTH)
    return Flight(time, place, velocity, rotation, force, rates)


def _smoothed(values: np.ndarray) -> np.ndarray:
    kernel = np.hanning(21)
    padded = np.concatenate([np.full(10, values[0]), values, np.full(10, values[-1])])
    return np.convolve(padded, kernel / kernel.sum(), mode="valid")


def observed(
    truth: Flight,
    noise: ImuNoise,
    random: np.random.Generator,
    interval: float = 1.0,
    deviation: tuple[float, float, float] = (0.02, 0.02, 0.04),
    scale: float = 1.0,
    speed: float = 0.0,
    late: float = 0.0,
) -> tuple[ImuSamples, Fixes]:
    """Return samples and fixes of a flight; `scale` of the true noise of the unit to that said.

    With the standard deviation of a `speed`, m/s, the fixes have the velocity of the antenna, that of the time by which
    they are `late`.
    """
    step = float(np.diff(truth.time).mean())
    count = len(truth.time)

    def errors(white: float, walk: float, first: float) -> np.ndarray:
        bias = first * random.standard_normal(3) + np.cumsum(
            walk * np.sqrt(step) * random.standard_normal((count, 3)), axis=0
        )
        return bias + scale * white / np.sqrt(step) * random.standard_normal((count, 3))

    imu = ImuSamples(
        truth.time,
        truth.force + errors(noise.accelerometer, noise.accelerometer_walk, noise.accelerometer_bias),
        truth.rate + errors(noise.gyro, noise.gyro_walk, noise.gyro_bias),
    )
    every = round(interval / step)
    at = np.arange(every, count - 1, every)
    antenna = truth.place[at] + truth.rotation[at] @ LEVER_ARM
    place = antenna + np.array(deviation) * random.standard_normal((len(at), 3))
    covariance = np.broadcast_to(np.diag(np.square(deviation)), (len(at), 3, 3)).copy()
    velocity, known = np.full((len(at), 3), np.nan), np.full((len(at), 3), speed or np.nan)
    if speed:
        then = at - round(late / step)
        turning = truth.rate[then] - np.einsum("nji,j->ni", truth.rotation[then], EARTH)
        swing = np.einsum("nij,nj->ni", truth.rotation[then], np.cross(turning, LEVER_ARM))
        velocity = truth.velocity[then] + swing + speed * random.standard_normal((len(at), 3))
    return imu, Fixes(truth.time[at], place, covariance, velocity, known)


START = 1316 * SECONDS_PER_WEEK + 1000.0


def written(folder: Path, truth: Flight, imu: ImuSamples, fixes: Fixes, **change: object) -> None:
    """Write a unit's table and positions of RTKLIB, geocentric."""
    origin = np.array([[0.2, LATITUDE, HEIGHT]])
    place = geocentric_from_geographic(origin, WGS84) + fixes.place @ place_axes(origin)[0]
    lines = ["%  GPST  x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s) ratio"]
    for time, point in zip(fixes.time + START, place, strict=True):
        week, seconds = divmod(time, SECONDS_PER_WEEK)
        xyz = " ".join(f"{value:.4f}" for value in point)
        lines.append(f"{week:.0f} {seconds:.3f} {xyz} 1 9 0.03 0.03 0.03 0 0 0 0 9")
    (folder / "flight.pos").write_text("\n".join(lines) + "\n")
    time = imu.time + START + float(change.get("late", 0.0))  # type: ignore[arg-type]
    table = np.column_stack([time, imu.force * float(change.get("force", 1.0)), imu.rate])  # type: ignore[arg-type]
    text = "time,fx,fy,fz,wx,wy,wz\n" + "\n".join(
        ",".join(f"{value:.9g}" if n else f"{value:.6f}" for n, value in enumerate(row)) for row in table
    )
    (folder / "imu.csv.gz").write_bytes(gzip.compress(text.encode(), 1))


LEVER = "--lever-arm=" + ",".join(map(str, LEVER_ARM))
