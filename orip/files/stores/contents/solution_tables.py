"""The tables of solutions in the store of exterior orientation (.EXT), and the head of one: without its records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

from msgspec import Struct

from orip.files.stores.store import Row, Store
from orip.files.stores.table import StoreColumn, StoreTable, figure, flag, integer, list_table, record_name, text
from orip.records.camera import CAMERA_PARAMETERS, Projection
from orip.records.control import FigureKind, PointKind
from orip.records.definition import MOTION_PARAMETERS
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.tests import GroupKind, Status, VarianceGroupKind

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

ITEM_LISTS: dict[str, StoreTable] = {
    "iterations": _list_of_solution(
        "iteration",
        integer("iteration"),
        *_reals("enp", "sigma0"),
        integer("down_weighted"),
        integer("singular"),
        flag("step_limited"),
    ),
    "additional": _list_of_solution("additional_estimate", *_texts("camera", "name"), *_reals("value", "sd")),
    "zero_directions": _list_of_solution("zero_direction", text("set"), *_reals("value", "sd")),
    "figures": _list_of_solution(
        "figure_estimate",
        text("name"),
        text("kind", get_args(FigureKind)),
        integer("points"),
        *_reals("X", "Y", "Z", "dX", "dY", "dZ", "radius", "sd_place", "sd_direction", "sd_radius", "rms"),
    ),
    "antennas": _list_of_solution("antenna_estimate", *_texts("antenna", "strip", "name"), *_reals("value", "sd")),
    "rigs": _list_of_solution(
        "rig_estimate",
        *_texts("first", "second"),
        integer("instants"),
        text("name"),
        *_reals("value", "sd", "scatter"),
    ),
    "mountings": _list_of_solution("mounting_estimate", *_texts("rig", "camera", "name"), *_reals("value", "sd")),
    "rig_exposures": _list_of_solution(
        "rig_exposure_estimate", *_texts("exposure", "rig", "name"), *_reals("value", "sd")
    ),
    "motions": _list_of_solution(
        "photo_motion",
        text("photo"),
        *_reals(*(column for kind in MOTION_PARAMETERS for column in (kind, f"{kind}_sd")), "pixels"),
    ),
    "exposures": _list_of_solution("exposure", *_texts("photo", "strip"), *_reals("time")),
    "remarks": _list_of_solution("remark", *_texts("text")),
    "singular": _list_of_solution("singular_unknown", *_texts("group", "name", "kind"), *_reals("lost_digits")),
    "correlations": _list_of_solution("correlation", *_texts("a", "b"), *_reals("r")),
    "blunders": _list_of_solution(
        "blunder",
        integer("order"),
        *_texts("kind", "photo", "point", "component"),
        *_reals("size", "sd", "statistic", "limit"),
        *_texts("alternatives"),
    ),
    "diagnosis": _list_of_solution("diagnosis", *_texts("code", "where", "text", "remedy")),
    "correlated": _list_of_solution(
        "correlated_reliability", integer("row"), *_reals("minimal_detectable_bias", "external", "adjusted_sd")
    ),
    "check_points": _list_of_solution("check_point", *_texts("name"), *_reals("dX", "dY", "dZ")),
    "groups": _list_of_solution(
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
    "variance_components": _list_of_solution(
        "variance_component",
        text("kind", get_args(VarianceGroupKind)),
        *_texts("of", "component"),
        integer("number"),
        *_reals("redundancy", "factor", "sd", "p"),
    ),
    "interior": _list_of_solution(
        "interior",
        text("group", ("templates", "photos")),
        *_texts("name", "type"),
        *_reals("x0", "y0", "ro", "sk", "sx", "sy", "s0"),
        integer("redundancy"),
    ),
}
"""Lists whose items are structures of single values: the columns are named as their fields."""

TUPLE_LISTS: dict[str, StoreTable] = {
    "inputs": _list_of_solution("solution_input", *_texts("file", "sha256")),
    "warnings": _list_of_solution("warning", *_texts("code", "where", "text")),
}
"""Lists whose items are tuples of text."""

PHOTO_CORRELATIONS = _long_list_of_solution(
    "photo_correlation",
    *_reals(*(f"{b}_{a}" for n, a in enumerate(PHOTO_PARAMETERS) for b in PHOTO_PARAMETERS[:n])),
)
POINT_CORRELATIONS = _long_list_of_solution("point_correlation", *_reals("XY", "XZ", "YZ"))
BULK_TABLES = (CAMERAS, PHOTOS, POINTS, RESIDUALS, PHOTO_CORRELATIONS, POINT_CORRELATIONS)
LIST_TABLES = (*ITEM_LISTS.values(), *TUPLE_LISTS.values())
TABLES = (SOLUTION, *BULK_TABLES, *LIST_TABLES)


def bundles(store: Store) -> tuple[str, ...]:
    """Return the names of the bundles that have a solution, sorted."""
    return tuple(row[0] for row in store.rows(SOLUTION))


class SolutionHead(Struct, frozen=True):
    """What tells one solution from another, without reading all of it."""

    run: str
    status: Status
    sigma0: float
    inputs: tuple[tuple[str, str], ...]
    verdict: str


def read_head(store: Store, bundle: str) -> SolutionHead | None:
    """Return the head of the last solution of a bundle, None if there is none."""
    name = store.spelling(SOLUTION, bundle)
    if name is None:
        return None
    head = dict(zip(SOLUTION.column_names, next(store.rows(SOLUTION, name)), strict=True))
    inputs: Any = tuple(items(store, TUPLE_LISTS["inputs"], name))
    return SolutionHead(head["run"], head["status"], head["sigma0"], inputs, head["verdict"])


def items(store: Store, table: StoreTable, bundle: str) -> list[Row]:
    """Return the rows of a list of a solution without the columns that say where they belong."""
    return [row[2:] for row in store.rows(table, bundle)]
