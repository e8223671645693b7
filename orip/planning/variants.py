"""Variants of a plan, what they cost and give, and where control points, distances and further photos help most."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.additions.placing import Placed, Wanted, place_in
from orip.bundle.solve import SolvedBlock
from orip.errors import UsageError
from orip.planning.designed import Given, design_of, forecast_of, made_plan
from orip.planning.forecast import Forecast, design_block, forecast
from orip.planning.plan import PlannedFlight
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.control import ControlPoint, Station
from orip.records.plan import PlanSettings
from orip.solving.solve import adjust_bundle
from orip.structs import replace
from orip.workflow.adjust.gathering import block_input
from orip.workflow.project.bundle_state import read_bundle

_WEAK = 0.3
"""Part of the height above ground that positions are known by while control is sought, where they are not observed."""


def place_in_plan(given: Given, stations: Sequence[Station], wanted: Wanted) -> Placed:
    """Return what helps most in a network that is planned.

    Raises
    ------
    UsageError
        If there are fewer places than wanted, or C is judged and not estimated.
    """
    design = design_of(given, stations)
    if all(station.position_error[0] < 0.0 for station in stations) and not design.control.points:
        weak = (_WEAK * _distance_of(given, stations),) * 3
        design = replace(design, stations=tuple(replace(station, position_error=weak) for station in stations))
    solved = forecast(design_block(design)).solved
    return place_in(solved, wanted, {point.name for point in given.control.points}, is_planned=True)


def solved_bundle(folder: Path, bundle: str | None) -> tuple[SolvedBlock, str]:
    """Adjust a bundle of a project folder in memory; return it with the ground unit."""
    state = read_bundle(folder, bundle, "definitions", "marks", "observations")
    return adjust_bundle(block_input(state)), state.project.definition.ground_unit


def best_control(given: Given, stations: Sequence[Station], count: int) -> tuple[ControlPoint, ...]:
    """Return control points where they bring the largest standard deviation of a plan down most."""
    wanted = Wanted("control", count, "largest", 100, given.settings.control_error)
    return place_in_plan(given, stations, wanted).points


def _distance_of(given: Given, stations: Sequence[Station]) -> float:
    """Return the height above ground, or the distance from the object."""
    places: FloatArray = np.array([station.position for station in stations])
    if given.settings.kind == "rings":
        return float(np.median(np.linalg.norm(places - given.object.centre, axis=1)))
    return float(np.median(places[:, 2] - given.terrain(places[:, :2])))


_HEIGHTS = ("pixel", "height", "sd")
"""Of which one is given."""


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
        points = (*changed.control.points, *best_control(changed, plan.stations, count))
        changed = replace(changed, control=replace(changed.control, points=points))
    return Variant(text or "as planned", plan, forecast_of(changed, plan.stations))


def _number(text: str, word: str) -> float:
    from orip.files.text.decimal_numbers import is_number, parse_number

    if not is_number(text):
        message = f"--variant {word}: write a number after ="
        raise UsageError(message)
    return parse_number(text)


def _with_setting(settings: PlanSettings, key: str, value: str, word: str) -> PlanSettings:
    from orip.files.project.reader import parse_project

    known = [name for name in PlanSettings.__struct_fields__ if isinstance(getattr(settings, name), int | float)]
    if key not in {*known, *_HEIGHTS, "direction"}:
        message = f"--variant {word}: write KEY=VALUE; keys are: {', '.join([*known, *_CHANGES, 'control'])}"
        raise UsageError(message)
    text = f'project = {{ name = "V" }}\n[plan]\n{key} = {value}\n'
    parsed = parse_project(text)
    if parsed.complaints or parsed.value is None or parsed.value.definition.plan is None:
        message = f"--variant {word}: {'; '.join(fault.message for fault in parsed.complaints)}"
        raise UsageError(message)
    instead = dict.fromkeys(_HEIGHTS, None) if key in _HEIGHTS else {}
    return replace(settings, **{**instead, key: getattr(parsed.value.definition.plan, key)})


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
