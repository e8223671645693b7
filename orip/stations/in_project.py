"""Exposures in the project's coordinates: the stations that are written, and which files of theirs are replaced."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import InputError, ProjectWarning, UsageError
from orip.files.text.atomic import reporting_failure, require_no_link
from orip.files.text.regular_file import open_regular
from orip.geometry.ground_crs import near_place
from orip.geometry.ground_frame import GroundFrame, ground_frame
from orip.geometry.other_crs import motion_along
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation
from orip.records.control import NOT_GIVEN, Station, StationMotion
from orip.stations.interpolation import EventMotions
from orip.structs import replace
from orip.units import METRES_PER_GROUND_UNIT

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
    motions : EventMotions or None
        None: nothing is known of them, or they are not wanted.
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
    motions: EventMotions | None = None


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
    stations = [
        replace(station, motion=motion_along(station.motion, grid, per_unit))
        for station, grid in zip(stations, to_grid, strict=True)
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
        motion=None if exposures.motions is None else _motion(exposures.motions, row),
    )


def _motion(motions: EventMotions, row: int) -> StationMotion | None:
    """Return a motion along and about the axes of its place, m/s; None where neither velocity nor rate is known."""
    values, errors = motions.values[row], motions.errors[row]
    if not (np.isfinite(values[:3]).all() or np.isfinite(values[3:]).all()):
        return None
    return StationMotion(_triple(values[:3]), _triple(errors[:3]), _triple(values[3:]), _triple(errors[3:]))


def _triple(values: FloatArray) -> tuple[float, float, float]:
    first, second, third = (float(value) for value in values)
    return first, second, third


_RECORDS = {".sbet": 17, ".smrmsg": 10}
"""Numbers of a record."""


def require_solution(target: Path, inputs: Iterable[Path]) -> None:
    """Refuse to replace what is read, or what is no solution of RTKLIB.

    Raises
    ------
    UsageError, OripError
    """
    _require_own(target, inputs, _is_solution, "no solution of RTKLIB; name another file with --output")


def require_trajectory(target: Path, inputs: Iterable[Path]) -> None:
    """Refuse to replace what is read, or what is no SBET and no SMRMSG.

    Raises
    ------
    UsageError, OripError
    """
    _require_own(target, inputs, _is_trajectory, "no trajectory; name another file, NAME.sbet, with --output")


def _require_own(target: Path, inputs: Iterable[Path], is_own: Callable[[Path], bool], fault: str) -> None:
    with reporting_failure(target.name, "name another file with --output"):
        require_no_link(target)
        if not target.exists():
            return
        if any(path.exists() and target.samefile(path) for path in inputs):
            message = f"--output {target.name} is a file that is read; name another"
            raise UsageError(message)
        if not (target.is_file() and is_own(target)):
            message = f"{target.name} is there and is {fault}"
            raise UsageError(message)


def _is_solution(path: Path) -> bool:
    with open_regular(path) as file:
        return bool(file.read(9) == b"% program")


def _is_trajectory(path: Path) -> bool:
    return path.suffix in _RECORDS and path.stat().st_size % (8 * _RECORDS[path.suffix]) == 0
