"""From the files of an inertial unit and a receiver to a smoothed trajectory in geographic coordinates."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation, Slerp

from orip.arrays import FloatArray
from orip.errors import Complaint, InputError, ProjectWarning
from orip.geometry.ground_ellipsoid import geocentric_from_geographic, geographic_from_geocentric, place_axes
from orip.records.epochs import SECONDS_PER_WEEK, Epochs
from orip.stations.inertial.files import TIME_SYSTEMS, ImuForm, read_imu, sbet_bytes, smrmsg_bytes
from orip.stations.inertial.samples import Fixes, ImuNoise, ImuSamples, LocalGravity
from orip.stations.inertial.smoother import Trajectory, smooth
from orip.stations.interpolation import WGS84
from orip.stations.receiver_files import read_rtklib_pos
from orip.structs import replace

NOISES = {
    "mems": ImuNoise(np.radians(0.004), 6e-4, np.radians(1e-4), 1e-4, np.radians(0.5), 0.1),
    "tactical": ImuNoise(np.radians(0.0017), 2e-4, np.radians(2e-6), 1e-6, np.radians(0.0005), 0.005),
    "navigation": ImuNoise(np.radians(3e-5), 5e-5, np.radians(1e-8), 1e-7, np.radians(3e-6), 3e-4),
}
"""Usual noise of units by their grade; what the observations ask for is estimated."""

_SHORTEST = 20.0
"""Seconds of both that are needed."""

_LARGEST_FACTOR = 100.0
_LEAST_CHANGE = 1.0
"""m/s of horizontal velocity changes without which no course is found."""


class ImuFiles(Struct, frozen=True):
    """What is read, and how; `time` is one of `TIME_SYSTEMS`, ``week``, or empty: what fits.

    The trajectory has states at `events`, such as exposures.
    """

    imu: Path
    positions: Path
    form: ImuForm
    noise: ImuNoise
    lever_arm: tuple[float, float, float]
    time: str = ""
    rate: float = 50.0
    estimates_noise: bool = True
    events: Epochs | None = None


class ImuResult(Struct, frozen=True):
    """A trajectory at even times: seconds since 1980-01-06, longitude, latitude (radians), height; angles in radians.

    Deviations (n, 3) of places and velocities along east, north, up, and of roll, pitch, heading. `axes` (3, 3) are
    those of the local frame, geocentric.
    """

    trajectory: Trajectory
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

    @property
    def smrmsg(self) -> bytes:
        """Return its standard deviations."""
        return smrmsg_bytes(self.time, self.place_deviation, self.velocity_deviation, self.angle_deviation)


def process_imu(files: ImuFiles) -> ImuResult:
    """Smooth a trajectory.

    Raises
    ------
    InputError
        With everything that is wrong with the files.
    OripError
        If GTSAM is not there.
    """
    imu_read = read_imu(files.imu, files.imu.name, files.form)
    positions_read = read_rtklib_pos(files.positions, files.positions.name)
    complaints = [*imu_read.complaints, *positions_read.complaints]
    if complaints:
        raise InputError(complaints)
    positions = positions_read.value
    imu, system = _in_gps_time(imu_read.value, positions, files)
    fixes, origin, axes, geographic = _local(_overlapping(positions, imu, files))
    gravity = LocalGravity(float(geographic[1]), float(geographic[2]))
    try:
        trajectory = smooth(
            imu, fixes, gravity, files.noise, np.array(files.lever_arm), event_times(files.events, fixes.time),
            estimates_noise=files.estimates_noise,
        )  # fmt: skip
    except RuntimeError:  # of GTSAM, for a graph without a solution
        message = (
            "no trajectory fits both samples and positions; the units of the columns (--rate-unit deg/s), the axes "
            "(--mount), the times (--time, --shift) or the lever arm are probably wrong"
        )
        raise InputError([Complaint(message, files.imu.name)]) from None
    warnings = [*_warnings(trajectory, files), *_late(time_offset(imu, fixes, gravity, files, trajectory), files)]
    return _Dense(trajectory, imu, 1.0 / files.rate).result(origin, axes, system, tuple(warnings))


def event_times(events: Epochs | None, time: FloatArray) -> FloatArray:
    """Return the times of events, ascending, in seconds since 1980; seconds of the week are of that of some times."""
    if events is None:
        return np.zeros(0)
    found = np.unique(events.time[np.isfinite(events.time)])
    return found if events.has_week else found + np.floor(time[0] / SECONDS_PER_WEEK) * SECONDS_PER_WEEK


def _in_gps_time(imu: ImuSamples, positions: Epochs, files: ImuFiles) -> tuple[ImuSamples, str]:
    """Return the samples in seconds since 1980, and the system of their times: the one said, or the one that fits."""
    begin, end = positions.time[0], positions.time[-1]
    week = float(np.floor(begin / SECONDS_PER_WEEK) * SECONDS_PER_WEEK)
    shifts = {"gps": TIME_SYSTEMS["gps"], "unix-gps": TIME_SYSTEMS["unix-gps"], "week": week}
    shifts["unix-utc"] = TIME_SYSTEMS["unix-utc"]
    wanted = [files.time] if files.time else list(shifts)
    overlap = {name: min(end, imu.time[-1] + shifts[name]) - max(begin, imu.time[0] + shifts[name]) for name in wanted}
    best = max(wanted, key=lambda name: overlap[name])
    if overlap[best] < _SHORTEST:
        message = (
            f"samples and positions have {max(overlap[best], 0.0):.0f} s in common, {_SHORTEST:.0f} are needed: the "
            f"samples run from {imu.time[0]:.1f} to {imu.time[-1]:.1f}, the positions from {begin:.1f} to {end:.1f} s "
            f"since 1980-01-06 (second {begin % SECONDS_PER_WEEK:.1f} of the week); is the time system right "
            "(--time gps, week, unix-gps, unix-utc), and are the files of one flight?"
        )
        raise InputError([Complaint(message, files.imu.name)])
    return replace(imu, time=imu.time + shifts[best]), best


def _overlapping(positions: Epochs, imu: ImuSamples, files: ImuFiles) -> Epochs:
    within = (positions.time > imu.time[0]) & (positions.time < imu.time[-1])
    within &= np.isfinite(positions.place).all(axis=1)
    within &= np.concatenate([[True], np.diff(positions.time) > 0.0])
    rows = np.flatnonzero(within)
    if len(rows) < 10:
        message = f"there are {len(rows)} positions within the time of the samples; at least 10 are needed"
        raise InputError([Complaint(message, files.positions.name)])
    return replace(
        positions,
        time=positions.time[rows],
        place=positions.place[rows],
        covariance=positions.covariance[rows],
        velocity=positions.velocity[rows],
        quality=tuple(positions.quality[row] for row in rows),
        line=positions.line[rows],
    )


_USUAL = {"fixed": (0.02, 0.02, 0.04), "float": (0.3, 0.3, 0.6), "code": (3.0, 3.0, 6.0), "": (0.05, 0.05, 0.1)}
"""Standard deviations east, north, up where a file has none, m."""

_USUAL_VELOCITY = 0.1


def _local(positions: Epochs) -> tuple[Fixes, FloatArray, FloatArray, FloatArray]:
    """Return fixes in a local frame at the first of them, its origin (geocentric), its axes, and where it is."""
    place = positions.place
    if not positions.is_geographic:
        place = geographic_from_geocentric(place, WGS84)
    geocentric = geocentric_from_geographic(place, WGS84)
    axes = place_axes(place[:1])[0]
    covariance = positions.covariance
    if not positions.is_geographic:
        covariance = axes @ covariance @ axes.T
    usual = np.array([np.diag(np.square(_USUAL[quality])) for quality in positions.quality])
    covariance = np.where(np.isfinite(covariance), covariance, usual)
    deviation = np.where(np.isfinite(positions.velocity), _USUAL_VELOCITY, np.nan)
    local = (geocentric - geocentric[0]) @ axes.T
    return Fixes(positions.time, local, covariance, positions.velocity, deviation), geocentric[0], axes, place[0]


class _Dense:
    """The trajectory at even times: between states by the samples, with the closing error distributed evenly."""

    def __init__(self, trajectory: Trajectory, imu: ImuSamples, step: float) -> None:
        self._trajectory, self._imu = trajectory, imu
        first = np.ceil(trajectory.time[0] / step) * step
        self.time = np.arange(first, trajectory.time[-1], step)

    def _rotations(self) -> FloatArray:
        """Return attitudes: those of the gyroscopes between states, turned evenly to meet the next state."""
        states, imu = self._trajectory, self._imu
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
        columns = [np.interp(self.time, self._trajectory.time, column) for column in flat.T]
        return np.column_stack(columns).reshape(len(self.time), *values.shape[1:])

    def _motion(self) -> tuple[FloatArray, FloatArray]:
        """Return places and velocities: cubic between states with their velocities."""
        from scipy.interpolate import CubicHermiteSpline

        states = self._trajectory
        path = CubicHermiteSpline(states.time, states.place, states.velocity)
        return path(self.time), path(self.time, 1)

    def result(
        self, origin: FloatArray, axes: FloatArray, system: str, warnings: tuple[ProjectWarning, ...]
    ) -> ImuResult:
        states, imu = self._trajectory, self._imu
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
            states,
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


class TimeOffset(Struct, frozen=True):
    """By which the samples are to be later to fit the positions, and its standard deviation, s."""

    value: float
    deviation: float


def time_offset(
    imu: ImuSamples, fixes: Fixes, gravity: LocalGravity, files: ImuFiles, trajectory: Trajectory
) -> TimeOffset:
    """Return the time offset that makes vPv least: of a parabola through three values of it, for a part of the flight.

    Parameters
    ----------
    imu : ImuSamples
    fixes : Fixes
    gravity : LocalGravity
    files : ImuFiles
    trajectory : Trajectory
        With the factors of the standard deviations.
    """
    factors, noise = trajectory.factors, files.noise
    names = ("gyro", "accelerometer", "gyro_walk", "accelerometer_walk")
    noise = replace(noise, **{name: getattr(noise, name) * factors.unit for name in names})
    inner = (fixes.time > imu.time[0] + _TRIED_SHIFT) & (fixes.time < imu.time[-1] - _TRIED_SHIFT)
    rows = np.flatnonzero(inner & (fixes.time < fixes.time[0] + _PART_OF_FLIGHT))
    part = Fixes(
        fixes.time[rows], fixes.place[rows], fixes.covariance[rows] * factors.position**2, fixes.velocity[rows],
        fixes.velocity_deviation[rows] * factors.velocity,
    )  # fmt: skip
    early, given, late = (
        smooth(
            replace(imu, time=imu.time + shift), part, gravity, noise, np.array(files.lever_arm), estimates_noise=False
        ).square_sum
        for shift in (-_TRIED_SHIFT, 0.0, _TRIED_SHIFT)
    )
    curvature = early + late - 2.0 * given
    if curvature <= 0.0:
        return TimeOffset(0.0, np.inf)
    return TimeOffset(_TRIED_SHIFT * (early - late) / (2.0 * curvature), _TRIED_SHIFT * np.sqrt(2.0 / curvature))


_TRIED_SHIFT = 0.02
_PART_OF_FLIGHT = 150.0
_LEAST_OFFSET, _SIGNIFICANT = 0.003, 4.0


def _late(offset: TimeOffset, files: ImuFiles) -> Iterator[ProjectWarning]:
    if abs(offset.value) > max(_LEAST_OFFSET, _SIGNIFICANT * offset.deviation):
        text = (
            f"the samples fit the positions best {offset.value:+.4f} ± {offset.deviation:.4f} s later: a time offset; "
            f"add --shift {files.form.shift + offset.value:.4f}"
        )
        yield ProjectWarning("time-offset", files.imu.name, text)


def _warnings(trajectory: Trajectory, files: ImuFiles) -> Iterator[ProjectWarning]:
    factors, alignment = trajectory.factors, trajectory.alignment
    if alignment.change < _LEAST_CHANGE:
        text = (
            f"velocity changes by {alignment.change:.1f} m/s only: the course follows from movement, and is not known "
            "without; look at its standard deviation"
        )
        yield ProjectWarning("no-course", files.positions.name, text)
    if factors.unit > _LARGEST_FACTOR:
        text = (
            f"the unit is {factors.unit:.0f} times less precise than --noise says: its axes (--mount), the units of "
            "its columns, its time (--shift) or the lever arm are probably wrong"
        )
        yield ProjectWarning("unit-contradicts", files.imu.name, text)
