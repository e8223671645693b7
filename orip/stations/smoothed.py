"""Exposure stations and relative control from a smoothed trajectory: .STA and .REL."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from orip.arrays import FloatArray
from orip.errors import Complaint, InputError
from orip.files.control.editing import read_control_lines
from orip.files.control.stations_text import differences_text, parse_differences
from orip.files.text.shown import Parsed
from orip.geometry.ground_ellipsoid import place_axes
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.control import Station, StationDifference
from orip.records.epochs import Epochs, epochs
from orip.records.names import record_key
from orip.stations.exposures import Sources, find_exposures
from orip.stations.imported import ImportedStations, ImportSettings, known_photos, with_wanted_motions, written_stations
from orip.stations.in_project import Exposures, stations_in_project
from orip.stations.inertial.dense import ImuResult
from orip.stations.inertial.differences import independent_poses
from orip.stations.inertial.processing import event_times
from orip.structs import replace
from orip.units import METRES_PER_GROUND_UNIT
from orip.workflow.project.commit import Change
from orip.workflow.project.outputs import EditedText, digest_of_text
from orip.workflow.project.state import ProjectState

_SAME_TIME = 1e-4
"""Seconds between an exposure and its state."""


def import_smoothed(
    state: ProjectState, result: ImuResult, events: Epochs, photo_times: Epochs | None, settings: ImportSettings,
    *, dry_run: bool = False,
) -> Change[ImportedStations]:  # fmt: skip
    """Return the stations of photos and the differences between successive ones, to be written into .STA and .REL.

    All are independent of one another: see `orip.stations.inertial.differences`.

    Raises
    ------
    InputError
        If no photo has an event within the trajectory, or the files have these photos and are not to be replaced.
    """
    project = state.project
    sources = Sources(_as_epochs(result), events, photo_times, known_photos(state))
    exposures, warnings = find_exposures(sources, settings.matching)
    wanted = event_times(replace(events, time=exposures.time), result.time)
    if not len(wanted):
        raise InputError([Complaint("no photo has an event within the trajectory", events.shown)])
    order = np.argsort(exposures.time, kind="stable")
    exposures = _in_order(exposures, order)
    time = exposures.time if events.has_week else exposures.time + (wanted[0] - exposures.time[0])
    states = np.array([int(np.argmin(np.abs(result.trajectory.time - one))) for one in time])
    if np.abs(result.trajectory.time[states] - time).max() > _SAME_TIME:
        row = int(np.argmax(np.abs(result.trajectory.time[states] - time)))
        text = f"photo {exposures.photo[row]} lies before the first or after the last position; leave its event out"
        raise InputError([Complaint(text, events.shown)])
    poses = independent_poses(result.trajectory, states.tolist())
    to_place = place_axes(exposures.place) @ result.axes.T
    exposures = replace(with_wanted_motions(exposures, project), joint=_turned(poses.station, to_place, to_place))
    definition = project.definition
    stations, more = stations_in_project(exposures, definition.crs, definition.ground_unit, (1.0, 1.0, 1.0), 1.0)
    of_differences = _turned(poses.difference, to_place[:-1], to_place[:-1])
    differences = _differences(stations, exposures, of_differences, METRES_PER_GROUND_UNIT[definition.ground_unit])
    relative = _with_differences(state, differences, replaces=settings.replaces)
    return written_stations(state, stations, (*warnings, *more), settings, (relative,), dry_run=dry_run)


def _as_epochs(result: ImuResult) -> Epochs:
    count = len(result.time)
    covariance = np.zeros((count, 3, 3))
    covariance[:, range(3), range(3)] = result.place_deviation**2
    return epochs(
        "the trajectory", np.arange(1, count + 1), time=result.time, place=result.geographic, covariance=covariance,
        quality=("fixed",) * count, velocity=result.velocity, angles=result.angles, angle_error=result.angle_deviation,
    )  # fmt: skip


def _in_order(exposures: Exposures, order: np.ndarray) -> Exposures:
    return replace(
        exposures,
        photo=tuple(exposures.photo[row] for row in order),
        place=exposures.place[order],
        covariance=exposures.covariance[order],
        rotation=exposures.rotation[order],
        angle_error=exposures.angle_error[order],
        time=exposures.time[order],
        is_used=tuple(exposures.is_used[row] for row in order),
        strip=tuple(exposures.strip[row] for row in order),
        motions=None if exposures.motions is None else exposures.motions.of(order),
    )


def _turned(covariance: FloatArray, of_position: FloatArray, of_rotation: FloatArray) -> FloatArray:
    """Return covariances (n, 6, 6) along other axes (n, 3, 3)."""
    turn = np.zeros((len(covariance), 6, 6))
    turn[:, :3, :3], turn[:, 3:, 3:] = of_position, of_rotation
    return np.asarray(turn @ covariance @ np.swapaxes(turn, 1, 2))


def _differences(
    stations: tuple[Station, ...], exposures: Exposures, covariance: FloatArray, per_unit: float
) -> tuple[StationDifference, ...]:
    """Return the differences of neighbours that have something in common; covariances along east, north, up."""
    attitude = rotation_from_angles(np.array([station.angles for station in stations]))
    to_grid = attitude @ np.swapaxes(exposures.rotation, 1, 2)
    along = _turned(covariance, to_grid[:-1] / per_unit, np.swapaxes(exposures.rotation[:-1], 1, 2))
    found = []
    for row, (one, other) in enumerate(pairwise(stations)):
        if not np.isfinite(along[row]).all():
            continue
        errors = np.sqrt(np.diag(along[row])).tolist()
        angles = angles_from_rotation(attitude[row].T @ attitude[row + 1])
        x, y, z = (np.array(other.position) - np.array(one.position)).tolist()
        omega, phi, kappa = angles.tolist()
        found.append(
            StationDifference(
                one.photo, other.photo, (x, y, z), (errors[0], errors[1], errors[2]), (omega, phi, kappa),
                (errors[3], errors[4], errors[5]), tuple(map(tuple, along[row].tolist())),
            )
        )  # fmt: skip
    return tuple(found)


def _with_differences(state: ProjectState, differences: tuple[StationDifference, ...], *, replaces: bool) -> EditedText:
    """Return the .REL file with differences."""
    project = state.project
    path = project.folder / f"{project.definition.control_files}.REL"
    shown, digest = project.shown(path), digest_of_text(path)
    lines = read_control_lines(path, shown)
    pairs = {frozenset({record_key(line.first), record_key(line.second)}) for line in differences}
    there = [
        line for line in lines.records() if frozenset(record_key(field.text) for field in line.fields[:2]) in pairs
    ]
    if there and not replaces:
        text = "these two photos have a difference already; give --replace to put the new one in its place"
        raise InputError([Complaint(text, shown, line.number) for line in there])
    before = lines.without_lines(line.number for line in there).text
    before += "" if before.endswith("\n") or not before else "\n"
    new = before + differences_text(differences)
    parsed = parse_differences(Parsed(new.removeprefix("\ufeff").splitlines()), shown)
    if parsed.complaints:
        raise InputError(parsed.complaints)
    return EditedText(path, digest, new, "the file is unchanged")
