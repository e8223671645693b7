"""What an inertial measurement unit and a receiver observed, in one local frame, and pieces of it between two times."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.arrays import FloatArray
from orip.geometry.frames import EARTH_RATE


class ImuSamples(Struct, frozen=True):
    """n samples along the axes of the body: forward, to the right, down.

    Parameters
    ----------
    time : array (n,)
        Seconds, ascending.
    force : array (n, 3)
        Specific force, m/s²: a body at rest has (0, 0, -g).
    rate : array (n, 3)
        Angular rate, rad/s.
    """

    time: FloatArray
    force: FloatArray
    rate: FloatArray

    def pieces(self, begin: float, end: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return force (k, 3), rate (k, 3) and duration (k,) of the pieces between two times: trapezoidal rule."""
        first, last = np.searchsorted(self.time, [begin, end])
        inner = self.time[first:last]
        inner = inner[(inner > begin) & (inner < end)]
        times = np.concatenate([[begin], inner, [end]])
        around = slice(max(first - 1, 0), last + 1)  # of hours of samples only these are looked at
        values = [
            np.column_stack([np.interp(times, self.time[around], column) for column in both[around].T])
            for both in (self.force, self.rate)
        ]
        force, rate = ((part[1:] + part[:-1]) / 2.0 for part in values)
        return force, rate, np.diff(times)

    def integrated(
        self, begin: float, end: float, bias: FloatArray | None = None, turned: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the integrated force (3,) and how the body stands at the end (3, 3), along the axes of the beginning.

        `bias` of the gyroscopes is taken off; with `turned` (3, 3) the axes are others, to which it takes those of the
        beginning.
        """
        force, rate, duration = self.pieces(begin, end)
        integral, turned = np.zeros(3), np.eye(3) if turned is None else turned
        unbiased = rate if bias is None else rate - bias
        halves = Rotation.from_rotvec(unbiased * duration[:, None] / 2.0).as_matrix()
        for half, change in zip(halves, force * duration[:, None], strict=True):
            middle = turned @ half
            integral = integral + middle @ change
            turned = middle @ half
        return integral, turned

    def mean_rates(self, times: FloatArray, half: float = 0.025) -> FloatArray:
        """Return the mean angular rates (m, 3) around some times; vibration is averaged."""
        steps = (self.rate[1:] + self.rate[:-1]) / 2.0 * np.diff(self.time)[:, None]
        turned = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
        begin, end = np.maximum(times - half, self.time[0]), np.minimum(times + half, self.time[-1])
        angle = [np.interp(end, self.time, column) - np.interp(begin, self.time, column) for column in turned.T]
        return np.asarray(np.column_stack(angle) / (end - begin)[:, None])


class Fixes(Struct, frozen=True):
    """m positions of the antenna in a local frame: x east, y north, z up at its origin.

    Parameters
    ----------
    time : array (m,)
    place : array (m, 3)
        Metres.
    covariance : array (m, 3, 3)
    velocity : array (m, 3)
        m/s; NaN where it is not known.
    velocity_deviation : array (m, 3)
    """

    time: FloatArray
    place: FloatArray
    covariance: FloatArray
    velocity: FloatArray
    velocity_deviation: FloatArray


class ImuNoise(Struct, frozen=True):
    """Of a unit: noise, and random walk of the biases.

    Parameters
    ----------
    gyro : float
        rad/s/√Hz.
    accelerometer : float
        m/s²/√Hz.
    gyro_walk : float
        rad/s/√s.
    accelerometer_walk : float
        m/s²/√s.
    gyro_bias, accelerometer_bias : float
        Standard deviations of the biases at the beginning, rad/s and m/s².
    """

    gyro: float
    accelerometer: float
    gyro_walk: float
    accelerometer_walk: float
    gyro_bias: float
    accelerometer_bias: float


class LocalGravity(Struct, frozen=True):
    """Gravity and the rotation of the Earth in a local frame.

    Parameters
    ----------
    latitude, height : float
        Of the origin: radians, metres.
    """

    latitude: float
    height: float

    @property
    def earth_rate(self) -> FloatArray:
        """Return the rotation of the Earth along the axes of the frame, array (3,), rad/s."""
        return EARTH_RATE * np.array([0.0, np.cos(self.latitude), np.sin(self.latitude)])

    def at(self, place: FloatArray) -> FloatArray:
        """Return gravity at a place (3,) of the frame, array (3,), m/s²: its size (Somigliana) and its direction.

        The vertical turns by the angle that the place is away from the origin, seen from the centre of the Earth.
        """
        size = normal_gravity(self.latitude, self.height + float(place[2]))
        down = np.array([-place[0] / EARTH_RADIUS, -place[1] / EARTH_RADIUS, -1.0])
        return np.asarray(size * down / np.linalg.norm(down))


class Observed(Struct, frozen=True):
    """All that a trajectory is computed from.

    Parameters
    ----------
    imu : ImuSamples
    fixes : Fixes
    gravity : LocalGravity
    noise : ImuNoise
    lever_arm : array (3,)
        From the unit to the antenna along the axes of the body, m.
    """

    imu: ImuSamples
    fixes: Fixes
    gravity: LocalGravity
    noise: ImuNoise
    lever_arm: FloatArray


EARTH_RADIUS = 6.371e6


def normal_gravity(latitude: float, height: float) -> float:
    """Return normal gravity, m/s² (GRS 80: Moritz 2000, J. Geodesy 74; free air to the second order in the height)."""
    sine = np.sin(latitude) ** 2
    at_ellipsoid = 9.7803267715 * (1.0 + 0.001931851353 * sine) / np.sqrt(1.0 - 0.0066943800229 * sine)
    flattening, ratio, major = 1 / 298.257222101, 0.00344978600308, 6_378_137.0
    first = 2.0 / major * (1.0 + flattening + ratio - 2.0 * flattening * sine) * height
    return float(at_ellipsoid * (1.0 - first + 3.0 * (height / major) ** 2))
