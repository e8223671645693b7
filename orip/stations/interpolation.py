"""Places and attitudes between the epochs of a trajectory, and in the project's coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.errors import Complaint, InputError, ProjectWarning
from orip.geometry.ground_crs import near_place
from orip.geometry.ground_ellipsoid import (
    geocentric_from_geographic,
    geographic_from_geocentric,
    metres_per_radian,
    place_axes,
)
from orip.geometry.ground_frame import GroundFrame, ground_frame
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation, rotation_from_navigation
from orip.records.control import NOT_GIVEN, Station
from orip.records.epochs import SECONDS_PER_WEEK, Epochs
from orip.structs import replace
from orip.units import METRES_PER_GROUND_UNIT

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
    way = np.diff(place[ends], axis=0) * _metres_per_unit(trajectory, place[ends[:-1]])
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
    given = trajectory.velocity / _metres_per_unit(trajectory, trajectory.place)
    return np.where(np.isnan(given), np.column_stack(rates), given)


def _metres_per_unit(trajectory: Epochs, place: FloatArray) -> FloatArray:
    """Return metres (n, 3) per unit of each coordinate of places."""
    return metres_per_radian(place, WGS84) if trajectory.is_geographic else np.ones_like(place)


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


_LEAST_ERROR = 1e-4
"""Metres: no satellite gives positions better than that, whatever a file says."""

_ALIKE = 1e-3
"""Coefficients of correlation below this are left out."""


class Exposures(Struct, frozen=True):
    """n exposures with what was observed of each; arguments as of `Epochs`.

    Parameters
    ----------
    photo : tuple of n str
    place : array (n, 3)
    is_geographic : bool
    covariance : array (n, 3, 3)
        Of the place; NaN where it is not known.
    rotation : array (n, 3, 3)
        Photo axes to east, north, up (geographic places) or to X, Y, Z; NaN where it is not known.
    angle_error : array (n, 3)
        About the axes of photo or vehicle, radians; NaN where it is not known.
    time : array (n,)
    is_used : tuple of n bool
        False: the station is only compared.
    strip : tuple of n str
    joint : array (n, 6, 6) or None
        Covariance of place and rotation, along and about east, north, up: metres, radians. Takes the place of
        `covariance` and `angle_error`.
    """

    photo: tuple[str, ...]
    place: FloatArray
    is_geographic: bool
    covariance: FloatArray
    rotation: FloatArray
    angle_error: FloatArray
    time: FloatArray
    is_used: tuple[bool, ...]
    strip: tuple[str, ...]
    joint: FloatArray | None = None


def stations_in_project(
    exposures: Exposures,
    crs: str | None,
    ground_unit: str,
    position_error: Sequence[float],
    angle_error: float,
) -> tuple[tuple[Station, ...], tuple[ProjectWarning, ...]]:
    """Return the stations in the project's coordinates: grid east, grid north and height.

    Geographic places and the project's coordinates are taken to be of one datum.

    Parameters
    ----------
    exposures : Exposures
    crs : str or None
        The project's.
    ground_unit : str
        The project's.
    position_error : sequence of 3 float
        Standard deviations along east, north, up where no covariance is known, metres.
    angle_error : float
        Standard deviation where none is known, radians.

    Raises
    ------
    InputError
        If places are geographic and the project has no crs, or its heights need a grid that is not installed.
    """
    place, warnings = exposures.place, tuple[ProjectWarning, ...]()
    to_grid = np.broadcast_to(np.eye(3), (len(place), 3, 3))
    per_unit = 1.0
    covariance = np.where(np.isnan(exposures.covariance), np.diag(np.square(position_error)), exposures.covariance)
    if exposures.is_geographic:
        frame = project_frame(place, crs, ground_unit)
        warnings = frame.warnings
        place = frame.crs.from_geographic(place)
        to_grid = frame.grid_axes_at(place)
        per_unit = METRES_PER_GROUND_UNIT[ground_unit]
    covariance = to_grid @ covariance @ np.swapaxes(to_grid, 1, 2) / per_unit**2
    angles = angles_from_rotation(to_grid @ exposures.rotation)
    errors = np.where(np.isnan(exposures.angle_error), angle_error, exposures.angle_error)
    stations = [
        _station(exposures, row, place[row], covariance[row], angles[row], errors[row]) for row in range(len(place))
    ]
    if exposures.joint is not None:
        stations = [
            _with_joint_covariance(station, grid, joint, per_unit)
            for station, grid, joint in zip(stations, to_grid, exposures.joint, strict=True)
        ]
    return tuple(stations), warnings


def _with_joint_covariance(station: Station, to_grid: FloatArray, joint: FloatArray, per_unit: float) -> Station:
    """Return a station with the covariance of its position and angles."""
    by_axes = np.zeros((6, 6))
    by_axes[:3, :3] = to_grid / per_unit
    by_axes[3:, 3:] = angle_rates_from_axes_rotation(np.array(station.angles)) @ to_grid
    covariance = by_axes @ joint @ by_axes.T
    sign = np.repeat([np.sign(station.position_error[0]), np.sign(station.angle_error[0])], 3)
    errors = sign * np.sqrt(np.diag(covariance))
    return replace(
        station,
        position_error=_triple(errors[:3]),
        angle_error=_triple(errors[3:]),
        covariance=tuple(map(tuple, covariance.tolist())),
    )


def project_frame(place: FloatArray, crs: str | None, ground_unit: str) -> GroundFrame:
    """Return the frame of the project around geographic places (n, 3); raises InputError without a crs."""
    known = place[np.isfinite(place).all(axis=1)]
    if crs is None:
        message = (
            "positions are longitude and latitude, but the project has no crs; name it in orip.toml "
            '(project = { crs = "EPSG:25832+7837" }), or give positions in the coordinates of the project'
        )
        raise InputError.single(message)
    if not len(known):
        message = "no photo has a position"
        raise InputError.single(message)
    return ground_frame(crs, ground_unit, near_place(crs, ground_unit, np.median(known, axis=0)))


def _station(
    exposures: Exposures, row: int, place: FloatArray, covariance: FloatArray, angles: FloatArray, errors: FloatArray
) -> Station:
    has_place, has_angles = bool(np.isfinite(place).all()), bool(np.isfinite(angles).all())
    sign = 1.0 if exposures.is_used[row] else -1.0
    deviations = np.maximum(np.sqrt(np.diag(covariance)), _LEAST_ERROR)
    scale = np.outer(deviations, deviations)
    correlation = covariance / scale
    is_correlated = has_place and bool(np.abs(correlation[np.triu_indices(3, 1)]).max() > _ALIKE)
    # what was rounded to few digits in a file may be just beyond what three errors can have
    is_proper = is_correlated and bool(np.linalg.eigvalsh(correlation)[0] > _ALIKE)
    np.fill_diagonal(correlation, 1.0)
    return Station(
        photo=exposures.photo[row],
        position=_triple(place) if has_place else NOT_GIVEN,
        position_error=_triple(sign * deviations) if has_place else NOT_GIVEN,
        angles=_triple(angles) if has_angles else NOT_GIVEN,
        angle_error=_triple(sign * errors) if has_angles else NOT_GIVEN,
        covariance=tuple(_triple(line) for line in scale * correlation) if is_proper else None,
        time=float(exposures.time[row]),
        strip=exposures.strip[row],
    )


def _triple(values: FloatArray) -> tuple[float, float, float]:
    first, second, third = (float(value) for value in values)
    return first, second, third
