"""The observations of a block in groups that may be wrong together: by kind, component, camera, axis and strip."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array

from orip.adjustment.residual_sums import RowsUnderTest
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.kinds.observation import Observations
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.kinds.station_attitude import AttitudeObservations
from orip.bundle.solve import SolvedBlock
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.definition import LEVER_ARM
from orip.records.names import record_key
from orip.records.observation_kinds import (
    ATTITUDE,
    CONTROL_POINT,
    CYLINDER,
    DIFFERENCE,
    DIRECTION,
    DISTANCE,
    ELEMENT,
    GIVEN_DIRECTION,
    HEIGHT,
    LINE,
    PLANE,
    STATION,
    TERRAIN,
)
from orip.records.results.tests import CommonExtent, GroupKind
from orip.threads import limited_threads

_KINDS: dict[str, GroupKind] = {
    CONTROL_POINT.name: "control",
    ELEMENT.name: "element",
    DISTANCE.name: "distance",
    DIRECTION.name: "direction",
    LINE.name: "line",
    PLANE.name: "plane",
    CYLINDER.name: "cylinder",
    HEIGHT.name: "height",
    GIVEN_DIRECTION.name: "given direction",
    TERRAIN.name: "terrain",
    STATION.name: "station",
    ATTITUDE.name: "attitude",
    DIFFERENCE.name: "difference",
}
"""Additional parameters and constants that are met exactly were not measured."""


class ObservationGroup(Struct, frozen=True):
    """Observations of one kind and component; see `orip.records.results.tests.GroupTest`.

    Parameters
    ----------
    rows : array (n,) of int
        Among all observation equations.
    names : tuple of str, length n
        Of the points, photos or distances; empty for photo points.
    """

    kind: GroupKind
    of: str
    component: str
    rows: IntArray
    names: tuple[str, ...] = ()


def observation_groups(solved: SolvedBlock, check_points: Collection[str]) -> tuple[ObservationGroup, ...]:
    """Return the groups of a block's observations in use, and of its check points, in the order of the kinds.

    Parameters
    ----------
    check_points : collection of str
        Names of the points whose given coordinates are compared with the adjusted ones.
    """
    groups: list[ObservationGroup] = []
    checks: list[ObservationGroup] = []
    strips = {record_key(station.photo): station.strip for station in solved.block.stations}
    first = 0
    for kind in solved.problem.observations:
        count = len(kind.rows.error)
        active = solved.equations.active[first : first + count]
        if isinstance(kind, PhotoPointObservations):
            groups += _of_photo_points(kind, solved, active, first)
        elif kind.rows.kind.name in _KINDS:
            groups += _of_kind(kind, active, _KINDS[kind.rows.kind.name], first, strips)
            if kind.rows.kind == CONTROL_POINT:
                compared = np.array([name in check_points for name in kind.rows.point], dtype=bool)
                checks += _of_kind(kind, compared & ~kind.rows.used, "check", first, {})
        first += count
    return (*groups, *checks)


def _of_photo_points(
    kind: PhotoPointObservations, solved: SolvedBlock, active: BoolArray, first: int
) -> Iterator[ObservationGroup]:
    for index, camera in enumerate(solved.block.cameras):
        for place, component in enumerate("xy"):
            rows = np.flatnonzero((kind.camera == index) & active[place::2])
            if len(rows):
                rows *= 2
                rows += first + place
                yield ObservationGroup("photo", camera.name, component, rows)


def _of_kind(
    kind: Observations, chosen: BoolArray, group: GroupKind, first: int, strips: Mapping[str, str]
) -> Iterator[ObservationGroup]:
    rows = kind.rows
    members: dict[tuple[str, str], list[int]] = {}
    for row in np.flatnonzero(chosen).tolist():
        of = strips.get(record_key(rows.photo[row]), "") if group in ("station", "attitude") else ""
        if group == "terrain":
            of = rows.photo[row]
        elif group == "element":
            of = _record_of_element(rows.photo[row], rows.component[row])
        members.setdefault((of, rows.component[row]), []).append(row)
    for (of, component), places in members.items():
        names = tuple(rows.point[row] or rows.photo[row] for row in places)
        yield ObservationGroup(group, of, component, first + np.array(places, dtype=np.int64), names)


def _record_of_element(photo: str, component: str) -> str:
    if photo:
        return "PHOTO"
    if component in ("X", "Y", "Z"):
        return "POINT"
    return "CAMERA" if component in CAMERA_PARAMETERS else "THEODOLITE"


_MANY = 8
"""Right-hand sides of which so many times the number makes that of the unknowns: more are likely to come."""

_LARGEST = 4_000_000
"""Numbers that computing the cofactors may take: one for each of the unknowns (c,) and each of the reduced ones."""


def rows_under_test(
    solved: SolvedBlock, rows: IntArray, weight: FloatArray, others_variance: float = 1.0
) -> RowsUnderTest:
    """Return observation equations (k,) with the unknowns that they depend on; none may be of photo points.

    Parameters
    ----------
    rows : array (k,) of int
        Among all observation equations.
    weight, others_variance
        As of `RowsUnderTest`.
    """
    design = solved.ground_design(rows)
    columns = np.unique(design.indices).astype(np.int64)
    residual, inverse = solved.equations.residual[rows], _inverse_of(solved, columns)
    return RowsUnderTest(csr_array(design[:, columns]), columns, residual, weight, inverse, others_variance)


def _inverse_of(solved: SolvedBlock, columns: IntArray) -> Callable[[FloatArray], FloatArray]:
    """Return what multiplies right-hand sides (c, j) by the cofactors of some unknowns (c,), in ascending order.

    Where many right-hand sides are asked for, as for tests of single residuals, the cofactors are computed, and kept.
    """
    kept: list[FloatArray] = []
    is_small = len(columns) * len(solved.normals.scale) <= _LARGEST

    def solve(right: FloatArray) -> FloatArray:
        with limited_threads(None):
            if not kept and is_small and _MANY * right.shape[1] > len(columns):
                kept.append(solved.normals.inverse_at(columns))
            return kept[0] @ right if kept else solved.normals.solve_at(columns, right)

    return solve


MOST_EXACT, _MOST_EXACT_IN_ALL = 150, 3000
"""Most residuals of a group whose square sum is tested with their covariances, and of all such groups together, the
smallest first: their number times the size of the block is what that takes. Of more it is nearly chi-square, and varies
less."""


def largest_exact(sizes: Sequence[int]) -> int:
    """Return up to which size the square sums of groups of these sizes are tested with covariances."""
    of_exact = np.sort(np.array([size for size in sizes if size <= MOST_EXACT], dtype=np.int64))
    beyond = of_exact[np.cumsum(of_exact) > _MOST_EXACT_IN_ALL]
    return int(beyond[0]) - 1 if len(beyond) else MOST_EXACT


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
    errors, factors : arrays (k, g + drifts + components of all stations)
        An error of one unit common to each group, divided by the a-priori errors, and what its residuals are multiplied
        by before they are summed up; then, strip by strip, a drift of one unit a second of each of its groups; then
        errors of one unit common to all stations.
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
    factors = factors.copy()
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


def with_correlations(solved: SolvedBlock, rows: IntArray, errors: FloatArray) -> FloatArray:
    """Return the errors (k, g) with what an error of an observation does to the decorrelated equations of others."""
    found, first = errors.copy(), 0
    place = np.full(len(solved.equations.residual), -1)
    place[rows] = np.arange(len(rows))
    of_positions = errors[:0]
    for kind in solved.problem.observations:
        at = place[first : first + len(kind.rows.error)]
        for correlated in kind.correlations():
            there = np.flatnonzero(at[correlated.rows] >= 0)
            own = at[correlated.rows[there]]
            found[own] = correlated.whitening[np.ix_(there, there)] @ errors[own]
        if kind.rows.kind is STATION:
            of_positions = _in_units(kind, at, errors)
        elif isinstance(kind, AttitudeObservations) and kind.is_mixed:
            mixed = kind.decorrelated(_in_units(kind, at, errors), of_positions) / kind.rows.error[:, None]
            found[at[at >= 0]] = mixed[at >= 0]
        first += len(at)
    return found


def _in_units(kind: Observations, at: IntArray, errors: FloatArray) -> FloatArray:
    """Return the errors (n, g) of a kind's observations in their units; zeros of those that no row is of."""
    found, there = np.zeros((len(at), errors.shape[1])), np.flatnonzero(at >= 0)
    found[there] = errors[at[there]] * kind.rows.error[there, None]
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
