"""Solutions in the store of exterior orientation (.EXT): the last adjustment of each bundle, figure for figure."""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np
from msgspec.structs import astuple

from orip.files.stores.contents.solution_tables import (
    CAMERAS,
    ITEM_LISTS,
    ITEMS,
    PHOTO_CORRELATIONS,
    PHOTOS,
    POINT_COORDINATES,
    POINT_CORRELATIONS,
    POINTS,
    RESIDUALS,
    SOLUTION,
    TUPLE_LISTS,
    items,
)
from orip.files.stores.digest import same_record
from orip.files.stores.packed_columns import ColumnValues
from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.coded_names import CodedNames, repeated
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Estimates, Residuals, Solution


def read(store: Store, bundle: str) -> Solution | None:
    """Return the last solution of a bundle, None if there is none."""
    name = store.spelling(SOLUTION, bundle)
    if name is None:
        return None
    return _read(store, name, Residuals(*store.columns(RESIDUALS, name)[2:]))  # type: ignore[arg-type]


def is_stored(store: Store, solution: Solution) -> bool:
    """Tell whether a solution is what the store has; its residuals are read column by column."""
    name = store.spelling(SOLUTION, solution.bundle)
    if name is None or not store.holds(RESIDUALS, name, astuple(solution.residuals)):
        return False
    return same_record(_read(store, name, solution.residuals), solution)


def _read(store: Store, name: str, residuals: Residuals) -> Solution:
    head = dict(zip(SOLUTION.column_names, next(store.rows(SOLUTION, name)), strict=True))
    cameras, (projections,) = _read_estimates(store, CAMERAS, name, len(CAMERA_PARAMETERS))
    photos, (about_axes,) = _read_estimates(store, PHOTOS, name, len(PHOTO_PARAMETERS))
    points, (rays, kinds) = _read_estimates(store, POINTS, name, len(POINT_COORDINATES))
    lists: dict[str, Any] = {field: tuple(items(store, table, name)) for field, table in TUPLE_LISTS.items()}
    for field, (_, item) in ITEMS.items():
        lists[field] = tuple(item(*row) for row in items(store, ITEM_LISTS[field], name))
    return Solution(
        **head,
        cameras=cameras,
        projections=tuple(projections),
        photos=photos,
        points=points,
        point_rays=rays,
        point_kinds=kinds,
        residuals=residuals,
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
    _write_estimates(store, POINTS, bundle, solution.points, solution.point_rays, solution.point_kinds)
    residuals = astuple(solution.residuals)
    _insert(store, RESIDUALS, bundle, *residuals)
    _insert(store, PHOTO_CORRELATIONS, bundle, *solution.photo_correlations.T)
    _insert(store, POINT_CORRELATIONS, bundle, *solution.point_correlations.T)
    for field, table in ITEM_LISTS.items():
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


def _insert(store: Store, table: StoreTable, bundle: str, *columns: ColumnValues) -> None:
    count = len(columns[0])
    store.insert_columns(table, repeated(bundle, count), np.arange(count), *columns)


def _write_estimates(
    store: Store, table: StoreTable, bundle: str, estimates: Estimates, *further: ColumnValues
) -> None:
    count = len(estimates.names)
    expected = (len(table.columns) - 3 - len(further)) // 2
    pairs = list(zip(estimates.values.T, estimates.sd.T, strict=True)) if count else [(np.empty(0),) * 2] * expected
    if len(pairs) != expected:
        message = f"table {table.name} has {expected} parameters, the solution {len(pairs)}"
        raise ValueError(message)
    names = CodedNames(estimates.names, np.arange(count))  # each one of its own
    _insert(store, table, bundle, names, *chain.from_iterable(pairs), *further)


def _read_estimates(store: Store, table: StoreTable, bundle: str, count: int) -> tuple[Estimates, tuple[Any, ...]]:
    _bundle, _position, names, *columns = store.columns(table, bundle)
    figures = np.column_stack(columns[: 2 * count])
    estimates = Estimates(tuple(names), figures[:, 0::2].copy(), figures[:, 1::2].copy())
    return estimates, tuple(columns[2 * count :])
