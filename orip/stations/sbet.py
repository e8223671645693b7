"""Smoothed trajectories of GNSS and INS (SBET, Applanix) with their standard deviations (SMRMSG).

SBET: records of 17 little-endian float64: seconds of the GPS week, latitude, longitude (radians), height above the
ellipsoid (m), velocity along x, y, z (m/s), roll, pitch, platform heading, wander angle (radians), acceleration, rates.
The axes of the velocity are level: x is turned from north by the wander angle, counterclockwise, y is to its left, z
up; hence true heading = platform heading - wander angle.

SMRMSG: records of 10: seconds, deviations north, east, down (m), of the velocity, of roll, pitch, heading (minutes of
arc).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.files.text.lines import read_bytes
from orip.files.text.shown import Parsed
from orip.records.observations.epochs import Epochs, epochs
from orip.stations.rows import LARGEST_PLACE, MOST_COMPLAINTS
from orip.units import RADIANS_PER_DEGREE

_FIELDS, _DEVIATION_FIELDS = 17, 10
_TIME, _LATITUDE, _LONGITUDE, _HEIGHT, _VELOCITY, _ROLL, _HEADING, _WANDER = 0, 1, 2, 3, 4, 7, 9, 10

_FASTEST = 1000.0
"""m/s; what is faster is no velocity of an aeroplane."""


def read_sbet(path: Path, shown: str, deviations: Path | None = None, shown_deviations: str = "") -> Parsed[Epochs]:
    """Read a trajectory, and its standard deviations from the file beside it if there is one."""
    records, complaints = _records(path, shown, _FIELDS, "SBET")
    complaints += _impossible(records, shown)
    errors, angle_errors = np.full((len(records), 3), np.nan), np.full((len(records), 3), np.nan)
    if deviations is not None and not complaints:
        errors, angle_errors, more = _deviations(deviations, shown_deviations, records[:, _TIME])
        complaints += more
    covariance = np.full((len(records), 3, 3), np.nan)
    if deviations is not None:
        covariance = errors[:, :, None] * np.eye(3) * errors[:, None, :]
    angles = records[:, _ROLL : _HEADING + 1].copy()
    angles[:, 2] -= records[:, _WANDER]
    return Parsed(
        epochs(
            shown,
            np.arange(1, len(records) + 1),
            time=records[:, _TIME],
            has_week=False,
            place=records[:, [_LONGITUDE, _LATITUDE, _HEIGHT]],
            covariance=covariance,
            velocity=_along_east_north_up(records[:, _VELOCITY:_ROLL], records[:, _WANDER]),
            angles=angles,
            angle_error=angle_errors,
        ),
        tuple(complaints),
    )


def _along_east_north_up(velocity: FloatArray, wander: FloatArray) -> FloatArray:
    """Return velocities (n, 3) in wander axes along east, north and up."""
    (x, y, up), cosine, sine = velocity.T, np.cos(wander), np.sin(wander)
    return np.column_stack([-x * sine - y * cosine, x * cosine - y * sine, up])


def _records(path: Path, shown: str, fields: int, what: str) -> tuple[FloatArray, list[Complaint]]:
    data, complaints = read_bytes(path, shown)
    data = data or b""
    size = 8 * fields
    faults = list(complaints)
    if not faults and (len(data) % size or not data):
        message = (
            f"the file has {len(data)} bytes, but {what} has records of {size} bytes; it is cut off, or of another kind"
        )
        faults.append(Complaint(message, shown))
    whole = 0 if faults else len(data) // size
    return np.frombuffer(data, "<f8", whole * fields).reshape(whole, fields).astype(np.float64), faults


def _impossible(records: FloatArray, shown: str) -> list[Complaint]:
    limits = np.full(_FIELDS, np.inf)
    limits[[_LATITUDE, _LONGITUDE, _HEIGHT]] = 0.5 * np.pi, 2.0 * np.pi, LARGEST_PLACE
    limits[_VELOCITY:_ROLL] = _FASTEST
    limits[_ROLL : _WANDER + 1] = 4.0 * np.pi
    with np.errstate(invalid="ignore"):
        fit = (np.isfinite(records) & (np.abs(records) <= limits)).all(axis=1)
    return [
        Complaint(
            "this record has numbers that cannot be a place, velocity and attitude; the file is damaged, or not "
            "an SBET of little-endian numbers",
            shown,
            int(row) + 1,
        )
        for row in np.flatnonzero(~fit)[:MOST_COMPLAINTS]
    ]


def _deviations(path: Path, shown: str, time: FloatArray) -> tuple[FloatArray, FloatArray, list[Complaint]]:
    """Return deviations east, north, up (m) and of roll, pitch, heading (radians) at times."""
    records, complaints = _records(path, shown, _DEVIATION_FIELDS, "SMRMSG")
    nothing = np.full((len(time), 3), np.nan)
    with np.errstate(invalid="ignore"):
        fit = (np.isfinite(records) & (records >= 0.0)).all(axis=1)
    complaints += [
        Complaint("this record has numbers that cannot be standard deviations", shown, int(row) + 1)
        for row in np.flatnonzero(~fit)[:MOST_COMPLAINTS]
    ]
    if complaints:
        return nothing, nothing, complaints
    if (np.diff(records[:, 0]) <= 0.0).any():
        row = int(np.flatnonzero(np.diff(records[:, 0]) <= 0.0)[0]) + 2
        return nothing, nothing, [Complaint("this record is not later than the one before it", shown, row)]
    if records[0, 0] > time[-1] or records[-1, 0] < time[0]:
        message = f"the deviations are of {records[0, 0]:.1f} to {records[-1, 0]:.1f} s, the trajectory of other times"
        return nothing, nothing, [Complaint(message, shown)]
    at_times = np.column_stack([np.interp(time, records[:, 0], column) for column in records.T])
    return at_times[:, [2, 1, 3]], at_times[:, 7:10] * RADIANS_PER_DEGREE / 60.0, []
