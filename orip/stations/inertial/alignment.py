"""Attitude at the beginning, without a magnetometer: from accelerations that both the unit and the receiver observed.

Velocity changes of the receiver, less those of gravity, are the integrated specific forces of the unit, turned by the
attitude sought; the attitudes in between follow from the gyroscopes. Gravity gives the level, manoeuvres give the
course: one rotation by least squares over all of them (Wahba's problem; Wu and Pan 2013, Velocity/position integration
formula, IEEE Transactions on Aerospace and Electronic Systems 49). A unit that is good enough and stands feels the
rotation of the Earth, which gives the course too (gyrocompass; Titterton and Weston 2004, Strapdown inertial navigation
technology, chapter 10).
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.geometry.frames import EARTH_RATE
from orip.stations.inertial.samples import Fixes, ImuSamples, Observed

STANDING_DEVIATION = 0.01
"""m/s of the velocity of what stands: of a tripod, or of wheels in the wind."""

_HALF = 0.5
"""Seconds to both sides that are looked at."""

_QUIET_FORCE, _QUIET_RATE = 0.05, np.radians(0.3)
"""m/s² and rad/s: standard deviation of forces, and size of rates; hands, motors and wheels make more."""

_MOVED = 0.05
"""m/s between fixes, beside what their standard deviations allow."""


def stands_at(imu: ImuSamples, fixes: Fixes, times: FloatArray) -> BoolArray:
    """Return at which times (k,) the body stands, array (k,)."""
    first, last = np.searchsorted(imu.time, times - _HALF), np.searchsorted(imu.time, times + _HALF)
    count = np.maximum(last - first, 1)[:, None]
    centred = imu.force - imu.force.mean(axis=0)
    spread = _window(centred**2, first, last) / count - (_window(centred, first, last) / count) ** 2
    turning = np.sqrt(_window(imu.rate**2, first, last) / count)
    is_quiet = (spread < _QUIET_FORCE**2).all(axis=1) & (turning < _QUIET_RATE).all(axis=1) & (last - first >= 20)
    return np.asarray(is_quiet & _unmoved(fixes, times))


def _unmoved(fixes: Fixes, times: FloatArray) -> BoolArray:
    """Return whether the fixes before and after each time are at one place."""
    after = np.clip(np.searchsorted(fixes.time, times, side="right"), 1, len(fixes.time) - 1)
    moved = np.linalg.norm(fixes.place[after] - fixes.place[after - 1], axis=1)
    deviation = np.sqrt(np.trace(fixes.covariance, axis1=1, axis2=2))
    allowed = 3.0 * np.hypot(deviation[after], deviation[after - 1])
    return np.asarray(moved < allowed + _MOVED * (fixes.time[after] - fixes.time[after - 1]))


def _window(values: FloatArray, first: np.ndarray, last: np.ndarray) -> FloatArray:
    """Return sums (k, 3) of values (n, 3) between rows."""
    sums = np.vstack([np.zeros(values.shape[1]), np.cumsum(values, axis=0)])
    return np.asarray(sums[last] - sums[first])


_STANDING_SPEED = 0.3
_STANDING_S = 5.0
_ENOUGH = 8.0
"""m/s: root of the sum of squares of horizontal velocity changes that give a course to a degree or so."""

_LONGEST_S = 120.0
_COMPASS_S = 30.0
_COARSEST_COMPASS = np.radians(20.0)
_MEMS_RATE = 1e-3
"""rad/s: a mean rate above is the bias of a small unit, not the rotation of the Earth."""


class Alignment(Struct, frozen=True):
    """The attitude at a time.

    Parameters
    ----------
    time : float
    rotation : array (3, 3)
        Body to local frame.
    gyro_bias : array (3,)
        rad/s, from standing; else zero.
    change : float
        Root of the sum of squares of the horizontal velocity changes that gave the course, m/s; NaN: by gyrocompass.
    deviation : float
        Of the course, radians.
    """

    time: float
    rotation: FloatArray
    gyro_bias: FloatArray
    change: float
    deviation: float


def course_deviation(gyro_bias: float, latitude: float) -> float:
    """Return the error of a gyrocompass, radians, by a bias across the meridian, rad/s; latitude in radians."""
    return float(gyro_bias / (EARTH_RATE * np.cos(latitude)))


def level_deviation(accelerometer_bias: float, gravity: float = 9.80665) -> float:
    """Return the error of a level, radians, by a horizontal bias, m/s²."""
    return float(accelerometer_bias / gravity)


def align(observed: Observed) -> Alignment:
    """Return the attitude at the first fix."""
    fixes = observed.fixes
    speed = np.linalg.norm(velocities_of(fixes)[:, :2], axis=1)
    moving = int(np.argmax(speed > _STANDING_SPEED)) if (speed > _STANDING_SPEED).any() else len(speed)
    moved = _by_movement(observed, moving)
    stood = _by_gyrocompass(observed, float(fixes.time[max(moving - 1, 0)]))
    return moved if stood is None or moved.deviation < stood.deviation else stood


def _by_movement(observed: Observed, moving: int) -> Alignment:
    imu, fixes, gravity = observed.imu, observed.fixes, observed.gravity
    velocity = velocities_of(fixes)
    bias = _standing_bias(imu, fixes.time[0], fixes.time[max(moving - 1, 0)])
    first = max(moving - 3, 0)
    turned = np.eye(3)
    change_b, change_n, squares = [], [], 0.0
    for at in range(first, len(fixes.time) - 1):
        begin, end = float(fixes.time[at]), float(fixes.time[at + 1])
        integral, turned = imu.integrated(begin, end, bias, turned)
        if not np.isfinite(velocity[[at, at + 1]]).all():
            continue
        difference = velocity[at + 1] - velocity[at]
        change_b.append(integral)
        change_n.append(difference - gravity.at(fixes.place[at]) * (end - begin))
        squares += float(difference[:2] @ difference[:2])
        if squares > _ENOUGH**2 or end - fixes.time[first] > _LONGEST_S:
            break
    rotation, deviation = _fitted(np.array(change_b).reshape(-1, 3), np.array(change_n).reshape(-1, 3), squares)
    back = _turned_between(imu, float(fixes.time[0]), float(fixes.time[first]), bias)
    return Alignment(float(fixes.time[0]), rotation @ back.T, bias, float(np.sqrt(squares)), deviation)


def _by_gyrocompass(observed: Observed, end: float) -> Alignment | None:
    """Return the attitude of a body that stands until a time; None: not long enough, or the unit is too coarse."""
    imu, noise, begin = observed.imu, observed.noise, float(observed.fixes.time[0])
    within = (imu.time >= begin) & (imu.time < end - 1.0)
    if end - begin < _COMPASS_S or not within.any():
        return None
    bias = float(np.hypot(noise.gyro_bias, noise.gyro / np.sqrt(end - begin)))
    deviation = course_deviation(bias, observed.gravity.latitude)
    if deviation > _COARSEST_COMPASS:
        return None
    up, turning = imu.force[within].mean(axis=0), imu.rate[within].mean(axis=0)
    up = up / np.linalg.norm(up)
    north = turning - (turning @ up) * up
    north = north / np.linalg.norm(north)
    rotation = np.array([np.cross(north, up), north, up])
    return Alignment(begin, rotation, np.zeros(3), np.nan, deviation)


def velocities_of(fixes: Fixes) -> FloatArray:
    """Return velocities (m, 3): those given, else of neighbouring positions."""
    if len(fixes.time) < 3:
        return fixes.velocity
    derived = np.gradient(fixes.place, fixes.time, axis=0)
    return np.where(np.isfinite(fixes.velocity), fixes.velocity, derived)


def _standing_bias(imu: ImuSamples, begin: float, end: float) -> FloatArray:
    within = (imu.time >= begin) & (imu.time < end - 1.0)
    if end - begin < _STANDING_S or not within.any():
        return np.zeros(3)
    mean: FloatArray = imu.rate[within].mean(axis=0)
    return mean if float(np.abs(mean).max()) > _MEMS_RATE else np.zeros(3)


def _turned_between(imu: ImuSamples, begin: float, end: float, bias: FloatArray) -> FloatArray:
    if end <= begin:
        return np.eye(3)
    return imu.integrated(begin, end, bias)[1]


def _fitted(body: FloatArray, frame: FloatArray, squares: float) -> tuple[FloatArray, float]:
    """Return the rotation of vectors (k, 3) to vectors (k, 3) by least squares, and the deviation of the course."""
    left, _, right = np.linalg.svd(frame.T @ body)
    rotation: FloatArray = left @ np.diag([1.0, 1.0, np.linalg.det(left) * np.linalg.det(right)]) @ right
    residual = frame - body @ rotation.T
    noise = float(np.sqrt(np.mean(residual[:, :2] ** 2))) if len(residual) else np.inf
    return rotation, noise / max(np.sqrt(squares), 1e-12)
