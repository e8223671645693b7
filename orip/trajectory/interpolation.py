"""Position and attitude between the epochs of a trajectory."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.errors import Complaint
from orip.geometry.ground_ellipsoid import geocentric_from_geographic, geographic_from_geocentric, place_axes
from orip.geometry.rotation import rotation_from_navigation
from orip.records.observations.epochs import SECONDS_PER_WEEK, Epochs
from orip.trajectory.velocities import WGS84, velocities

LONGEST_GAP = 2.5
"""Epochs of a usual interval that may lie between the two on both sides of an event."""


class Interpolated(Struct, frozen=True):
    """n places on a trajectory.

    Parameters
    ----------
    place : array (n, 3)
        As `Epochs.place`; NaN outside the trajectory and in its gaps.
    covariance : array (n, 3, 3)
    before : array (n,) of int
        The epoch before; the one after it is the next.
    rotation : array (n, 3, 3)
        Photo axes to east, north, up, or X, Y, Z; NaN where there is no attitude.
    angle_error : array (n, 3)
    gap : array (n,)
        Seconds between the epochs on both sides; NaN outside the trajectory.
    """

    place: FloatArray
    covariance: FloatArray
    before: IntArray
    rotation: FloatArray
    angle_error: FloatArray
    gap: FloatArray


def time_complaints(trajectory: Epochs) -> list[Complaint]:
    """Return complaints about epochs that are not later than the ones before: the clock has jumped."""
    steps = np.diff(trajectory.time)
    return [
        Complaint(
            f"this epoch is {abs(steps[row]):.3f} s before the one above it: the clock has jumped, or two files were "
            "joined; give the parts before and after it in files of their own"
            if steps[row] < 0.0
            else "this epoch has the same time as the one above it; remove one of them",
            trajectory.shown,
            int(trajectory.line[row + 1]),
        )
        for row in np.flatnonzero(steps <= 0.0)
    ]


def interpolate(trajectory: Epochs, time: FloatArray) -> Interpolated:
    """Return places and attitudes at some times.

    Places follow cubic Hermite polynomials with the velocities of the trajectory, or with those of a parabola through
    three epochs where it has none; attitudes the shortest rotation between two epochs; covariances are interpolated
    linearly, since errors of neighbouring epochs are nearly the same.

    Parameters
    ----------
    trajectory : Epochs
        With increasing times.
    time : array (n,)
        In the trajectory's seconds.
    """
    epoch_time = trajectory.time
    before = np.clip(np.searchsorted(epoch_time, time, side="right") - 1, 0, max(len(epoch_time) - 2, 0))
    if len(epoch_time) < 2:
        return _nothing(len(time))
    length = epoch_time[before + 1] - epoch_time[before]
    inside = (time >= epoch_time[0]) & (time <= epoch_time[-1])
    is_near: BoolArray = np.asarray(length <= LONGEST_GAP * usual_interval(trajectory))
    known = inside & (is_near | _hits(epoch_time, before, time))
    part = np.where(known, (time - epoch_time[before]) / length, np.nan)
    covariance = _between(trajectory.covariance, before, part)
    return Interpolated(
        place=_places(trajectory, before, part, length),
        covariance=covariance,
        before=np.asarray(before, dtype=np.int64),
        rotation=_rotations(trajectory, before, part),
        angle_error=_between(trajectory.angle_error, before, part),
        gap=np.where(inside, length, np.nan),
    )


def usual_interval(trajectory: Epochs) -> float:
    """Return the median interval of the epochs, seconds."""
    return float(np.median(np.diff(trajectory.time)))


def in_seconds_of_week(epochs: Epochs) -> FloatArray:
    """Return times in seconds of the week."""
    return np.asarray(np.mod(epochs.time, SECONDS_PER_WEEK))


def _nothing(count: int) -> Interpolated:
    unknown, matrices = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    return Interpolated(
        unknown, matrices, np.zeros(count, dtype=np.int64), matrices, unknown, np.full(count, np.nan)
    )  # fmt: skip


def _hits(epoch_time: FloatArray, before: IntArray, time: FloatArray) -> BoolArray:
    """Return which times are epochs: a gap beside them does not matter."""
    return np.asarray(np.logical_or(epoch_time[before] == time, epoch_time[before + 1] == time), dtype=np.bool_)


def _between(values: FloatArray, before: IntArray, part: FloatArray) -> FloatArray:
    weight = part.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1.0 - weight) * values[before] + weight * values[before + 1])


def _places(trajectory: Epochs, before: IntArray, part: FloatArray, length: FloatArray) -> FloatArray:
    """Return places by Hermite interpolation."""
    velocity = velocities(trajectory)
    s, h = part[:, None], length[:, None]
    one, other = trajectory.place[before], trajectory.place[before + 1]
    return np.asarray(
        one
        + (3.0 * s**2 - 2.0 * s**3) * (other - one)
        + (s - 2.0 * s**2 + s**3) * h * velocity[before]
        + (s**3 - s**2) * h * velocity[before + 1]
    )


def _rotations(trajectory: Epochs, before: IntArray, part: FloatArray) -> FloatArray:
    result = np.full((len(before), 3, 3), np.nan)
    known: BoolArray = np.asarray(np.isfinite(trajectory.angles).all(axis=1))
    rows = np.flatnonzero(known.take(before) & known.take(before + 1) & np.isfinite(part))
    if not len(rows) or trajectory.mount == "photo":
        return result
    from scipy.spatial.transform import Rotation

    rotation = rotation_from_navigation(trajectory.angles, trajectory.mount)
    one, other = rotation[before[rows]], rotation[before[rows] + 1]
    turn = Rotation.from_matrix(other @ np.swapaxes(one, 1, 2)).as_rotvec()
    result[rows] = Rotation.from_rotvec(part[rows, None] * turn).as_matrix() @ one
    return result


def moved(place: FloatArray, offset: FloatArray, *, is_geographic: bool) -> FloatArray:
    """Return places moved by offsets (n, 3) along east, north and up, m, or X, Y and Z."""
    if not is_geographic:
        return np.asarray(place + offset)
    geocentric = geocentric_from_geographic(place, WGS84)
    geocentric += np.einsum("nij,ni->nj", place_axes(place), offset)
    return geographic_from_geocentric(geocentric, WGS84)
