"""Control points, distances, groups of observations and stereo models on the page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.groups.words import group_name, unit_of_group
from orip.bundle.results.figures import figure
from orip.records.coded_names import coded
from orip.records.names import places_of_names
from orip.records.observations.observation_kinds import CONSTANT_DISTANCE, CONTROL_POINT, DISTANCE
from orip.records.project.definition import BundleDefinition, StereoModel
from orip.records.results.result_tests import GroupTest
from orip.records.results.solution import Residuals, Solution
from orip.report.table import (
    MISSING,
    PageColumn,
    PageTable,
    decimals_of_most,
    deviation,
    fixed,
    probability,
    significant,
)

_AXES = ("X", "Y", "Z")
_DISTANCE_KINDS = (DISTANCE.name, CONSTANT_DISTANCE.name)


def control_differences(solution: Solution) -> dict[str, FloatArray]:
    """Return adjusted minus given coordinates (3,) of the control points, by name; NaN where one is not given."""
    residuals = solution.residuals
    return {
        name: np.array([residuals.residual[rows[axis]] if axis in rows else np.nan for axis in _AXES])
        for name, rows in _rows_of_points(solution).items()
    }


def check_differences(solution: Solution) -> dict[str, FloatArray]:
    """Return adjusted minus given coordinates (3,) of the check points, by name."""
    return {point.name: np.array([point.dX, point.dY, point.dZ]) for point in solution.check_points}


def control_table(solution: Solution) -> PageTable | None:
    """Return the control points; None where there are none."""
    points = _rows_of_points(solution)
    if not points:
        return None
    residuals, unit = solution.residuals, solution.ground_unit
    place = places_of_names(solution.points.names)
    errors = [residuals.a_priori[row] for rows in points.values() for row in rows.values()]
    decimals = decimals_of_most(np.abs(errors), 5)
    columns = [
        PageColumn("Point", list(points), words=True),
        PageColumn("Rays", [str(solution.point_rays[place[name]]) if name in place else "–" for name in points]),
    ]
    for axis in _AXES:
        cells = [_of(residuals.residual, rows, axis, decimals) for rows in points.values()]
        columns.append(PageColumn(f"d{axis}", cells, unit))
    for axis in _AXES:
        cells = [_of(residuals.a_priori, rows, axis, decimals) for rows in points.values()]
        columns.append(PageColumn(f"given sd {axis}", cells, unit))
    for number, axis in enumerate(_AXES):
        sd = [solution.points.sd[place[name], number] if name in place else np.nan for name in points]
        columns.append(PageColumn(f"sd {axis}", [deviation(value, decimals) for value in sd], unit))
    columns += [PageColumn(f"w{axis}", [_of(residuals.w, rows, axis, 2) for rows in points.values()]) for axis in _AXES]
    factors = residuals.weight_factor
    doubtful = frozenset(
        number
        for number, rows in enumerate(points.values())
        if not all(factors[row] >= 1.0 for row in rows.values())
    )  # fmt: skip
    marked = " Marked are points that lost weight or were left out." if doubtful else ""
    plan, height = (significant(figure(solution, f"control.rms_{part}")) for part in ("xy", "z"))
    note = (
        f"d: adjusted minus given; w: normalised residual. RMS {plan} {unit} in X and Y, {height} {unit} in Z.{marked}"
    )
    return PageTable("", "Control points", columns, note.strip(), doubtful)


def distance_table(solution: Solution) -> PageTable | None:
    """Return the measured distances; None where there are none."""
    residuals = solution.residuals
    rows = np.flatnonzero(coded(residuals.kind).where(lambda kind: kind in _DISTANCE_KINDS)).tolist()
    if not rows:
        return None
    unit, decimals = solution.ground_unit, decimals_of_most(np.abs(residuals.a_priori[rows]))
    adjusted = residuals.observed[rows] + residuals.residual[rows]
    columns = (
        PageColumn("Distance", [_ends(residuals, row) for row in rows], words=True),
        PageColumn("Measured", [fixed(residuals.observed[row], decimals) for row in rows], unit),
        PageColumn("Adjusted", [fixed(value, decimals) for value in adjusted.tolist()], unit),
        PageColumn("v", [fixed(residuals.residual[row], decimals) for row in rows], unit),
        PageColumn("given sd", [_a_priori(residuals, row, decimals) for row in rows], unit),
        PageColumn("w", [fixed(residuals.w[row], 2) for row in rows]),
    )
    doubtful = frozenset(number for number, row in enumerate(rows) if not residuals.weight_factor[row] >= 1.0)
    return PageTable("", "Distances", columns, "v: adjusted minus measured; w: normalised residual.", doubtful)


def _rows_of_points(solution: Solution) -> dict[str, dict[str, int]]:
    """Return the rows of the observed coordinates of control points, by point and axis."""
    residuals = solution.residuals
    is_control = coded(solution.point_kinds).where("control".__eq__)
    control = {solution.points.names[row] for row in np.flatnonzero(is_control).tolist()}
    found: dict[str, dict[str, int]] = {}
    used = coded(residuals.kind).where(CONTROL_POINT.name.__eq__) & ~np.isnan(residuals.weight_factor)
    for row in np.flatnonzero(used).tolist():
        name = residuals.point[row]
        if name in control:
            found.setdefault(name, {})[residuals.component[row]] = row
    return found


def _of(values: FloatArray, rows: Mapping[str, int], axis: str, decimals: int) -> str:
    return fixed(values[rows[axis]], decimals) if axis in rows else ""


def _ends(residuals: Residuals, row: int) -> str:
    return " ".join(part for part in (residuals.photo[row], residuals.point[row]) if part)


def _a_priori(residuals: Residuals, row: int, decimals: int) -> str:
    if residuals.kind[row] == CONSTANT_DISTANCE.name:
        return "exact"
    return fixed(residuals.a_priori[row], decimals)


Cell = StereoModel | None


def model_grid(bundle: BundleDefinition) -> tuple[tuple[int, ...], tuple[tuple[int, tuple[Cell, ...]], ...]]:
    """Return the columns' numbers, and for each row its number and the model in each column, None where there is none.

    Rows and columns without any model are left out.
    """
    columns = tuple(sorted({model.column for model in bundle.models}))
    rows = tuple(sorted({model.row for model in bundle.models}))
    at = {(model.row, model.column): model for model in bundle.models}
    return columns, tuple((row, tuple(at.get((row, column)) for column in columns)) for row in rows)


_NOTHING = 1e-6
"""Of the standard deviation of a mean: what rounding leaves of a mean that is zero."""

_NOTE = (
    "p: probability that chance alone gives residuals this large if the a-priori errors are right. Marked: "
    "significant for the number of groups tested. Mean: of the residuals, adjusted minus observed. Common error: an "
    "offset shared by all observations of the group, observed minus predicted from all other observations. Worst: the "
    "check point with the largest difference in units of its standard deviation."
)


def group_table(solution: Solution) -> PageTable | None:
    """Return the groups with their tests."""
    groups = solution.groups
    if not groups:
        return None
    columns = (
        PageColumn("Group", [group_name(group) for group in groups], words=True),
        PageColumn("Number", [str(group.number) for group in groups], key="number"),
        PageColumn("Redundancy", [significant(group.redundancy) for group in groups], key="redundancy"),
        PageColumn("sigma0", [significant(group.sigma0) for group in groups], key="sigma0"),
        PageColumn("p", [_p(group.p_sigma0) for group in groups]),
        *_estimated_errors(solution),
        PageColumn("Mean", [_with_sd(group.mean, group.mean_sd) for group in groups]),
        PageColumn("p", [_p(group.p_mean) for group in groups]),
        PageColumn("Common error", [_with_sd(group.shift, group.shift_sd) for group in groups]),
        PageColumn("Unit", [unit_of_group(group, solution.ground_unit) for group in groups], words=True),
        PageColumn("Worst", [_worst(group) for group in groups], words=True),
        PageColumn("p", [_p(group.p_worst) for group in groups]),
    )
    emphasised = frozenset(row for row, group in enumerate(groups) if group.doubted)
    return PageTable("groups", "Groups of observations", columns, _NOTE, emphasised)


def _estimated_errors(solution: Solution) -> Iterator[PageColumn]:
    """Yield the column of variance components, where they were estimated."""
    if not solution.variance_components:
        return
    found = []
    for group in solution.groups:
        # a component is estimated for x and y together, and for the stations of all strips
        of_group = (
            _with_sd(row.factor, row.sd)
            for row in solution.variance_components
            if row.kind == group.kind
            and row.of in {"", group.of}
            and group.component in (row.component or group.component)
        )
        found.append(next(of_group, MISSING))
    yield PageColumn("Estimated / given error", found)


def _p(value: float) -> str:
    return MISSING if math.isnan(value) else probability(value).removeprefix("= ")


def _with_sd(value: float, sd: float) -> str:
    text = significant(0.0 if abs(value) < _NOTHING * sd else value, 2)
    return text if text == MISSING else f"{text} ± {significant(sd, 2)}"


def _worst(group: GroupTest) -> str:
    return f"{group.worst}: {significant(group.worst_size, 2)}" if group.kind == "check" else MISSING
