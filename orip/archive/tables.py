"""The tables of an archive's results: their columns, in order, with the type and the unit of each.

docs/reference/archive.md describes them for users. A change that readers of older data sets would notice takes a new
`SCHEMA`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal

from orip.records.project.camera import CAMERA_PARAMETERS

SCHEMA: Final = "orip.archive/1"
"""Name and version of the tables."""

ColumnType = Literal["text", "number", "count", "yes_no"]

_KEY: Final[Mapping[str, ColumnType]] = {"project": "text", "bundle": "text"}

CAMERA_VALUES: Final = CAMERA_PARAMETERS
PHOTO_VALUES: Final = ("X0", "Y0", "Z0", "omega", "phi", "kappa")
POINT_VALUES: Final = ("X", "Y", "Z")


def _values(names: tuple[str, ...]) -> dict[str, ColumnType]:
    """Return columns of values, then those of their standard deviations."""
    found: dict[str, ColumnType] = dict.fromkeys(names, "number")
    found.update(dict.fromkeys((f"sd_{name}" for name in names), "number"))
    return found


TABLES: Final[Mapping[str, Mapping[str, ColumnType]]] = MappingProxyType(
    {
        "projects": {
            **_KEY, "state": "text", "message": "text", "status": "text", "verdict": "text", "run": "text",
            "ground_unit": "text", "crs": "text", "report": "text", "sigma0": "number", "redundancy": "count",
            "iterations": "count", "photos": "count", "points": "count", "cameras": "count", "observations": "count",
            "unknowns": "count", "down_weighted": "count", "singular": "count", "blunders": "count",
            "warnings": "count", "check_points": "count", "check_rms_xy": "number", "check_rms_z": "number",
            "check_max": "number", "gates": "count", "gates_failed": "count",
        },
        "gates": {**_KEY, "gate": "text", "value": "number", "passed": "yes_no"},
        "cameras": {**_KEY, "camera": "text", **_values(CAMERA_VALUES)},
        "photos": {**_KEY, "photo": "text", **_values(PHOTO_VALUES)},
        "points": {**_KEY, "point": "text", "kind": "text", "rays": "count", **_values(POINT_VALUES)},
        "runs": {
            "project": "text", "finished": "text", "seconds": "number", "cpu_seconds": "number", "peak_mb": "number",
            "host": "text", "orip": "text",
        },
    }
)  # fmt: skip
"""Columns by table; `runs` is of the computation, and alone differs when the same input is adjusted again."""

NAME_COLUMN: Final[Mapping[str, str]] = {"cameras": "camera", "photos": "photo", "points": "point"}
"""The column with the name of the record, of tables of adjusted values."""

VALUES: Final[Mapping[str, tuple[str, ...]]] = {
    "cameras": CAMERA_VALUES,
    "photos": PHOTO_VALUES,
    "points": POINT_VALUES,
}
"""The columns of adjusted values; each has a standard deviation in the column ``sd_`` and its name."""

Cell = str | float | int | bool | None
Row = Mapping[str, Cell]
"""A row by column; None where there is nothing."""
