"""The store of photo observations of one bundle adjustment (.EXO)."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from typing import Any

from msgspec import Struct

from orip.files.stores.packed_parts import WIDTH, interleaved, unpacked_parts, whole_numbers
from orip.files.stores.store import Store, damage
from orip.files.stores.table import StoreTable, flag, integer, position, real, record_name, text
from orip.records.measurement import PhotoObservations

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
    import numpy as np

    from orip.set_aside import set_aside

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


def _set_aside(names: Sequence[str]) -> Sequence[str]:
    from orip.records.coded_names import CodedNames, coded
    from orip.set_aside import set_aside

    column = coded(names)
    return CodedNames(column.distinct, set_aside(column.codes))


class PlainObservations(Struct, frozen=True):
    """Photo observations without arrays, for their number and digest.

    Parameters
    ----------
    numbers : tuple of bytes
        Those of the arrays of `PhotoObservations`: measured, errors, disregarded.
    """

    photos: list[str]
    points: list[str]
    numbers: tuple[bytes, bytes, bytes]


def read_plain(store: Store) -> PlainObservations | None:
    """Return what `read` does without arrays, which take their time to import."""
    if next(store.rows(BUNDLE), None) is None:
        return None
    try:
        parts = [_plain_part(count, blobs) for _bundle, _first, count, *blobs in store.packed_rows(OBSERVATION)]
    except (ValueError, IndexError, MemoryError) as error:
        raise damage(store.path, f"table {OBSERVATION.name}: {error}") from error
    measured, errors, disregarded = (b"".join(part.numbers[place] for part in parts) for place in range(3))
    if all(map(math.isnan, array("d", errors))):
        errors = array("d", [math.nan]).tobytes() * (len(errors) // WIDTH)
    photos = [name for part in parts for name in part.photos]
    points = [name for part in parts for name in part.points]
    return PlainObservations(photos, points, (measured, errors, disregarded))


def _plain_part(count: int, blobs: Sequence[bytes]) -> PlainObservations:
    """Return the observations of one row of the file."""
    columns = OBSERVATION.packed_columns
    found = {column.name: unpacked_parts(column, blob, count) for column, blob in zip(columns, blobs, strict=True)}
    photos, points = (
        list(map(names.__getitem__, whole_numbers(places, count))) for names, places in (found["photo"], found["point"])
    )
    pairs = [[found[key][1] for key in keys] for keys in (("x", "y"), ("error_x", "error_y"))]
    measured, errors = (bytes(interleaved(pair, count)) for pair in pairs)
    return PlainObservations(photos, points, (measured, errors, bytes(found["disregarded"][1][0])))


def write(store: Store, observations: PhotoObservations) -> None:
    """Replace all photo observations."""
    import numpy as np

    from orip.records.observation_kinds import observed_before

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
