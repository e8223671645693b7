"""The tables of solutions in the store of exterior orientation (.EXT), and the head of one: without its records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, get_args

from msgspec import Struct
from msgspec.structs import fields

from orip.files.stores.store import Row, Store
from orip.files.stores.table import StoreColumn, StoreTable, figure, flag, integer, list_table, record_name, text
from orip.records.camera import CAMERA_PARAMETERS, Projection
from orip.records.control import PointKind
from orip.records.figures import FigureEstimate
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import (
    AdditionalEstimate,
    AntennaEstimate,
    Blunder,
    CheckPoint,
    CorrelatedReliability,
    Correlation,
    Diagnosis,
    Exposure,
    ExposureEstimate,
    InteriorSummary,
    IterationPass,
    MountingEstimate,
    PhotoMotion,
    Remark,
    RigEstimate,
    SingularUnknown,
    ZeroDirection,
)
from orip.records.results.tests import GroupTest, Status, VarianceComponent

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

ITEMS: dict[str, tuple[str, type[Any]]] = {
    "iterations": ("iteration", IterationPass),
    "additional": ("additional_estimate", AdditionalEstimate),
    "zero_directions": ("zero_direction", ZeroDirection),
    "figures": ("figure_estimate", FigureEstimate),
    "antennas": ("antenna_estimate", AntennaEstimate),
    "rigs": ("rig_estimate", RigEstimate),
    "mountings": ("mounting_estimate", MountingEstimate),
    "rig_exposures": ("rig_exposure_estimate", ExposureEstimate),
    "motions": ("photo_motion", PhotoMotion),
    "exposures": ("exposure", Exposure),
    "remarks": ("remark", Remark),
    "singular": ("singular_unknown", SingularUnknown),
    "correlations": ("correlation", Correlation),
    "blunders": ("blunder", Blunder),
    "diagnosis": ("diagnosis", Diagnosis),
    "correlated": ("correlated_reliability", CorrelatedReliability),
    "check_points": ("check_point", CheckPoint),
    "groups": ("group_test", GroupTest),
    "variance_components": ("variance_component", VarianceComponent),
    "interior": ("interior", InteriorSummary),
}
"""Lists of a solution whose items are structures of single values: their tables, and these structures."""


def _columns(item: type[Any]) -> Iterator[StoreColumn]:
    """Yield the columns of an item, which are named as its fields."""
    columns = {int: integer, bool: flag, float: figure, str: text}
    for one in fields(item):
        yield text(one.name, get_args(one.type)) if get_args(one.type) else columns[one.type](one.name)


ITEM_LISTS = {name: _list_of_solution(table, *_columns(item)) for name, (table, item) in ITEMS.items()}

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
