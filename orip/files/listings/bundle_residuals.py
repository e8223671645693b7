"""The residuals in a bundle listing: largest ones, control and other ground observations, photo by photo."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.files.text.table import Column, FixedCells, Table, table_lines, xy_pair
from orip.number_text import decimals_for, fixed, measure, root_mean_square
from orip.records.coded_names import coded
from orip.records.measurement import PhotoObservations
from orip.records.names import record_key
from orip.records.observation_kinds import measurement_name, observed_before, unit_of_observation
from orip.records.results.solution import Reliability, Residuals, Solution
from orip.wording import counted

LARGEST = 10
"""Number of the largest standard residuals that are listed first."""

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

Names = NDArray[Any]
"""Names as objects, shape (n,)."""

AXES = {"x": 0, "y": 1, "X": 0, "Y": 1}
"""Column of a photo component."""


class PhotoRows(NamedTuple):
    """The lines of the tables of photo residuals, photo by photo.

    Attributes
    ----------
    photos : tuple of (str, int)
        Each photo and how many lines it has.
    points : sequence of str, length n
    parts : array (n, 2) of int
        Rows of the x and y components in the residuals; -1 for one that is missing.
    """

    photos: tuple[tuple[str, int], ...]
    points: Sequence[str]
    parts: IntArray


def component_columns(residuals: Residuals, rows: Sequence[int], ground_unit: str) -> list[Column]:
    """Return the columns of a table with one observation component a row, of any kinds."""
    kinds = [residuals.kind[i] for i in rows]
    components = [residuals.component[i] for i in rows]
    units = [
        unit_of_observation(kind, component, ground_unit) for kind, component in zip(kinds, components, strict=True)
    ]
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
    rows = _largest(np.nan_to_num(size, nan=-1.0, posinf=np.inf))
    rows = [i for i in rows if not np.isnan(size[i])]
    lines = table_lines(component_columns(residuals, rows, solution.ground_unit))
    return [*lines, *LEGEND] if residuals.kind else lines


def _largest(sizes: FloatArray) -> list[int]:
    """Return the rows of the `LARGEST` sizes, the largest first; of equal ones those that come first."""
    candidates = np.arange(len(sizes))
    if len(sizes) > LARGEST:
        candidates = np.flatnonzero(sizes >= np.partition(sizes, -LARGEST)[-LARGEST])
    order = np.argsort(-sizes[candidates], kind="stable")[:LARGEST]
    return list(map(int, candidates[order]))


def ground_residual_lines(solution: Solution, choose: Callable[[str], bool]) -> list[str]:
    """Return the table of the observations whose kind is chosen, one component a row."""
    residuals = solution.residuals
    rows = np.flatnonzero(coded(residuals.kind).where(choose)).tolist()
    return table_lines(component_columns(residuals, rows, solution.ground_unit))


def photo_residual_lines(solution: Solution, reliability: Reliability, measured: PhotoObservations) -> Iterator[str]:
    """Yield a table of photo residuals for each photo; the columns are equally wide in all of them.

    Parameters
    ----------
    measured : PhotoObservations
        Those that were adjusted, for their measured coordinates; what is not among them has none.
    """
    rows = _photo_rows(solution)
    if not rows.photos:
        yield "  none"
        return
    residuals = solution.residuals
    influential = np.where(np.isfinite(residuals.weight_factor), residuals.residual, np.nan)
    influential = np.append(influential, np.nan)
    at = _measured_at(rows, measured)
    coordinates = [FixedCells(measured.measured[:, k], 4, rows=at) for k in range(2)]
    table = Table(
        [
            Column("Point", rows.points, align="left"),
            *xy_pair("{}-template", coordinates, "mm, px"),
            *_photo_columns(residuals, reliability, rows.parts),
        ]
    )
    yield from PHOTO_LEGEND
    lines = table.each_row()
    start = 0
    for photo, count in rows.photos:
        quality = _quality(influential[rows.parts[start : start + count]])
        yield from ["", f"  Photo {photo}:  {quality}", "", *table.headings()]
        yield from itertools.islice(lines, count)
        start += count


def _photo_rows(solution: Solution) -> PhotoRows:
    residuals = solution.residuals
    chosen = np.flatnonzero(np.array(residuals.kind, dtype=object) == "photo")
    names = [
        np.array(labels, dtype=object)[chosen] for labels in (residuals.photo, residuals.point, residuals.component)
    ]
    parts = _pairs(*names)
    photo, point = (labels[parts.max(axis=1, initial=0)] for labels in names[:2])
    place = {name: number for number, name in enumerate(dict.fromkeys([*solution.photos.names, *photo]))}
    number = np.fromiter(map(place.__getitem__, photo), np.int64, len(photo))
    order = np.argsort(number, kind="stable")
    counts = np.bincount(number, minlength=len(place)).tolist()
    return PhotoRows(
        tuple((name, count) for name, count in zip(place, counts, strict=True) if count),
        point[order].tolist(),
        np.append(chosen, -1)[parts[order]],
    )


def _pairs(photo: Names, point: Names, component: Names) -> IntArray:
    """Return the rows of the x and y components of each measurement (n, 2) in the order of their first ones.

    A component that comes again belongs to another measurement of the point.
    """
    pairs = np.arange(len(photo) // 2 * 2).reshape(-1, 2)
    axis = np.fromiter(map(AXES.__getitem__, component), np.int64, len(component))
    x, y = pairs.T
    if len(photo) == pairs.size and (axis[pairs] == [0, 1]).all() and all((n[x] == n[y]).all() for n in (photo, point)):
        return pairs  # as the adjustment writes them
    found: list[list[int]] = []
    open_pairs: dict[tuple[str, str], list[int]] = {}
    for row, key in enumerate(zip(photo, point, strict=True)):
        pair = open_pairs.get(key)
        if pair is None or pair[axis[row]] >= 0:
            pair = open_pairs[key] = [-1, -1]
            found.append(pair)
        pair[axis[row]] = row
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _measured_at(rows: PhotoRows, measured: PhotoObservations) -> IntArray:
    """Return where each line's point is among the measured ones (n,), -1 where it is not."""
    keys = {name: record_key(name) for name in dict.fromkeys(measured.photos)}
    photos = {key: number for number, key in enumerate(dict.fromkeys(keys.values()))}
    names = list(map(measurement_name, measured.points, observed_before(measured).tolist()))
    points = {name: number for number, name in enumerate(dict.fromkeys(names))}
    found = _numbers(measured.photos, {name: photos[key] for name, key in keys.items()}) * len(points)
    found += _numbers(names, points)
    photo = [photos.get(record_key(name), -1) for name, _ in rows.photos]
    photo_of_rows = np.repeat(photo, [count for _, count in rows.photos])
    point_of_rows = _numbers(rows.points, points)
    known = (photo_of_rows >= 0) & (point_of_rows >= 0)
    wanted = np.where(known, photo_of_rows * len(points) + point_of_rows, -1)
    order = np.append(np.argsort(found, kind="stable"), -1)  # -1: behind the last one
    at = order[np.searchsorted(found, wanted, sorter=order[:-1])]
    return np.where(np.append(found, -1)[at] == wanted, at, -1)


def _numbers(names: Sequence[str], number_of: Mapping[str, int]) -> IntArray:
    """Return the number of each name (n,), -1 for one that has none."""
    return np.fromiter((number_of.get(name, -1) for name in names), np.int64, len(names))


def _photo_columns(residuals: Residuals, reliability: Reliability, parts: IntArray) -> list[Column]:
    # millimetres: one decimal less for the error than for the residual, as instruments read out
    decimals = decimals_for(np.abs(residuals.a_priori[parts[parts >= 0]]) / 10.0, 5, 6)

    def pair(heading: str, values: FloatArray, digits: int, unit: str = "") -> list[Column]:
        return xy_pair(heading, [FixedCells(values, digits, rows=parts[:, k]) for k in range(2)], unit)

    return [
        *pair("W{}", residuals.a_priori, decimals - 1, "mm"),
        *pair("{}_residual", residuals.residual, decimals, "mm"),
        *pair("SD {}", reliability.adjusted_sd, decimals - 1, "mm"),
        *pair("{} WF", residuals.weight_factor, 2),
        *pair("SR {}", residuals.standard_residual, 2),
        *pair("r {}", residuals.redundancy_number, 2),
        *pair("w {}", residuals.w, 2),
    ]


def _quality(influential: FloatArray) -> str:
    count = len(influential)
    text = counted(count, "point")
    if np.isnan(influential).all():
        return text
    means = [root_mean_square(influential[:, k]) for k in range(2)]
    return text + ",  RMS of X_residual {} and Y_residual {} mm".format(*fixed(means, 5))
