"""Exposure stations in the project's coordinates, from places and attitudes of GNSS and INS."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import InputError, ProjectWarning
from orip.geometry.ground_crs import near_place
from orip.geometry.ground_frame import GroundFrame, ground_frame
from orip.geometry.rotation import angles_from_rotation
from orip.records.observations.control import NOT_GIVEN, Station
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
        frame = _frame(place, crs, ground_unit)
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
    return tuple(stations), warnings


def _frame(place: FloatArray, crs: str | None, ground_unit: str) -> GroundFrame:
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
