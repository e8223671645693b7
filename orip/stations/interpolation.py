"""Places, attitudes and motions between the epochs of a trajectory."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.errors import Complaint, ProjectWarning
from orip.geometry.ground_ellipsoid import (
    geocentric_from_geographic,
    geographic_from_geocentric,
    metres_per_radian,
    place_axes,
)
from orip.geometry.rotation import rotation_from_navigation, rotation_vectors_with_partials
from orip.records.epochs import SECONDS_PER_WEEK, Epochs
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

WGS84 = (6_378_137.0, 6_356_752.314245)
"""Half axes; another ellipsoid changes what is interpolated over some seconds of flight by less than a micrometre."""

_STRETCH = 10.0
"""Seconds over which the way by the velocities is compared with that between the positions: the errors of neighbouring
positions hardly matter over it."""

_LARGEST_PART, _LARGEST_DIFFERENCE = 0.1, 0.5
"""Part of the way, and metres, by which velocities may miss the positions at the end of a stretch. Velocities in other
axes, or in other units, miss them by as much as the way itself."""


def without_contradicting_velocities(trajectory: Epochs) -> tuple[Epochs, tuple[ProjectWarning, ...]]:
    """Return a trajectory without the velocities that are not those of its positions, and what is said of them.

    Programs write velocities along different axes: of the wander frame, of the vehicle, of the map.
    """
    known = np.flatnonzero(np.isfinite(trajectory.velocity).all(axis=1))
    if len(known) < 2:
        return trajectory, ()
    time, velocity = trajectory.time[known], trajectory.velocity[known]
    step = min(max(round(_STRETCH / float(np.median(np.diff(time)))), 1), len(known) - 1)
    by_velocity = np.vstack([np.zeros(3), 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)[:, None]]).cumsum(axis=0)
    place = trajectory.place[known]
    ends = np.arange(0, len(known), step)
    way = np.diff(place[ends], axis=0) * metres_per_unit(trajectory, place[ends[:-1]])
    missed = np.linalg.norm(np.diff(by_velocity[ends], axis=0) - way, axis=1)
    length = np.linalg.norm(way, axis=1)
    if np.median(missed) <= max(_LARGEST_PART * np.median(length), _LARGEST_DIFFERENCE):
        return trajectory, ()
    worst = int(np.argmax(missed - _LARGEST_PART * length))
    first, last = (int(trajectory.line[known[ends[place]]]) for place in (worst, worst + 1))
    text = (
        f"by the velocities, the position of {last} would be {missed[worst]:.1f} m from where it is: they are along "
        "other axes or in another unit; positions are interpolated without them"
    )
    without = replace(trajectory, velocity=np.full_like(trajectory.velocity, np.nan))
    return without, (ProjectWarning("velocities", f"{trajectory.shown}:{first}", text),)


def velocities(trajectory: Epochs) -> FloatArray:
    """Return the rates (n, 3) of the places: given ones, else those of parabolas through three epochs."""
    order: Literal[1, 2] = 2 if len(trajectory) > 2 else 1
    rates = [np.gradient(column, trajectory.time, edge_order=order) for column in trajectory.place.T]
    given = trajectory.velocity / metres_per_unit(trajectory, trajectory.place)
    return np.where(np.isnan(given), np.column_stack(rates), given)


def metres_per_unit(trajectory: Epochs, place: FloatArray) -> FloatArray:
    """Return metres (n, 3) per unit of each coordinate of places."""
    return metres_per_radian(place, WGS84) if trajectory.is_geographic else np.ones_like(place)


LONGEST_GAP = 2.5
"""Epochs of a usual interval that may lie between the two on both sides of an event."""


class EventMotions(Struct, frozen=True):
    """Of n events along and about east, north, up, or X, Y, Z.

    Parameters
    ----------
    values, errors : arrays (n, 6)
        Velocity, m/s, and angular rate, rad/s, with their standard deviations; NaN where they are not known.
    """

    values: FloatArray
    errors: FloatArray

    def of(self, rows: IntArray) -> EventMotions:
        """Return those of some events."""
        return EventMotions(self.values[rows], self.errors[rows])


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
    motions : EventMotions or None
        None: they were not looked for.
    """

    place: FloatArray
    covariance: FloatArray
    before: IntArray
    rotation: FloatArray
    angle_error: FloatArray
    gap: FloatArray
    motions: EventMotions | None = None


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


_SHORTEST = 0.05
"""Seconds of a mean."""

_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])

_LEAST = np.repeat([1e-3, 1e-3 * RADIANS_PER_DEGREE], 3)
"""m/s and rad/s: errors below these move no image."""


def motions_at(trajectory: Epochs, time: FloatArray) -> EventMotions:
    """Return the motions at times (n,) of a trajectory, in its seconds.

    They are means over 50 ms around an event, about what a shutter takes, or over the interval of the epochs where that
    is longer: vibration is averaged, and it does not matter along which axes a file has rates of its own.

    What they are good for is seen from the trajectory itself, the same for all events. Noise, and what is quicker than
    the epochs show, make fourth differences of successive means large: those of independent errors s have the variance
    70 s². Where places and attitudes have independent errors it is 126 s², and s comes out a third too large.
    """
    if len(trajectory) < 2:
        unknown = np.full((len(time), 6), np.nan)
        return EventMotions(unknown, unknown)
    mean = max(usual_interval(trajectory), _SHORTEST)
    ends = [interpolate(trajectory, time + (part - 2.5) * mean) for part in range(6)]
    found = []
    for one, other in pairwise(ends):
        way = (other.place - one.place) * metres_per_unit(trajectory, one.place)
        turn = rotation_vectors_with_partials(other.rotation @ np.swapaxes(one.rotation, 1, 2))[0]
        found.append(np.hstack([way, turn]) / mean)
    values = found[2]
    squares = np.tensordot(_DIFFERENCE, np.array(found), axes=1) ** 2 / np.sum(_DIFFERENCE**2)
    counted = np.isfinite(squares).sum(axis=0)
    variance = np.where(counted > 0, np.nansum(squares, axis=0) / np.maximum(counted, 1), np.nan)
    errors = np.where(np.isfinite(values), np.maximum(np.sqrt(variance), _LEAST), np.nan)
    return EventMotions(np.where(np.isfinite(errors), values, np.nan), errors)
