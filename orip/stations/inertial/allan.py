"""Noise of an inertial unit from a record in which it stands: Allan variance (IEEE Std 952-1997, annex C).

Of averages over times τ the Allan variance is half the mean square of the difference of neighbours. Angle or velocity
random walk N, bias instability B and random walk K of the bias, of double-sided power densities N², B²/(2πf) and
K²/(2πf)², have

    σ²(τ) = N²/τ + (2 ln 2/π) B² + K² τ/3        and beside them 3 Q²/τ² of quantisation, R² τ²/2 of a ramp
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.optimize import nnls

from orip.arrays import FloatArray, IntArray
from orip.stations.inertial.samples import ImuNoise, ImuSamples, normal_gravity

FLICKER = 2.0 * np.log(2.0) / np.pi
"""Allan variance of a bias instability of 1, about 0.664²."""

_PER_DECADE = 8
_LONGEST_PART = 1.0 / 5.0
"""Of the record, in averages: longer ones have hardly a difference that is independent of others."""

_LEAST_DURATION = 120.0
_BLOCK = 1.0
_MOVED_RATE, _MOVED_FORCE = np.radians(0.5), 0.1
"""rad/s and m/s² of averages over a second, from their median."""

_SMOOTHED = 16
"""Samples below which averages of samples at uneven times are smoothed by taking them to even ones."""

_ROUNDS = 5
_LEAST = 1e-12
"""rad/s or m/s² and their densities, in place of a noise of which nothing is seen."""


class AxisNoise(Struct, frozen=True):
    """Of a sensor.

    Parameters
    ----------
    random_walk : float
        N: rad/s/√Hz, or m/s²/√Hz.
    instability : float
        B: rad/s, or m/s².
    bias_walk : float
        K: rad/s/√s, or m/s²/√s; 0: none is seen in a record of this length.
    tau, deviation : arrays (k,)
        Averaging times, s, and Allan deviations.
    """

    random_walk: float
    instability: float
    bias_walk: float
    tau: FloatArray
    deviation: FloatArray

    @property
    def flattest(self) -> float:
        """Return the averaging time with the least Allan deviation, s."""
        return float(self.tau[int(np.argmin(self.deviation))])


class StandingNoise(Struct, frozen=True):
    """Of a unit: gyroscopes and accelerometers along the three axes; `duration` of the record, s.

    `gyro_mean`, `force_mean` (3,) are means, rad/s and m/s².
    """

    duration: float
    gyro: tuple[AxisNoise, ...]
    accelerometer: tuple[AxisNoise, ...]
    gyro_mean: FloatArray
    force_mean: FloatArray

    def settings(self, latitude: float = np.radians(45.0)) -> ImuNoise:
        """Return the noise for a smoother: root mean squares over the axes.

        A bias instability is no random walk; for the smoother it is the one that changes a bias by B within the time
        of the least Allan deviation. First biases are by what the mean rate is more than that of the Earth, and the
        mean force other than gravity, and not less than the instability.
        """
        parts = [
            tuple(_rms([value(one) for one in axes]) for value in (_white, _walk, _flat))
            for axes in (self.gyro, self.accelerometer)
        ]
        (gyro, gyro_walk, gyro_least), (force, force_walk, force_least) = parts
        rate = max(float(np.linalg.norm(self.gyro_mean)) - 7.292e-5, 0.0)
        off = abs(float(np.linalg.norm(self.force_mean)) - normal_gravity(latitude, 0.0))
        values = (gyro, force, gyro_walk, force_walk, max(rate, gyro_least), max(off, force_least))
        return ImuNoise(*(max(value, _LEAST) for value in values))


def _white(axis: AxisNoise) -> float:
    return axis.random_walk


def _flat(axis: AxisNoise) -> float:
    return axis.instability


def _walk(axis: AxisNoise) -> float:
    return float(max(axis.bias_walk, axis.instability / np.sqrt(axis.flattest)))


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def moved_at(imu: ImuSamples) -> float | None:
    """Return the first time at which the unit does not stand, s after the beginning; None: it does."""
    edges = np.searchsorted(imu.time, np.arange(imu.time[0], imu.time[-1], _BLOCK))
    for values, limit in ((imu.rate, _MOVED_RATE), (imu.force, _MOVED_FORCE)):
        means = np.add.reduceat(values[: edges[-1]], edges[:-1], axis=0) / np.maximum(np.diff(edges), 1)[:, None]
        away = np.abs(means - np.median(means, axis=0)).max(axis=1) > limit
        if away.any():
            return float(np.argmax(away)) * _BLOCK
    return None


def is_long_enough(imu: ImuSamples) -> bool:
    """Return whether something can be said of noise."""
    return bool(imu.time[-1] - imu.time[0] >= _LEAST_DURATION)


def standing_noise(imu: ImuSamples) -> StandingNoise:
    """Return the noise of a unit that stands all the time."""
    gyro, force = (tuple(axis_noise(imu.time, column) for column in values.T) for values in (imu.rate, imu.force))
    duration = float(imu.time[-1] - imu.time[0])
    return StandingNoise(duration, gyro, force, imu.rate.mean(axis=0), imu.force.mean(axis=0))


def axis_noise(time: FloatArray, values: FloatArray) -> AxisNoise:
    """Return the noise of samples (n,) of a sensor."""
    tau, variance, count = allan_variance(time, values)
    basis = np.column_stack([1.0 / tau, np.full_like(tau, FLICKER), tau / 3.0, 3.0 / tau**2, tau**2 / 2.0])
    model, found = variance, np.zeros(basis.shape[1])
    for _ in range(_ROUNDS):
        # an Allan variance of c independent differences is good to sqrt(2 / c) of itself
        weight = np.sqrt(count / 2.0) / model
        scale = np.linalg.norm(basis * weight[:, None], axis=0)
        found = nnls(basis * weight[:, None] / scale, variance * weight)[0] / scale
        model = basis @ found
    white, flicker, walk = np.sqrt(found[:3]).tolist()
    return AxisNoise(white, flicker, walk, tau, np.sqrt(variance))


def allan_variance(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return averaging times (k,), overlapping Allan variances (k,), and the independent differences of each (k,).

    Samples that are not even in time are integrated, and the integral taken at even times.
    """
    steps = np.diff(time)
    step = float((time[-1] - time[0]) / len(steps))
    centred = values - values.mean()
    integral = np.concatenate([[0.0], np.cumsum(centred * np.append(steps, step))])
    at = np.append(time, time[-1] + step)
    is_uneven = bool(np.abs(steps - step).max() > 0.02 * step)
    if is_uneven:
        integral = np.interp(at[0] + step * np.arange(len(at)), at, integral)
    sizes = _sizes(len(values))
    if is_uneven:
        sizes = sizes[sizes >= _SMOOTHED]
    variance = np.array([_variance(integral, size, step) for size in sizes.tolist()])
    kept = variance > 0.0
    tau, count = np.asarray(sizes[kept] * step, dtype=np.float64), np.maximum(len(values) / sizes[kept] - 1.0, 1.0)
    return tau, variance[kept], np.asarray(count, dtype=np.float64)


def _sizes(count: int) -> IntArray:
    longest = max(int(count * _LONGEST_PART), 1)
    steps = np.logspace(0.0, np.log10(longest), max(int(_PER_DECADE * np.log10(longest)), 2))
    return np.unique(np.round(steps).astype(np.int64))


def _variance(integral: FloatArray, size: int, step: float) -> float:
    second = integral[2 * size :] - 2.0 * integral[size:-size] + integral[: -2 * size]
    return float(np.mean(second**2) / (2.0 * (size * step) ** 2))
