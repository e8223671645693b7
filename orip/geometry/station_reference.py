"""Stations as a .STA file has them, in another system or with other angles, to the project's coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.errors import InputError
from orip.geometry.ground_crs import near_place
from orip.geometry.ground_ellipsoid import place_axes
from orip.geometry.ground_frame import GroundFrame, ground_frame
from orip.geometry.other_crs import geographic_from_crs
from orip.geometry.rotation import angles_from_rotation, rotation_from_navigation
from orip.records.observations.station import IN_PROJECT, Station, StationReference
from orip.structs import replace


def stations_of_reference(
    stations: Sequence[Station], reference: StationReference, crs: str | None, ground_unit: str
) -> tuple[Station, ...]:
    """Return stations in the project's coordinates, with omega, phi and kappa against its axes.

    Standard deviations of positions are along east, north and up, or along geocentric axes where positions are
    geocentric; those of roll and pitch become that of omega and phi, the larger of both, that of heading that of kappa.

    Raises
    ------
    InputError
        If the system is unknown, needs a grid that is not installed, or the project has none to go to.
    """
    if reference == IN_PROJECT or not stations:
        return tuple(stations)
    position = np.array([station.position for station in stations], dtype=np.float64)
    known: BoolArray = np.asarray(np.isfinite(position).all(axis=1), dtype=np.bool_)
    turn = np.broadcast_to(np.eye(3), (len(stations), 3, 3)).copy()
    to_grid = turn.copy()
    if reference.crs:
        if crs is None:
            message = f"positions are in {reference.crs}, but the project has no crs; name it in orip.toml"
            raise InputError.single(message)
        place, is_geocentric = geographic_from_crs(position[known], reference.crs, crs)
        frame = ground_frame(crs, ground_unit, near_place(crs, ground_unit, np.median(place, axis=0)))
        position[known] = frame.crs.from_geographic(place)
        to_grid[known] = frame.grid_axes_at(position[known])
        turn[known] = to_grid[known] @ place_axes(place) if is_geocentric else to_grid[known]
    elif crs is not None and known.any():
        to_grid[known] = _frame(crs, ground_unit, position[known]).grid_axes_at(position[known])
    moved = [
        _moved(station, position[row], turn[row]) if known[row] and reference.crs else station
        for row, station in enumerate(stations)
    ]
    return tuple(_turned(moved, to_grid, known) if reference.navigation else moved)


def _frame(crs: str, ground_unit: str, position: FloatArray) -> GroundFrame:
    return ground_frame(crs, ground_unit, np.median(position, axis=0))


def _moved(station: Station, position: FloatArray, turn: FloatArray) -> Station:
    """Return a station at a position, its errors along turned axes where all of them are used or compared alike."""
    x, y, z = position.tolist()
    station = replace(station, position=(x, y, z))
    errors = np.array(station.position_error)
    if not ((errors > 0.0).all() or (errors < 0.0).all()):
        return station
    given = np.diag(errors**2) if station.covariance is None else np.array(station.covariance)
    covariance = turn @ given @ turn.T
    first, second, third = (np.sign(errors) * np.sqrt(np.diag(covariance))).tolist()
    rows = tuple((float(row[0]), float(row[1]), float(row[2])) for row in covariance)
    return replace(station, position_error=(first, second, third), covariance=rows)


def _turned(stations: Sequence[Station], to_grid: FloatArray, known: BoolArray) -> list[Station]:
    """Return stations whose roll, pitch and heading are turned to omega, phi and kappa."""
    angles = np.array([station.angles for station in stations], dtype=np.float64)
    rotation = to_grid @ rotation_from_navigation(angles)
    found = angles_from_rotation(rotation)
    result = []
    for row, station in enumerate(stations):
        if not station.has_angles:
            result.append(station)
            continue
        if not known[row]:
            message = f"roll, pitch and heading of photo {station.photo} need its position; give X, Y and Z"
            raise InputError.single(message, line=station.line)
        roll, pitch, heading = station.angle_error
        level = roll if abs(roll) >= abs(pitch) else pitch
        omega, phi, kappa = found[row].tolist()
        result.append(replace(station, angles=(omega, phi, kappa), angle_error=(level, level, heading)))
    return result
