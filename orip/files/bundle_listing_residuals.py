"""The residuals in a bundle listing: largest ones, control and other ground observations, photo by photo."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from orip.files.bundle_listing_estimates import CAMERA_UNITS
from orip.files.number_text import decimals_for, fixed, measure, root_mean_square
from orip.files.text_table import Column, Table, table_lines, xy_columns
from orip.model.measurement import IntArray, PhotoObservations
from orip.model.names import record_key
from orip.model.solution import FloatArray, Reliability, Residuals, Solution

LARGEST = 10
"""So many of the largest standard residuals stand at the front of the listing."""

ANGLES = frozenset({"OMEGA", "PHI", "KAPPA", "R"})

GROUND_COORDINATES = frozenset({"X0", "Y0", "Z0", "X", "Y", "Z"})

LEGEND = [
    "",
    "  a = a-priori error, v = residual (adjusted minus observed), SR = standard residual (v against a),",
    "  SD = standard deviation of the adjusted observation,",
    "  WF = weight factor (below 1: down-weighted, '-': disregarded), r = redundancy number, w = normalised residual",
]
"""What the headings of the tables of residuals mean."""

PHOTO_LEGEND = [
    "",
    "  X-template, Y-template = measured coordinates (of a photo off a template: plate coordinates or pixels).",
    "  Along the photo axes: WX, WY = a-priori error, X_residual, Y_residual = adjusted minus observed,",
    "  SD = standard deviation of the adjusted observation, WF = weight factor (below 1: down-weighted,",
    "  '-': disregarded), SR = standard residual, r = redundancy number, w = normalised residual",
]

AXES = {"x": 0, "y": 1, "X": 0, "Y": 1}
"""Column of a photo component."""

PhotoRow = tuple[str, str, int, int]
"""Photo, point, and the rows of its x and y components in the residuals; -1 for one that is missing."""


def unit_of(kind: str, component: str, ground_unit: str) -> str:
    """Return the unit of an observation component; empty for a pure number."""
    if kind == "photo":
        return "mm"
    if kind == "direction" or component in ANGLES:
        return "degrees"
    if kind == "element" and component not in GROUND_COORDINATES:
        return CAMERA_UNITS.get(component, "")
    return ground_unit


def component_columns(residuals: Residuals, rows: Sequence[int], ground_unit: str) -> list[Column]:
    """Return the columns of a table with one observation component a row, of any kinds."""
    kinds = [residuals.kind[i] for i in rows]
    components = [residuals.component[i] for i in rows]
    units = [unit_of(kind, component, ground_unit) for kind, component in zip(kinds, components, strict=True)]
    index = np.array(rows, dtype=np.int64)
    columns = [
        Column("Kind", kinds, align="left"),
        Column("Photo", [residuals.photo[i] for i in rows], align="left"),
        Column("Point or name", [residuals.point[i] for i in rows], align="left"),
        Column("Component", components, align="left"),
        Column("Observed", [measure(residuals.observed[i], residuals.a_priori[i]) for i in rows], align="point"),
        Column("a", [measure(residuals.a_priori[i], residuals.a_priori[i]) for i in rows], align="point"),
        Column("v", [measure(residuals.residual[i], residuals.a_priori[i]) for i in rows], align="point"),
        Column("Unit", units, align="left"),
        Column("SR", fixed(residuals.standard_residual[index], 2)),
        Column("WF", fixed(residuals.weight_factor[index], 3)),
        Column("r", fixed(residuals.redundancy_number[index], 3)),
        Column("w", fixed(residuals.w[index], 2)),
    ]
    # a column without a single entry, such as the photo of control points, only takes room
    return [column for column in columns if any(column.cells) or column.heading != "Photo"]


def largest_residual_lines(solution: Solution) -> list[str]:
    """Return the table of the largest standard residuals of observations that have an influence."""
    residuals = solution.residuals
    size = np.where(np.isfinite(residuals.weight_factor), np.abs(residuals.standard_residual), np.nan)
    order = np.argsort(-np.nan_to_num(size, nan=-1.0, posinf=np.inf), kind="stable")[:LARGEST]
    rows = [i for i in order.tolist() if not np.isnan(size[i])]
    lines = table_lines(component_columns(residuals, rows, solution.ground_unit))
    return [*lines, *LEGEND] if residuals.kind else lines


def ground_residual_lines(solution: Solution, choose: Callable[[str], bool]) -> list[str]:
    """Return the table of the observations whose kind is chosen, one component a row."""
    residuals = solution.residuals
    rows = [i for i, kind in enumerate(residuals.kind) if choose(kind)]
    return table_lines(component_columns(residuals, rows, solution.ground_unit))


def photo_residual_lines(solution: Solution, reliability: Reliability, measured: PhotoObservations) -> list[str]:
    """Return a table of photo residuals for each photo; the columns are equally wide in all of them.

    Parameters
    ----------
    solution : Solution
    reliability : Reliability
    measured : PhotoObservations
        Those that were adjusted, for their measured coordinates; what is not among them has none.
    """
    rows = _photo_rows(solution)
    if not rows:
        return ["  none"]
    residuals = solution.residuals
    parts = np.array([row[2:] for row in rows], dtype=np.int64)
    influential = np.where(np.isfinite(residuals.weight_factor), residuals.residual, np.nan)
    influential = np.append(influential, np.nan)[parts]
    columns = [
        Column("Point", [row[1] for row in rows], align="left"),
        *xy_columns("{}-template", _measured_at(rows, measured), 4, "mm, px"),
        *_photo_columns(residuals, reliability, parts),
    ]
    table = Table(columns)
    lines = [*PHOTO_LEGEND]
    start = 0
    for photo, group in itertools.groupby(rows, key=lambda row: row[0]):
        stop = start + sum(1 for _ in group)
        lines += ["", f"  Photo {photo}:  {_quality(influential[start:stop])}", "", *table.headings()]
        lines += table.rows(start, stop)
        start = stop
    return lines


def _photo_rows(solution: Solution) -> list[PhotoRow]:
    residuals = solution.residuals
    pairs: dict[str, list[tuple[str, list[int]]]] = {photo: [] for photo in solution.photos.names}
    open_pairs: dict[tuple[str, str], list[int]] = {}
    for i, kind in enumerate(residuals.kind):
        if kind != "photo":
            continue
        photo, point = residuals.photo[i], residuals.point[i]
        axis = AXES[residuals.component[i]]
        pair = open_pairs.get((photo, point))
        if pair is None or pair[axis] >= 0:  # a component met again belongs to another measurement of the point
            pair = open_pairs[photo, point] = [-1, -1]
            pairs.setdefault(photo, []).append((point, pair))
        pair[axis] = i
    return [(photo, point, pair[0], pair[1]) for photo, points in pairs.items() for point, pair in points]


def _measured_at(rows: Sequence[PhotoRow], measured: PhotoObservations) -> FloatArray:
    """Return the measured coordinates of each row (n, 2), NaN where there are none."""
    keys = zip(map(record_key, measured.photos), measured.points, strict=True)
    place = {key: i for i, key in enumerate(keys)}
    padded = np.vstack([measured.measured, [np.nan, np.nan]])  # row -1, of no measurement, reads NaN
    return padded[[place.get((record_key(photo), point), -1) for photo, point, _, _ in rows]]


def _photo_columns(residuals: Residuals, reliability: Reliability, parts: IntArray) -> list[Column]:
    # millimetres: one decimal less for the error than for the residual, as instruments read out
    decimals = decimals_for(np.abs(residuals.a_priori[parts[parts >= 0]]) / 10.0, 5, 6)

    def of_parts(values: FloatArray) -> FloatArray:
        return np.append(values, np.nan)[parts]  # row -1, the missing component, reads NaN

    return [
        *xy_columns("W{}", of_parts(residuals.a_priori), decimals - 1, "mm"),
        *xy_columns("{}_residual", of_parts(residuals.residual), decimals, "mm"),
        *xy_columns("SD {}", of_parts(reliability.adjusted_sd), decimals - 1, "mm"),
        *xy_columns("{} WF", of_parts(residuals.weight_factor), 2),
        *xy_columns("SR {}", of_parts(residuals.standard_residual), 2),
        *xy_columns("r {}", of_parts(residuals.redundancy_number), 2),
        *xy_columns("w {}", of_parts(residuals.w), 2),
    ]


def _quality(influential: FloatArray) -> str:
    count = len(influential)
    text = f"{count} {'points' if count > 1 else 'point'}"
    if np.isnan(influential).all():
        return text
    means = [root_mean_square(influential[:, k]) for k in range(2)]
    return text + ",  RMS of X_residual {} and Y_residual {} mm".format(*fixed(means, 5))
