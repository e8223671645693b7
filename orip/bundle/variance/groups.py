"""The groups of observations whose a-priori errors are estimated, and blocks with other a-priori errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, cast

import numpy as np
from msgspec import Struct

from orip.arrays import IntArray
from orip.bundle.groups.observation_groups import observation_groups
from orip.bundle.kinds.station_difference import with_difference_errors_times
from orip.bundle.solve import SolvedBlock
from orip.records.block import Block
from orip.records.control import ControlElement, ControlPoint, FigureKind, Station
from orip.records.observation_kinds import ANGULAR_UNKNOWNS
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.tests import VarianceGroupKind
from orip.structs import replace

_POSITION, _ROTATION = " ".join(PHOTO_PARAMETERS[:3]), " ".join(PHOTO_PARAMETERS[3:])

_OF_FIGURES: dict[FigureKind, VarianceGroupKind] = {
    "LINE": "line", "PLANE": "plane", "CYLINDER": "cylinder", "HEIGHT": "height"
}  # fmt: skip


class VarianceGroup(NamedTuple):
    """Observations whose a-priori errors have one factor, a `VarianceComponent` of the results."""

    kind: VarianceGroupKind
    of: str = ""
    component: str = ""


class GroupRows(Struct, frozen=True):
    """A group with the observation equations (n,) of its observations with full weight."""

    group: VarianceGroup
    rows: IntArray


def variance_groups(solved: SolvedBlock) -> tuple[GroupRows, ...]:
    """Return the groups of a block's observations that are in use and have full weight, in the order of the kinds."""
    members: dict[VarianceGroup, list[IntArray]] = {}
    for part in observation_groups(solved, ()):
        kind = cast(VarianceGroupKind, part.kind)
        of = "" if kind in ("station", "attitude") else part.of
        group = VarianceGroup(kind, of, _common_component(kind, of, part.component))
        members.setdefault(group, []).append(part.rows[solved.weight_factors[part.rows] >= 1.0])
    return tuple(GroupRows(group, np.sort(np.concatenate(rows))) for group, rows in members.items())


def _common_component(kind: VarianceGroupKind, of: str, component: str) -> str:
    match kind:
        case "photo":
            return "xy"
        case "control":
            return "Z" if component == "Z" else "XY"
        case "element" if of == "PHOTO":
            return _ROTATION if component in ANGULAR_UNKNOWNS else _POSITION
        case "difference":
            return _ROTATION if component in ANGULAR_UNKNOWNS else _POSITION
        case "direction":
            return component
        case _:
            return ""


def with_errors_times(block: Block, factors: Mapping[VarianceGroup, float]) -> Block:
    """Return a block whose a-priori errors are multiplied by a factor for each group; groups not named keep theirs.

    Errors of 0 (constant) and negative ones (compared only) stay.
    """

    def factor(kind: VarianceGroupKind, of: str = "", component: str = "") -> float:
        return factors.get(VarianceGroup(kind, of, component), 1.0)

    cameras = np.array([factor("photo", camera.name, "xy") for camera in block.cameras])
    points = block.photo_points
    error = points.error * cameras[block.photo_camera[points.photo]][:, None]
    level, height = factor("control", component="XY"), factor("control", component="Z")
    return replace(
        block,
        photo_points=replace(points, error=error),
        control_points=tuple(_with_errors(point, (level, level, height)) for point in block.control_points),
        elements=tuple(
            replace(element, error=_times(element.error, factor("element", element.group, _of_element(element))))
            for element in block.elements
        ),
        distances=tuple(replace(line, error=_times(line.error, factor("distance"))) for line in block.distances),
        given_directions=tuple(
            replace(line, error=_times(line.error, factor("given direction"))) for line in block.given_directions
        ),
        terrain_heights=tuple(
            replace(one, error=_times(one.error, factor("terrain", one.terrain))) for one in block.terrain_heights
        ),
        figure_points=tuple(
            replace(point, error=_times(point.error, factor(_OF_FIGURES[point.kind]))) for point in block.figure_points
        ),
        stations=tuple(
            _with_station_errors(station, factor("station"), factor("attitude")) for station in block.stations
        ),
        differences=tuple(
            with_difference_errors_times(
                line, factor("difference", component=_POSITION), factor("difference", component=_ROTATION)
            )
            for line in block.differences
        ),
        directions=tuple(
            replace(
                line,
                direction_error=_times(line.direction_error, factor("direction", component="direction")),
                zenith_error=None
                if line.zenith_error is None
                else _times(line.zenith_error, factor("direction", component="zenith")),
            )
            for line in block.directions
        ),
    )


def _of_element(element: ControlElement) -> str:
    return _common_component("element", element.group, element.kind)


def _with_errors(point: ControlPoint, factors: tuple[float, float, float]) -> ControlPoint:
    x, y, z = (
        None if error is None else _times(error, factor) for error, factor in zip(point.errors, factors, strict=True)
    )
    return replace(point, errors=(x, y, z))


def _with_station_errors(station: Station, of_position: float, of_attitude: float) -> Station:
    x, y, z = (_times(error, of_position) for error in station.position_error)
    omega, phi, kappa = (_times(error, of_attitude) for error in station.angle_error)
    covariance = station.covariance
    if covariance is not None:
        factors = np.repeat([of_position, of_attitude], 3)[: len(covariance)]
        covariance = tuple(map(tuple, (np.array(covariance) * np.outer(factors, factors)).tolist()))
    return replace(station, position_error=(x, y, z), angle_error=(omega, phi, kappa), covariance=covariance)


def _times(error: float, factor: float) -> float:
    return error * factor if error > 0.0 else error
