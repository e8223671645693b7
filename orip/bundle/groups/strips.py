"""Strips of exposure stations: what a shift or a drift common to the stations of a strip does to their observations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.groups.observation_groups import ObservationGroup
from orip.bundle.kinds.station_position import PositionObservations
from orip.bundle.solve import SolvedBlock
from orip.records.names import record_key
from orip.records.project.antenna import LEVER_ARM
from orip.records.results.group_test import CommonExtent

STATIONS = ("station", "attitude")
"""Kinds of group whose observations belong to strips."""

_LEAST_FOR_DRIFT = 3
"""Stations of a strip that a drift can be told from its shift and from single wrong stations with."""

_AGREE = 5.0
"""A-priori errors, or robust deviations, from the common error of a strip within which a station agrees with it."""

_DEVIATION = 1.4826
"""Standard deviation of normal errors over the median of their sizes."""


class Strip(Struct, frozen=True):
    """The groups of a strip, one of each component: their numbers, and whether times allow a drift to be told."""

    groups: tuple[int, ...]
    has_drift: bool


class AllStations(Struct, frozen=True):
    """An error common to the stations of all strips: the numbers of their groups, and its components.

    Its extent is "all" for a shift along the project's axes, "lever arm" for one along the axes of the photos.
    """

    groups: tuple[int, ...]
    components: tuple[str, ...]
    extent: CommonExtent


class StripErrors(Struct, frozen=True):
    """Errors common to the stations of strips; of k observation equations and g groups.

    Parameters
    ----------
    strips : tuple of Strip
    errors, factors : arrays (k, g + drifts + components of all stations)
        An error of one unit common to each group, divided by the a-priori errors, and what its residuals are multiplied
        by before they are summed up; then, strip by strip, a drift of one unit a second of each of its groups; then
        errors of one unit common to all stations.
    together : tuple of AllStations
    """

    strips: tuple[Strip, ...]
    errors: FloatArray
    factors: FloatArray
    together: tuple[AllStations, ...] = ()


def strip_errors(
    solved: SolvedBlock, groups: Sequence[ObservationGroup], residual: FloatArray, error: FloatArray,
    errors: FloatArray, factors: FloatArray,
) -> StripErrors:  # fmt: skip
    """Return the errors and factors (k, g) of groups with those of strips, whose stations keep their full weights.

    Stations that are all off lose their weights together, and would say nothing of their common error.

    Parameters
    ----------
    solved : SolvedBlock
    groups : sequence of ObservationGroup
        Their observations make up the k equations, one group after the other.
    residual, error : arrays (n,)
        Residuals of all equations of the block, divided by their a-priori errors, and these.
    errors, factors : arrays (k, g)
    """
    members: dict[tuple[str, str], list[int]] = {}
    for number, group in enumerate(groups):
        if group.kind in STATIONS:
            members.setdefault((group.kind, group.of), []).append(number)
    rows = np.concatenate([np.zeros(0, dtype=np.int64), *(group.rows for group in groups)])
    ends = np.cumsum([0, *(len(group.rows) for group in groups)])
    time_of = {record_key(station.photo): station.time for station in solved.block.stations}
    errors, factors = _with_correlations(solved, groups, rows, errors), factors.copy()
    agrees, elapsed = np.zeros(len(rows)), np.zeros(len(rows))
    strips, drifts = [], [errors[:, :0]]
    for numbers in members.values():
        with_drift = True
        for number in numbers:
            group, mine = groups[number], slice(ends[number], ends[number + 1])
            time = np.array([time_of[record_key(name)] for name in group.names])
            own = error[group.rows]
            agrees[mine] = _agreeing(residual[group.rows] * own, own, time)
            with_drift &= _tells_drift(time)
            elapsed[mine] = time - time.mean() if _tells_drift(time) else 0.0
        strips.append(Strip(tuple(numbers), with_drift))
        factors[:, numbers] = agrees[:, None] * errors[:, numbers]
        if with_drift:
            drifts.append(elapsed[:, None] * errors[:, numbers])
    together, of_all = _of_all_stations(solved, groups, errors)
    more = np.hstack([*drifts, *of_all])
    return StripErrors(
        tuple(strips), np.hstack([errors, more]), np.hstack([factors, agrees[:, None] * more]), tuple(together)
    )


def _of_all_stations(
    solved: SolvedBlock, groups: Sequence[ObservationGroup], errors: FloatArray
) -> tuple[list[AllStations], list[FloatArray]]:
    """Return the errors that the stations of all strips may have in common, and those of one unit (k, components)."""
    found, columns = [], []
    for kind in STATIONS:
        numbers = tuple(number for number, group in enumerate(groups) if group.kind == kind)
        components = tuple(dict.fromkeys(groups[number].component for number in numbers))
        of_component = [
            errors[:, [number for number in numbers if groups[number].component == name]].sum(axis=1)
            for name in components
        ]
        if len({groups[number].of for number in numbers}) > 1:
            found.append(AllStations(numbers, components, "all"))
            columns.append(np.column_stack(of_component))
        if kind == "station" and components == tuple("XYZ"):
            found.append(AllStations(numbers, LEVER_ARM, "lever arm"))
            turned = np.einsum("kj,kja->ka", np.column_stack(of_component), _axes_of_photos(solved, groups))
            columns.append(turned)
    return found, columns


def _axes_of_photos(solved: SolvedBlock, groups: Sequence[ObservationGroup]) -> FloatArray:
    """Return the axes (k, 3, 3) of each equation's photo in the project, as columns; zeros where none is concerned."""
    block, state = solved.block, solved.state
    axes = block.ground.axes_at(block.ground.to_project(state.centres)) @ state.rotations
    of_photo = {record_key(photo.name): row for row, photo in enumerate(block.photos)}
    parts = [
        axes[[of_photo[record_key(name)] for name in group.names]]
        if group.kind == "station"
        else np.zeros((len(group.rows), 3, 3))
        for group in groups
    ]
    return np.concatenate(parts)


def _with_correlations(
    solved: SolvedBlock, groups: Sequence[ObservationGroup], rows: IntArray, errors: FloatArray
) -> FloatArray:
    """Return the errors (k, g) with what an error of a coordinate does to the decorrelated equations of the others."""
    found, first = errors.copy(), 0
    place = dict(zip(rows.tolist(), range(len(rows)), strict=True))
    for kind in solved.problem.observations:
        if isinstance(kind, PositionObservations) and (kind.whitening != np.eye(3)).any():
            for number, group in enumerate(groups):
                if group.kind != "station":
                    continue
                whitening = kind.whitening[kind.station, kind.axis, "XYZ".index(group.component)] / kind.rows.error
                names = set(group.names)
                for row, photo in enumerate(kind.rows.photo):
                    if photo in names and first + row in place:
                        found[place[first + row], number] = whitening[row]
        first += len(kind.rows.error)
    return found


def _tells_drift(time: FloatArray) -> bool:
    return bool(len(time) >= _LEAST_FOR_DRIFT and np.isfinite(time).all() and np.ptp(time) > 0.0)


def _agreeing(residual: FloatArray, error: FloatArray, time: FloatArray) -> BoolArray:
    """Return which stations (n,) have the error that most of their strip have in common, or its drift.

    A single wrong station is no error of its strip.
    """
    rest = residual - np.median(residual)
    if len(rest) > _LEAST_FOR_DRIFT and _tells_drift(time):
        first, second = np.triu_indices(len(time), 1)
        apart = time[second] != time[first]
        slopes = (residual[second] - residual[first])[apart] / (time[second] - time[first])[apart]
        rest = residual - float(np.median(slopes)) * time
        rest -= np.median(rest)
    usual = _DEVIATION * float(np.median(np.abs(rest)))
    return np.asarray(np.abs(rest) <= _AGREE * np.maximum(error, usual))
