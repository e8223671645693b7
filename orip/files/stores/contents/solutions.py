"""Solutions in the store of exterior orientation (.EXT): the last adjustment of each bundle, figure for figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, get_args

import numpy as np

from orip.files.stores.store import ColumnValues, Row, Store
from orip.files.stores.table import StoreColumn, StoreTable, figure, flag, integer, list_table, record_name, text
from orip.records.observations.control import PointKind
from orip.records.project.camera import CAMERA_PARAMETERS, Projection
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.records.results.group_test import GroupKind, GroupTest
from orip.records.results.solution import (
    AdditionalEstimate,
    AntennaEstimate,
    Blunder,
    CheckPoint,
    Correlation,
    Diagnosis,
    Estimates,
    Exposure,
    InteriorSummary,
    IterationPass,
    Remark,
    Residuals,
    RigEstimate,
    SingularUnknown,
    Solution,
    Status,
    ZeroDirection,
)
from orip.records.results.variance_component import VarianceComponent, VarianceGroupKind

POINT_COORDINATES = ("X", "Y", "Z")


def _reals(*names: str) -> tuple[StoreColumn, ...]:
    """Return columns of figures; any figure of a solution may be NaN."""
    return tuple(figure(name) for name in names)


def _texts(*names: str) -> tuple[StoreColumn, ...]:
    return tuple(text(name) for name in names)


SOLUTION = StoreTable(
    "solution",
    (
        record_name("bundle"),
        *_texts("project", "user", "ground_unit", "run"),
        text("status", get_args(Status)),
        *_reals("sigma0", "sigma0_all"),
        integer("redundancy"),
        *_reals("redundancy_used"),
        integer("observations"),
        integer("unknowns"),
        *_reals("enp"),
        text("verdict"),
    ),
    key=("bundle",),
)


def _list_of_solution(name: str, *columns: StoreColumn) -> StoreTable:
    return list_table(name, "bundle", columns, parent="solution", by_owner=True)


def _long_list_of_solution(name: str, *columns: StoreColumn) -> StoreTable:
    return list_table(name, "bundle", columns, parent="solution", by_owner=True, packed=True)


def _estimates_table(name: str, parameters: Sequence[str], *further: StoreColumn) -> StoreTable:
    figures = _reals(*(column for parameter in parameters for column in (parameter, f"{parameter}_sd")))
    return _long_list_of_solution(name, text("name"), *figures, *further)


CAMERAS = _estimates_table("camera_estimate", CAMERA_PARAMETERS, text("projection", get_args(Projection)))
PHOTOS = _estimates_table("photo_estimate", PHOTO_PARAMETERS, flag("rotation_sd_about_axes"))
POINTS = _estimates_table("point_estimate", POINT_COORDINATES, integer("rays"), text("kind", get_args(PointKind)))
RESIDUALS = _long_list_of_solution(
    "residual",
    *_texts("kind", "photo", "point", "component"),
    *_reals("observed", "residual", "a_priori", "standard_residual", "weight_factor", "redundancy_number", "w"),
)

# Lists of a solution whose items are dataclasses of single values: the columns are named as their fields.
ITEM_LISTS: dict[str, tuple[type[Any], StoreTable]] = {
    "iterations": (
        IterationPass,
        _list_of_solution(
            "iteration",
            integer("iteration"),
            *_reals("enp", "sigma0"),
            integer("down_weighted"),
            integer("singular"),
            flag("step_limited"),
        ),
    ),
    "additional": (
        AdditionalEstimate,
        _list_of_solution("additional_estimate", *_texts("camera", "name"), *_reals("value", "sd")),
    ),
    "zero_directions": (
        ZeroDirection,
        _list_of_solution("zero_direction", text("set"), *_reals("value", "sd")),
    ),
    "antennas": (
        AntennaEstimate,
        _list_of_solution("antenna_estimate", *_texts("antenna", "strip", "name"), *_reals("value", "sd")),
    ),
    "rigs": (
        RigEstimate,
        _list_of_solution(
            "rig_estimate",
            *_texts("first", "second"),
            integer("instants"),
            text("name"),
            *_reals("value", "sd", "scatter"),
        ),
    ),
    "exposures": (Exposure, _list_of_solution("exposure", *_texts("photo", "strip"), *_reals("time"))),
    "remarks": (Remark, _list_of_solution("remark", *_texts("text"))),
    "singular": (
        SingularUnknown,
        _list_of_solution("singular_unknown", *_texts("group", "name", "kind"), *_reals("lost_digits")),
    ),
    "correlations": (Correlation, _list_of_solution("correlation", *_texts("a", "b"), *_reals("r"))),
    "blunders": (
        Blunder,
        _list_of_solution(
            "blunder",
            integer("order"),
            *_texts("kind", "photo", "point", "component"),
            *_reals("size", "sd", "statistic", "limit"),
            *_texts("alternatives"),
        ),
    ),
    "diagnosis": (Diagnosis, _list_of_solution("diagnosis", *_texts("code", "where", "text", "remedy"))),
    "check_points": (CheckPoint, _list_of_solution("check_point", *_texts("name"), *_reals("dX", "dY", "dZ"))),
    "groups": (
        GroupTest,
        _list_of_solution(
            "group_test",
            text("kind", get_args(GroupKind)),
            *_texts("of", "component"),
            integer("number"),
            integer("down_weighted"),
            *_reals("redundancy", "sigma0", "p_sigma0", "mean", "mean_sd", "p_mean", "shift", "shift_sd"),
            *_texts("worst"),
            *_reals("worst_size", "p_worst"),
            flag("doubted"),
        ),
    ),
    "variance_components": (
        VarianceComponent,
        _list_of_solution(
            "variance_component",
            text("kind", get_args(VarianceGroupKind)),
            *_texts("of", "component"),
            integer("number"),
            *_reals("redundancy", "factor", "sd", "p"),
        ),
    ),
    "interior": (
        InteriorSummary,
        _list_of_solution(
            "interior",
            text("group", ("templates", "photos")),
            *_texts("name", "type"),
            *_reals("x0", "y0", "ro", "sk", "sx", "sy", "s0"),
            integer("redundancy"),
        ),
    ),
}
# Lists of a solution whose items are tuples of text.
TUPLE_LISTS: dict[str, StoreTable] = {
    "inputs": _list_of_solution("solution_input", *_texts("file", "sha256")),
    "warnings": _list_of_solution("warning", *_texts("code", "where", "text")),
}
PHOTO_CORRELATIONS = _long_list_of_solution(
    "photo_correlation",
    *_reals(*(f"{b}_{a}" for n, a in enumerate(PHOTO_PARAMETERS) for b in PHOTO_PARAMETERS[:n])),
)
POINT_CORRELATIONS = _long_list_of_solution("point_correlation", *_reals("XY", "XZ", "YZ"))
BULK_TABLES = (CAMERAS, PHOTOS, POINTS, RESIDUALS, PHOTO_CORRELATIONS, POINT_CORRELATIONS)
LIST_TABLES = (*(table for _item, table in ITEM_LISTS.values()), *TUPLE_LISTS.values())
TABLES = (SOLUTION, *BULK_TABLES, *LIST_TABLES)


def bundles(store: Store) -> tuple[str, ...]:
    """Return the names of the bundles that have a solution, sorted."""
    return tuple(row[0] for row in store.rows(SOLUTION))


@dataclass(frozen=True, slots=True)
class SolutionHead:
    """What tells one solution from another, without reading all of it."""

    run: str
    status: Status
    sigma0: float
    inputs: tuple[tuple[str, str], ...]


def read_head(store: Store, bundle: str) -> SolutionHead | None:
    """Return the head of the last solution of a bundle, None if there is none."""
    name = store.spelling(SOLUTION, bundle)
    if name is None:
        return None
    head = dict(zip(SOLUTION.column_names, next(store.rows(SOLUTION, name)), strict=True))
    inputs: Any = tuple(_items(store, TUPLE_LISTS["inputs"], name))
    return SolutionHead(head["run"], head["status"], head["sigma0"], inputs)


def read(store: Store, bundle: str) -> Solution | None:
    """Return the last solution of a bundle, None if there is none."""
    name = store.spelling(SOLUTION, bundle)
    if name is None:
        return None
    head = dict(zip(SOLUTION.column_names, next(store.rows(SOLUTION, name)), strict=True))
    cameras, (projections,) = _read_estimates(store, CAMERAS, name, len(CAMERA_PARAMETERS))
    photos, (about_axes,) = _read_estimates(store, PHOTOS, name, len(PHOTO_PARAMETERS))
    points, (rays, kinds) = _read_estimates(store, POINTS, name, len(POINT_COORDINATES))
    lists: dict[str, Any] = {field: tuple(_items(store, table, name)) for field, table in TUPLE_LISTS.items()}
    for field, (item, table) in ITEM_LISTS.items():
        lists[field] = tuple(item(*row) for row in _items(store, table, name))
    return Solution(
        **head,
        cameras=cameras,
        projections=tuple(projections),
        photos=photos,
        points=points,
        point_rays=tuple(rays.tolist()),
        point_kinds=tuple(kinds),
        residuals=Residuals(*store.columns(RESIDUALS, name)[2:]),  # type: ignore[arg-type]
        photo_rotation_sd_about_axes=tuple(about_axes.tolist()),
        photo_correlations=np.column_stack(store.columns(PHOTO_CORRELATIONS, name)[2:]),
        point_correlations=np.column_stack(store.columns(POINT_CORRELATIONS, name)[2:]),
        **lists,
    )


def write(store: Store, solution: Solution) -> None:
    """Replace the solution of a bundle; those of other bundles stay.

    Raises
    ------
    ValueError
        If arrays of the solution that go together have different lengths.
    """
    delete(store, solution.bundle)
    bundle = solution.bundle
    store.insert(SOLUTION, [[getattr(solution, column) for column in SOLUTION.column_names]])
    _write_estimates(store, CAMERAS, bundle, solution.cameras, solution.projections)
    about_axes = np.array(solution.photo_rotation_sd_about_axes, dtype=np.bool_)
    _write_estimates(store, PHOTOS, bundle, solution.photos, about_axes)
    rays = np.array(solution.point_rays, dtype=np.int64)
    _write_estimates(store, POINTS, bundle, solution.points, rays, solution.point_kinds)
    residuals = [getattr(solution.residuals, field.name) for field in fields(Residuals)]
    _insert(store, RESIDUALS, bundle, *residuals)
    _insert(store, PHOTO_CORRELATIONS, bundle, *solution.photo_correlations.T)
    _insert(store, POINT_CORRELATIONS, bundle, *solution.point_correlations.T)
    for field, (_item, table) in ITEM_LISTS.items():
        names = table.column_names[2:]
        rows = ([getattr(item, name) for name in names] for item in getattr(solution, field))
        store.insert(table, ((bundle, place, *row) for place, row in enumerate(rows)))
    for field, table in TUPLE_LISTS.items():
        store.insert(table, ((bundle, place, *row) for place, row in enumerate(getattr(solution, field))))


def delete(store: Store, bundle: str) -> None:
    """Delete the solution of a bundle, if there is one."""
    name = store.spelling(SOLUTION, bundle)
    if name is not None:
        store.delete(SOLUTION, name)


def _items(store: Store, table: StoreTable, bundle: str) -> list[Row]:
    return [row[2:] for row in store.rows(table, bundle)]


def _insert(store: Store, table: StoreTable, bundle: str, *columns: ColumnValues) -> None:
    count = len(columns[0])
    store.insert_columns(table, (bundle,) * count, np.arange(count), *columns)


def _write_estimates(
    store: Store, table: StoreTable, bundle: str, estimates: Estimates, *further: ColumnValues
) -> None:
    count = len(estimates.names)
    figures = np.stack([estimates.values, estimates.sd], axis=-1).reshape(count, -1) if count else np.empty((0, 0))
    expected = len(table.columns) - 3 - len(further)
    if count and figures.shape[1] != expected:
        message = f"table {table.name} has {expected // 2} parameters, the solution {figures.shape[1] // 2}"
        raise ValueError(message)
    columns = figures.T if count else np.empty((expected, 0))
    _insert(store, table, bundle, estimates.names, *columns, *further)


def _read_estimates(store: Store, table: StoreTable, bundle: str, count: int) -> tuple[Estimates, tuple[Any, ...]]:
    _bundle, _position, names, *columns = store.columns(table, bundle)
    figures = np.column_stack(columns[: 2 * count])
    estimates = Estimates(tuple(names), figures[:, 0::2].copy(), figures[:, 1::2].copy())
    return estimates, tuple(columns[2 * count :])
