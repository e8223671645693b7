"""Control points, distances, groups of observations and stereo models on the page."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.groups.words import group_name, unit_of_group
from orip.bundle.results.compared_points import AXES, ComparedKind, ComparedPoints, image_residuals
from orip.number_text import root_mean_square
from orip.records.coded_names import coded
from orip.records.definition import BundleDefinition, StereoModel
from orip.records.observation_kinds import CONSTANT_DISTANCE, DISTANCE
from orip.records.results.solution import Residuals, Solution
from orip.records.results.tests import GroupTest
from orip.report.report_input import ReportInput
from orip.report.table import (
    MISSING,
    PageColumn,
    PageTable,
    decimals_of_most,
    deviation,
    fixed,
    length_unit,
    probability,
    significant,
)

_DISTANCE_KINDS = (DISTANCE.name, CONSTANT_DISTANCE.name)


_CAPTIONS = {"control": "Control points", "check": "Check points"}
_MEANING = (
    "d: adjusted minus given; sd: standard deviation of the adjusted coordinate; given sd: a-priori error of the given "
    "one"
)


def compared_table(given: ReportInput, kind: ComparedKind, rows: IntArray | None = None) -> PageTable | None:
    """Return the control points, or the check points, all with the same columns; None where there are none.

    `rows` are those to be shown, all if not given; the root mean squares in the foot are those of all.
    """
    whole = given.compared[kind]
    if not len(whole):
        return None
    points = whole if rows is None else whole.part(rows)
    unit = length_unit([points.difference, points.sd], given.solution.ground_unit)
    precise = decimals_of_most(np.array([points.sd, points.given_sd]) * unit.factor)
    if unit.name != given.solution.ground_unit:
        precise = max(precise, 1)  # a difference of a few millimetres has two figures too

    def of(values: FloatArray, text: Callable[[float, int], str] = fixed) -> list[str]:
        return [text(value, precise) for value in (values * unit.factor).tolist()]

    rms = of(whole.rms)
    columns = [
        PageColumn(
            "Point",
            points.names,
            key="name" if kind == "check" else "",
            words=True,
            foot="RMS",
            links={name: given.place(point=name) for name in points.names},
        ),
        PageColumn("Rays", [str(rays) for rays in points.rays]),
    ]
    for axis, name in enumerate(AXES):
        columns.append(PageColumn(f"d{name}", of(points.difference[:, axis]), unit.name, foot=rms[axis]))
    for axis, name in enumerate(AXES):
        columns.append(PageColumn(f"sd {name}", of(points.sd[:, axis], deviation), unit.name))
    columns.append(PageColumn("Given sd", [_alike(of(row)) for row in points.given_sd], unit.name))
    for axis, name in enumerate(AXES):
        foot = fixed(root_mean_square(whole.w[:, axis]), 2)
        columns.append(PageColumn(f"w{name}", [fixed(value, 2) for value in points.w[:, axis].tolist()], foot=foot))
    columns.append(_image_column(given, points))
    records = "check_points" if kind == "check" else ""
    note = _note(points)
    if len(points) < len(whole):
        note += f" The {len(points)} of {len(whole)} with the largest w are shown; RMS is that of all."
    return PageTable(records, _CAPTIONS[kind], columns, note, frozenset(np.flatnonzero(points.doubted)))


def _alike(errors: Sequence[str]) -> str:
    """Return the given errors in X, Y, Z as one, two (plan and height) or three figures."""
    x, y, z = errors
    if x == y:
        return x if y == z else f"{x} / {z}"
    return " / ".join(errors)


def _image_column(given: ReportInput, points: ComparedPoints) -> PageColumn:
    """Return the residuals of the points in the photos, in pixels where all photos were measured in them."""
    pixel = given.pixel_of_rows
    in_pixels = image_residuals(given.solution, points.names, pixel)
    whole = bool(np.array_equal(np.isnan(in_pixels), np.isnan(points.image))) and np.isfinite(in_pixels).any()
    sizes, unit, decimals = (in_pixels, "px", 2) if whole else (1e3 * points.image, "µm", 1)
    cells = [fixed(value, decimals) for value in sizes.tolist()]
    return PageColumn("In the photos", cells, unit, foot=fixed(root_mean_square(sizes), decimals))


def _note(points: ComparedPoints) -> str:
    image = "In the photos: RMS of the residuals x and y of its rays."
    if points.kind == "check":
        return f"{_MEANING}, which had no influence; w: the size of d over its standard deviation, from both. {image}"
    marked = " Marked are points that lost weight or were left out." if points.doubted.any() else ""
    return f"{_MEANING}; w: normalised residual. {image}{marked}"


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
