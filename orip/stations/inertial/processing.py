"""From the files of an inertial unit and a receiver to a smoothed trajectory in geographic coordinates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint, InputError
from orip.geometry.ground_ellipsoid import geocentric_from_geographic, place_axes
from orip.records.epochs import SECONDS_PER_WEEK, Epochs
from orip.stations.inertial.dense import Dense, ImuResult, LocalFrame
from orip.stations.inertial.files import TIME_SYSTEMS, ImuForm, read_imu
from orip.stations.inertial.findings import Named, findings, fix_statistics, mistaken
from orip.stations.inertial.samples import Fixes, ImuNoise, ImuSamples, LocalGravity, Observed
from orip.stations.inertial.smoother import filter_as, smooth
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


class ImuFiles(Struct, frozen=True):
    """What is read, and how; `time` is one of `TIME_SYSTEMS`, ``week``, or empty: what fits.

    The trajectory has states at `events`, such as exposures. `forward`: what is written is that of the filter alone.
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
    forward: bool = False


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
    if not complaints and not len(positions_read.value):
        complaints.append(Complaint("there are no positions in this file", files.positions.name))
    if not complaints and not positions_read.value.is_geographic:
        text = "positions count from the base; let RTKLIB write latitude, longitude and height, or geocentric X, Y, Z"
        complaints.append(Complaint(text, files.positions.name))
    if complaints:
        raise InputError(complaints)
    positions = positions_read.value
    imu, system = _in_gps_time(imu_read.value, positions, files)
    fixes, frame, gravity = local_fixes(_overlapping(positions, imu, files))
    observed = Observed(imu, fixes, gravity, files.noise, np.array(files.lever_arm))
    try:
        solved = smooth(observed, event_times(files.events, fixes.time), estimates_noise=files.estimates_noise)
        filtered = filter_as(solved)
    except RuntimeError:  # of GTSAM, for a graph without a solution
        cause = mistaken(observed) or (
            "the units of the columns (--rate-unit deg/s), the axes (--mount), the times (--time, --shift) or the "
            "lever arm are probably wrong"
        )
        message = f"no trajectory fits both samples and positions; {cause}"
        raise InputError([Complaint(message, files.imu.name)]) from None
    warnings = tuple(findings(solved, filtered, Named(files.imu.name, files.positions.name, files.form.shift)))
    states = filtered.states if files.forward else solved.trajectory
    found = (solved.trajectory, filtered, fix_statistics(solved, filtered))
    return Dense(states, imu, 1.0 / files.rate).result(found, frame, system, warnings)


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
    # later than all before it: a time that jumps ahead is not followed by earlier ones
    latest = np.maximum.accumulate(np.where(within, positions.time, -np.inf))
    within &= np.concatenate([[True], positions.time[1:] > latest[:-1]])
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


def local_fixes(positions: Epochs) -> tuple[Fixes, LocalFrame, LocalGravity]:
    """Return fixes, of geographic positions, in a local frame at the first of them, the frame, and its gravity."""
    place, covariance = positions.place, positions.covariance
    geocentric = geocentric_from_geographic(place, WGS84)
    axes = place_axes(place[:1])[0]
    usual = np.array([np.diag(np.square(_USUAL[quality])) for quality in positions.quality])
    covariance = np.where(np.isfinite(covariance), covariance, usual)
    deviation = np.where(np.isfinite(positions.velocity), _USUAL_VELOCITY, np.nan)
    local = (geocentric - geocentric[0]) @ axes.T
    fixes = Fixes(positions.time, local, covariance, positions.velocity, deviation)
    return fixes, LocalFrame(geocentric[0], axes), LocalGravity(float(place[0, 1]), float(place[0, 2]))
