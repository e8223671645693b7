"""Where control points, distances and further photos help most in a plan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.additions.placing import Placed, Wanted, place_in
from orip.bundle.solve import SolvedBlock
from orip.planning.designed import Given, design_of
from orip.planning.forecast import design_block, forecast
from orip.records.control import ControlPoint, Station
from orip.solving.solve import solve_bundle
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
    return solve_bundle(block_input(state))[1], state.project.definition.ground_unit


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
