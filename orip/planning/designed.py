"""A plan in a project: its settings and texts read, its design, variants of it, and places of control."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.unknowns import CONSTANT
from orip.errors import InputError, UsageError
from orip.files.control.stations_text import read_stations, stations_text
from orip.files.text.regular_file import is_there
from orip.planning.areas import checked_outline, level, read_outline, terrain_of_points, terrain_of_raster
from orip.planning.forecast import (
    Design,
    Forecast,
    design_block,
    forecast,
    planned_control,
    points_of_box,
    tie_points,
)
from orip.planning.geometry import Terrain
from orip.planning.placement import Candidate, Criterion, Placement, place
from orip.planning.plan import PlannedFlight, frame_of, plan_flight, plan_rings
from orip.records.camera import CAMERA_PARAMETERS, Camera
from orip.records.control import Control, ControlPoint, Station
from orip.records.definition import BundleDefinition
from orip.records.names import record_key
from orip.records.plan import PlanSettings
from orip.structs import replace
from orip.workflow.project.state import ProjectState
from orip.workflow.project.texts import raise_complaints

PLAN_ENDING = ".PLAN"

_TOML = "orip.toml"

_WEAK = 0.3
"""Part of the height above ground that positions are known by while control is sought, where they are not observed."""


class Given(Struct, frozen=True):
    """What a plan is made from.

    Parameters
    ----------
    settings : PlanSettings
    camera : Camera
    bundle : BundleDefinition
        Whose precision and settings are those of the forecast.
    terrain : callable
    control : Control
    state : ProjectState
    """

    settings: PlanSettings
    camera: Camera
    bundle: BundleDefinition
    terrain: Terrain
    control: Control
    state: ProjectState

    @property
    def path(self) -> Path:
        """Return the text of the planned exposures."""
        definition = self.state.project.definition
        return self.state.project.folder / f"{definition.control_files}{PLAN_ENDING}"


def given_plan(state: ProjectState, bundle: str | None) -> Given:
    """Read what a plan is made from.

    Raises
    ------
    InputError
        With what is missing or wrong.
    """
    project = state.project
    definition = project.definition
    settings = definition.plan
    if settings is None:
        message = "there is no [plan] in it; write one with pixel or height, and area or corners"
        raise InputError.single(message, _TOML)
    control = state.texts.control
    raise_complaints(control.complaints)
    camera = camera_of(definition.cameras, settings.camera)
    frame_of(camera, settings.across)
    name = project.bundle_name(bundle)
    chosen = next((one for one in definition.bundles if record_key(one.name) == record_key(name)), None)
    if chosen is None:
        message = f"bundle {name} is not in it; write its [[bundle]] with measurement_precision"
        raise InputError.single(message, _TOML)
    terrain = _terrain(settings, control.value.points, project.folder, project.shown)
    return Given(settings, camera, chosen, terrain, control.value, state)


def camera_of(cameras: Sequence[Camera], name: str) -> Camera:
    """Return the camera of a name, or the only one."""
    found = [camera for camera in cameras if not name or record_key(camera.name) == record_key(name)]
    if len(found) != 1:
        known = ", ".join(camera.name for camera in cameras) or "none"
        message = f"[plan] has camera = {name!r}, cameras are: {known}; name one of them"
        raise InputError.single(message, _TOML)
    return found[0]


def made_plan(given: Given) -> PlannedFlight:
    """Return the plan that the settings ask for."""
    settings, camera = given.settings, given.camera
    if settings.kind == "rings":
        return plan_rings(settings, camera)
    if bool(settings.area) == (settings.corners is not None):
        message = "give one of area (a file) and corners in [plan]"
        raise InputError.single(message, _TOML)
    project = given.state.project
    is_line = settings.corridor > 0.0
    if settings.corners is not None:
        outline, shown = np.array(settings.corners, dtype=np.float64), f"{_TOML}: corners of [plan]"
    else:
        path = project.folder / settings.area
        shown = project.shown(path)
        outline = read_outline(path, shown, project.definition.crs, is_line=is_line)
    return plan_flight(settings, camera, checked_outline(outline, shown, is_line=is_line), given.terrain)


def plan_text(plan: PlannedFlight) -> str:
    """Return the text of the planned exposures: a .STA file with comments."""
    head = (
        "! planned by 'orip plan'; edit it as you like: 'orip plan forecast' and 'export' read it again\n"
        "! photo X Y Z and their a-priori errors, OMEGA PHI KAPPA and theirs, time (s), strip\n"
        "! a negative error: planned, but not observed\n"
    )
    return head + stations_text(plan.stations)


def require_other_file(given: Given, path: Path) -> None:
    """Refuse to write an output over the plan, whatever the case of its letters."""
    if path.name.casefold() == given.path.name.casefold():
        message = f"{given.path.name} is the plan itself, which no output replaces; name another file"
        raise UsageError(message)


def planned_stations(given: Given) -> tuple[Station, ...]:
    """Return the planned exposures of the text.

    Raises
    ------
    InputError
        If there is none, or it has faults.
    """
    project = given.state.project
    shown = project.shown(given.path)
    if not is_there(given.path):
        message = "there is no plan yet; run 'orip plan make' first"
        raise InputError.single(message, shown)
    parsed = read_stations(given.path, shown)
    raise_complaints(parsed.complaints)
    lacking = [station for station in parsed.value if not (station.has_position and station.has_angles)]
    if lacking or not parsed.value:
        message = f"photo '{lacking[0].photo}' needs a position and angles" if lacking else "it has no exposures"
        msg = f"{message}; run 'orip plan make'"
        raise InputError.single(msg, shown, lacking[0].line if lacking else None)
    return parsed.value


def design_of(given: Given, stations: Sequence[Station]) -> Design:
    """Return the design of planned exposures, with tie points on the ground or in the object."""
    settings, definition = given.settings, given.state.project.definition
    frame = frame_of(given.camera, "height")  # along and across are x and y
    points = (
        points_of_box(settings.centre, settings.size, settings.tie_points)
        if settings.kind == "rings"
        else tie_points(np.array([frame.along, frame.across]), frame.c, stations, given.terrain, settings.tie_points)
    )
    return Design(
        given.bundle, given.camera, tuple(stations), points, given.control, definition.antennas,
        definition.ground_unit, definition.crs,
    )  # fmt: skip


def forecast_of(given: Given, stations: Sequence[Station]) -> Forecast:
    """Return the forecast of planned exposures."""
    return forecast(design_block(design_of(given, stations)))


class Variant(Struct, frozen=True):
    """A variant of a plan: what is different, its plan and forecast."""

    name: str
    plan: PlannedFlight
    forecast: Forecast


def variant_of(given: Given, text: str) -> Variant:
    """Return the forecast of a plan with other settings: ``cross_strips=2 forward=70``; empty: as it is.

    ``rtk=0.02`` gives positions that error (``rtk=none``: none), ``unknown=C,A3`` or ``unknown=none`` the camera's
    unknowns, ``control=5`` as many points at the best places.

    Raises
    ------
    UsageError
        If a word is not KEY=VALUE of a setting.
    """
    changed, count = given, 0
    for word in text.split():
        key, equals, value = word.partition("=")
        if key == "control" and value.isdigit():
            count = int(value)
        elif equals and key in _CHANGES:
            changed = _CHANGES[key](changed, _number(value, word) if key == "rtk" and value != "none" else value)
        else:
            changed = replace(changed, settings=_with_setting(changed.settings, key, value, word))
    plan = made_plan(changed)
    if count:
        found = place_control(changed, plan.stations, count, "largest", 100)
        points = (*changed.control.points, *found.points)
        changed = replace(changed, control=replace(changed.control, points=points))
    return Variant(text or "as planned", plan, forecast_of(changed, plan.stations))


class PlacedControl(Struct, frozen=True):
    """Control points at the best places, and what they are worth."""

    points: tuple[ControlPoint, ...]
    placement: Placement


def place_control(
    given: Given, stations: Sequence[Station], count: int, criterion: Criterion, places: int
) -> PlacedControl:
    """Return control points at the best of many places of the ground.

    Parameters
    ----------
    given : Given
    stations : sequence of Station
        Planned exposures.
    count : int
    criterion : {"largest", "mean", "camera"}
        Of the points at all these places, or of C.
    places : int
        About so many are candidates.

    Raises
    ------
    UsageError
        If there are fewer places than points.
    """
    design = design_of(given, stations)
    above = _above_ground(given, stations)
    if all(station.position_error[0] < 0.0 for station in stations) and not design.control.points:
        weak = tuple(replace(station, position_error=(_WEAK * above,) * 3) for station in stations)
        design = replace(design, stations=weak)
    block = design_block(design)
    solved = forecast(block).solved
    rays = np.bincount(block.photo_points.point, minlength=len(block.point_names))
    tied = np.array([name.startswith("T") for name in block.point_names])
    free = (solved.problem.unknowns.points != CONSTANT).all(axis=1)
    free &= ~solved.normals.removed[solved.problem.unknowns.points].any(axis=1)
    rows = np.flatnonzero(tied & free & (rays >= 3))
    rows = rows[_thinned(block.point_start[rows], places)]
    if len(rows) < count:
        message = f"{count} points are wanted of {len(rows)} places that three photos show; ask for fewer"
        raise UsageError(message)
    columns = solved.problem.unknowns.points[rows].ravel()
    lens = solved.problem.unknowns.cameras[0][CAMERA_PARAMETERS.index("C")]
    has_lens = lens != CONSTANT and not solved.normals.removed[lens]
    if criterion == "camera" and not has_lens:
        message = (
            "C is not unknown, or nothing determines it without control; add it to unknown, or choose another goal"
        )
        raise UsageError(message)
    order = np.concatenate([[lens], columns]) if has_lens else columns
    covariance = solved.normals.inverse_at(np.sort(order))
    at = np.searchsorted(np.sort(order), order)
    covariance = covariance[np.ix_(at, at)]
    first = 1 if has_lens else 0
    variance = np.full(3, given.settings.control_error**2)
    candidates = [
        Candidate(block.point_names[row], first + 3 * number + np.arange(3), np.eye(3), variance)
        for number, row in enumerate(rows.tolist())
    ]
    targets = (
        np.concatenate([first + np.arange(len(columns)), [0]])
        if criterion == "camera"
        else first + np.arange(len(columns))
    )
    found = place(covariance, candidates, targets, count, criterion)
    chosen = block.ground.to_project(block.point_start[rows[list(found.chosen)]])
    names = _new_names(count, {point.name for point in given.control.points})
    return PlacedControl(planned_control(names, chosen, given.settings.control_error), found)


def _above_ground(given: Given, stations: Sequence[Station]) -> float:
    places = np.array([station.position for station in stations])
    if given.settings.kind == "rings":
        return float(np.median(np.linalg.norm(places - given.settings.centre, axis=1)))
    return float(np.median(places[:, 2] - given.terrain(places[:, :2])))


def _thinned(points: FloatArray, most: int) -> Any:
    """Return which of many points to keep: those nearest to a coarser grid."""
    if len(points) <= most:
        return np.arange(len(points))
    low, extent = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0)
    step = float(np.sqrt(max(extent[0] * extent[1], 1e-12) / most))
    cell = np.floor((points[:, :2] - low) / step).astype(np.int64)
    _, first = np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_index=True)
    return np.sort(first)


def _new_names(count: int, taken: set[str]) -> list[str]:
    numbers = (f"GCP{number}" for number in range(1, 10 * count + len(taken) + 1))
    return [name for name in numbers if name not in taken][:count]


def _terrain(
    settings: PlanSettings, points: Sequence[ControlPoint], folder: Path, shown: Callable[[Path], str]
) -> Terrain:
    if not settings.terrain:
        return level(settings.ground)
    if settings.terrain == "control":
        return terrain_of_points(points, "the .PNT file")
    path = folder / settings.terrain
    return terrain_of_raster(path, shown(path))


def _number(text: str, word: str) -> float:
    from orip.files.text.decimal_numbers import is_number, parse_number

    if not is_number(text):
        message = f"--variant {word}: write a number after ="
        raise UsageError(message)
    return parse_number(text)


def _with_setting(settings: PlanSettings, key: str, value: str, word: str) -> PlanSettings:
    from orip.files.project.reader import parse_project

    known = [name for name in PlanSettings.__struct_fields__ if isinstance(getattr(settings, name), int | float)]
    if key not in {*known, "pixel", "height", "direction"}:
        message = f"--variant {word}: write KEY=VALUE; keys are: {', '.join([*known, *_CHANGES, 'control'])}"
        raise UsageError(message)
    text = f'project = {{ name = "V" }}\n[plan]\n{key} = {value}\n'
    parsed = parse_project(text)
    if parsed.complaints or parsed.value is None or parsed.value.definition.plan is None:
        message = f"--variant {word}: {'; '.join(fault.message for fault in parsed.complaints)}"
        raise UsageError(message)
    return replace(settings, **{key: getattr(parsed.value.definition.plan, key)})


def _with_rtk(given: Given, value: Any) -> Given:
    error = None if value == "none" else (value, value, 1.8 * value)
    return replace(given, settings=replace(given.settings, position_error=error))


def _with_unknown(given: Given, value: Any) -> Given:
    names = () if value == "none" else tuple(value.upper().split(","))
    wrong = [name for name in names if name not in CAMERA_PARAMETERS]
    if wrong:
        message = f"--variant unknown={value}: parameters are {', '.join(CAMERA_PARAMETERS)}"
        raise UsageError(message)
    return replace(given, camera=replace(given.camera, unknown=names))


_CHANGES: Mapping[str, Callable[[Given, Any], Given]] = {"rtk": _with_rtk, "unknown": _with_unknown}
