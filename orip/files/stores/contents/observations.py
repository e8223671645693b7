"""The store of photo observations of one bundle adjustment (.EXO)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable, flag, integer, position, real, record_name, text
from orip.records.coded_names import CodedNames, coded
from orip.records.observations.measurement import PhotoObservations
from orip.records.observations.repeated import observed_before
from orip.set_aside import set_aside

# The number makes it a table of one row: a store holds the observations of one bundle.
BUNDLE = StoreTable("observed_bundle", (integer("number", "number = 1"), record_name("name")), key=("number",))
OBSERVATION = StoreTable(
    "observation",
    (
        integer("bundle", "bundle = 1"),
        position(),
        record_name("photo"),
        text("point"),
        integer("measurement", "measurement > 0"),
        real("x"),
        real("y"),
        real("error_x", "nan"),
        real("error_y", "nan"),
        flag("disregarded"),
    ),
    key=("bundle", "position"),
    parent="observed_bundle",
    unique=(("photo", "point", "measurement"),),
    packed=True,
)
TABLES = (BUNDLE, OBSERVATION)


def read(store: Store) -> PhotoObservations | None:
    """Return the photo observations in the order they were written; None if none were ever written."""
    bundle = next(store.rows(BUNDLE), None)
    if bundle is None:
        return None
    columns: tuple[Any, ...] = store.columns(OBSERVATION)
    _bundle, _position, photos, points, _measurement, x, y, error_x, error_y, disregarded = columns
    errors = np.column_stack([error_x, error_y])
    if np.isnan(errors).all():  # mostly; a block has millions of them
        errors = np.broadcast_to(np.nan, errors.shape)
    return PhotoObservations(
        bundle=bundle[1],
        photos=_set_aside(photos),
        points=_set_aside(points),
        measured=set_aside(np.column_stack([x, y])),
        errors=set_aside(errors),
        disregarded=set_aside(disregarded),
    )


def _set_aside(names: Sequence[str]) -> CodedNames:
    column = coded(names)
    return CodedNames(column.distinct, set_aside(column.codes))


def write(store: Store, observations: PhotoObservations) -> None:
    """Replace all photo observations."""
    store.delete(BUNDLE)
    store.insert(BUNDLE, [(1, observations.bundle)])
    store.delete(OBSERVATION)
    measured = observations.measured.reshape(-1, 2)
    errors = observations.errors.reshape(-1, 2)
    store.insert_columns(
        OBSERVATION,
        (1,) * len(observations.photos),
        np.arange(len(observations.photos)),
        observations.photos,
        observations.points,
        observed_before(observations) + 1,
        measured[:, 0],
        measured[:, 1],
        errors[:, 0],
        errors[:, 1],
        observations.disregarded,
    )
