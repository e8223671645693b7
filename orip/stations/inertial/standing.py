"""When a body stands: the unit is quieter than on anything that moves, and the receiver shows no movement."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.stations.inertial.samples import Fixes, ImuSamples

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
