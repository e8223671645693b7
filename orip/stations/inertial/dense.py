"""A trajectory at even times, in geographic coordinates: what is written, and its standard deviations."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation, Slerp

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.geometry.ground_ellipsoid import geographic_from_geocentric, place_axes
from orip.stations.inertial.files import sbet_bytes, smrmsg_bytes
from orip.stations.inertial.filter import KNOWN_ATTITUDE, Filtered, States
from orip.stations.inertial.samples import ImuSamples
from orip.stations.inertial.solution import Trajectory
from orip.stations.interpolation import WGS84


class LocalFrame(Struct, frozen=True):
    """A frame with x east, y north, z up at its origin, arrays (3,) and (3, 3), geocentric."""

    origin: FloatArray
    axes: FloatArray


_SAME = 1e-6


class Comparison(Struct, frozen=True):
    """Filter less smoother, m and radians (RMS); these over what the deviations of both say; the smoother's deviations.

    What is filtered has the observations of the smoother until then: the variance of their difference is the difference
    of their variances.
    """

    place: float
    attitude: float
    place_ratio: float
    attitude_ratio: float
    smoothed_place: float
    smoothed_attitude: float


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(values**2, axis=1)))) if len(values) else 0.0


def _ratio(values: FloatArray, covariance: FloatArray) -> float:
    variance = float(np.trace(covariance, axis1=1, axis2=2).sum())
    return float(np.sqrt(np.sum(values**2) / variance)) if variance > 0.0 else 0.0


def _middle(covariance: FloatArray) -> float:
    return float(np.sqrt(np.median(np.trace(covariance, axis1=1, axis2=2))))


class ImuResult(Struct, frozen=True):
    """A trajectory at even times: seconds since 1980-01-06, longitude, latitude (radians), height; angles in radians.

    `trajectory` is the smoothed one, `filtered` that of the filter alone: what is at even times is of one of them.
    `tested` (m,) are the squares of the innovations in their deviations.
    Deviations (n, 3) are of places and velocities along east, north, up, and of roll, pitch, heading. `axes` (3, 3)
    are those of the local frame, geocentric.
    """

    trajectory: Trajectory
    filtered: Filtered
    tested: FloatArray
    is_forward: bool
    time_system: str
    time: FloatArray
    geographic: FloatArray
    velocity: FloatArray
    angles: FloatArray
    place_deviation: FloatArray
    velocity_deviation: FloatArray
    angle_deviation: FloatArray
    body: FloatArray
    axes: FloatArray
    warnings: tuple[ProjectWarning, ...]

    @property
    def sbet(self) -> bytes:
        """Return it as an SBET."""
        return sbet_bytes(self.time, self.geographic, self.velocity, self.angles, self.body)

    def against_smoother(self) -> Comparison:
        """Return how the filter differs from the smoother, where the attitude was known."""
        filtered, smoothed = self.filtered.states, self.trajectory
        at = np.searchsorted(smoothed.time, filtered.time - _SAME)
        known = np.isin(filtered.time, smoothed.time) & (at < len(smoothed.time))
        known &= np.trace(filtered.attitude_covariance, axis1=1, axis2=2) < KNOWN_ATTITUDE**2
        rows, at = np.flatnonzero(known), at[known]
        place = filtered.place[rows] - smoothed.place[at]
        turned = np.swapaxes(smoothed.rotation[at], 1, 2) @ filtered.rotation[rows]
        attitude = Rotation.from_matrix(turned).as_rotvec()
        return Comparison(
            _rms(place), _rms(attitude),
            _ratio(place, filtered.place_covariance[rows] - smoothed.place_covariance[at]),
            _ratio(attitude, filtered.attitude_covariance[rows] - smoothed.attitude_covariance[at]),
            _middle(smoothed.place_covariance), _middle(smoothed.attitude_covariance),
        )  # fmt: skip

    @property
    def smrmsg(self) -> bytes:
        """Return its standard deviations."""
        return smrmsg_bytes(self.time, self.place_deviation, self.velocity_deviation, self.angle_deviation)


class Dense:
    """The trajectory at even times: between states by the samples, with the closing error distributed evenly."""

    def __init__(self, states: States, imu: ImuSamples, step: float) -> None:
        self._states, self._imu = states, imu
        first = np.ceil(states.time[0] / step) * step
        self.time = np.arange(first, states.time[-1], step)

    def _rotations(self) -> FloatArray:
        """Return attitudes: those of the gyroscopes between states, turned evenly to meet the next state."""
        states, imu = self._states, self._imu
        within = (imu.time > states.time[0]) & (imu.time < states.time[-1])
        times = np.unique(np.concatenate([states.time, imu.time[within]]))
        rate = np.column_stack([np.interp(times, imu.time, column) for column in imu.rate.T])
        bias = np.column_stack([np.interp(times, states.time, column) for column in states.gyro_bias.T])
        middle = (rate[1:] + rate[:-1] - bias[1:] - bias[:-1]) / 2.0
        steps = Rotation.from_rotvec(middle * np.diff(times)[:, None]).as_matrix()
        at_state = np.searchsorted(times, states.time)
        counts = np.diff(at_state)
        turned, ends = np.empty((len(times), 3, 3)), np.empty((len(counts), 3, 3))
        turned[at_state] = states.rotation
        for step in range(1, int(counts.max()) + 1):  # the same step of all intervals at once: there are millions
            rows = at_state[:-1] + step
            is_last, goes_on = counts == step, counts > step
            ends[is_last] = turned[rows[is_last] - 1] @ steps[rows[is_last] - 1]
            turned[rows[goes_on]] = turned[rows[goes_on] - 1] @ steps[rows[goes_on] - 1]
        closing = Rotation.from_matrix(np.swapaxes(ends, 1, 2) @ states.rotation[1:]).as_rotvec()
        interval = np.minimum(np.searchsorted(at_state, np.arange(len(times)), side="right") - 1, len(counts) - 1)
        part = (times - states.time[interval]) / np.diff(states.time)[interval]
        part[-1] = 0.0  # the last state itself
        found = turned @ Rotation.from_rotvec(part[:, None] * closing[interval]).as_matrix()
        return np.asarray(Slerp(times, Rotation.from_matrix(found))(self.time).as_matrix())

    def _between(self, values: FloatArray) -> FloatArray:
        flat = values.reshape(len(values), -1)
        columns = [np.interp(self.time, self._states.time, column) for column in flat.T]
        return np.column_stack(columns).reshape(len(self.time), *values.shape[1:])

    def _motion(self) -> tuple[FloatArray, FloatArray]:
        """Return places and velocities: cubic between states with their velocities."""
        from scipy.interpolate import CubicHermiteSpline

        states = self._states
        path = CubicHermiteSpline(states.time, states.place, states.velocity)
        return path(self.time), path(self.time, 1)

    def result(
        self,
        found: tuple[Trajectory, Filtered, FloatArray],
        frame: LocalFrame,
        system: str,
        warnings: tuple[ProjectWarning, ...],
    ) -> ImuResult:
        """Return it in geographic coordinates, with both trajectories and the squares of the innovations."""
        states, imu, origin, axes = self._states, self._imu, frame.origin, frame.axes
        local, velocity = self._motion()
        geographic = geographic_from_geocentric(origin + local @ axes, WGS84)
        to_place = place_axes(geographic) @ axes.T
        rotation = self._rotations()
        angles = _navigation_angles(to_place @ rotation)
        attitude = self._between(states.attitude_covariance)
        body = np.column_stack([
            np.interp(self.time, imu.time, column) for column in (*imu.force.T, *imu.rate.T)
        ])  # fmt: skip
        return ImuResult(
            *found,
            self._states is not found[0],
            system,
            self.time,
            geographic,
            np.einsum("nij,nj->ni", to_place, velocity),
            angles,
            _roots(to_place @ self._between(states.place_covariance) @ np.swapaxes(to_place, 1, 2)),
            _roots(self._between(states.velocity_covariance)),
            _roots(_to_angles(angles, attitude)),
            body,
            axes,
            warnings,
        )


_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def _navigation_angles(rotation: FloatArray) -> FloatArray:
    """Return roll, pitch and heading (n, 3) of rotations from the body to east, north, up."""
    return np.asarray(Rotation.from_matrix(_NED @ rotation).as_euler("ZYX")[:, ::-1])


def _to_angles(angles: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return covariances (n, 3, 3) of roll, pitch, heading of those of small rotations about the axes of the body."""
    roll, pitch = angles[:, 0], angles[:, 1]
    sine, cosine, tangent, secant = np.sin(roll), np.cos(roll), np.tan(pitch), 1.0 / np.cos(pitch)
    zero, one = np.zeros(len(roll)), np.ones(len(roll))
    rows = [[one, sine * tangent, cosine * tangent], [zero, cosine, -sine], [zero, sine * secant, cosine * secant]]
    partial = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(partial @ covariance @ np.swapaxes(partial, 1, 2))


def _roots(covariance: FloatArray) -> FloatArray:
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
