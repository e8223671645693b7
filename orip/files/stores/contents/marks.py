"""Measured marks (fiducials, ticks): lists that several stores have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np

from orip.files.stores.store import Row
from orip.files.stores.table import StoreTable, flag, list_table, real, text
from orip.records.observations.measurement import MeasuredMarks, TransformationKind

TRANSFORMATION = text("transformation", get_args(TransformationKind))


def measured_marks_table(name: str, owner: str, parent: str) -> StoreTable:
    """Return the table of measured marks; their own given coordinates are NULL where a record has them."""
    columns = (text("name"), real("x"), real("y"), flag("disregarded"), real("given_x", "nan"), real("given_y", "nan"))
    return list_table(name, owner, columns, "name", parent=parent)


def measured_rows(marks: MeasuredMarks) -> list[Row]:
    """Return measured marks as rows."""
    coordinates = np.column_stack([marks.measured, marks.given]).tolist() if marks.names else []
    return [
        (name, x, y, bool(disregarded), given_x, given_y)
        for name, (x, y, given_x, given_y), disregarded in zip(marks.names, coordinates, marks.disregarded, strict=True)
    ]


def measured_of(rows: Sequence[Row]) -> MeasuredMarks:
    """Return rows as measured marks."""
    numbers = np.array([(x, y, given_x, given_y) for _name, x, y, _off, given_x, given_y in rows], dtype=np.float64)
    numbers = numbers.reshape(len(rows), 4)
    return MeasuredMarks(
        names=tuple(row[0] for row in rows),
        measured=numbers[:, :2].copy(),
        disregarded=np.array([row[3] for row in rows], dtype=np.bool_),
        given=numbers[:, 2:].copy(),
    )
