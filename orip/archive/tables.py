"""What is kept of a project of an archive: how it ended, and its rows in the tables of results."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final, Literal

from msgspec import Struct, field

from orip.arrays import FloatArray
from orip.bundle.results.figures import figure
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.results.solution import Estimates, Solution
from orip.records.results.tests import GateResult

# docs/reference/archive.md describes them for users. A change that readers of older data sets would notice takes a new
# `SCHEMA`.

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


State = Literal["adjusted", "wrong", "over limit", "machine"]
"""Adjusted: see the status of its bundles. Wrong: its input. Over limit: of time or memory. Machine: it ended by
something that is not in the project, such as a full disk, and is run again next time."""

Tables = Mapping[str, Sequence[Row]]


class ProjectOutcome(Struct, frozen=True):
    """How a project ended.

    Parameters
    ----------
    name : str
        Of the project in the archive.
    message : str
        The first line that a user would see of its error; empty without one.
    texts, steps : str
        Digests of its texts as they were read, and of its steps as `orip status` showed them afterwards.
    tables : Tables
        Rows by table, without those of `runs`.
    run : Row
        Its row of `runs`.
    """

    name: str
    state: State
    message: str = ""
    texts: str = ""
    steps: str = ""
    tables: Tables = field(default_factory=dict)
    run: Row = field(default_factory=dict)


def rows_of_error(name: str, state: State, message: str) -> Tables:
    """Return the rows of a project without a result."""
    return {"projects": [{"project": name, "bundle": "", "state": state, "message": message}]}


class AdjustedBundle(Struct, frozen=True):
    """A bundle of a project, adjusted.

    Parameters
    ----------
    report : str
        Path of its report from the folder of the project; empty without one.
    crs : str
        Of the project; empty without one.
    """

    solution: Solution
    gates: tuple[GateResult, ...]
    report: str
    crs: str


def rows_of_bundles(name: str, bundles: Sequence[AdjustedBundle]) -> Tables:
    """Return the rows of a project whose bundles have been adjusted; one without bundles has a row for itself."""
    if not bundles:
        return rows_of_error(name, "adjusted", "the project has no bundle yet")
    tables: dict[str, list[Row]] = {"projects": [], "gates": [], "cameras": [], "photos": [], "points": []}
    for bundle in bundles:
        solution = bundle.solution
        key: dict[str, Cell] = {"project": name, "bundle": solution.bundle}
        tables["projects"].append({**key, **_summary(bundle)})
        tables["gates"] += (
            {**key, "gate": str(result.gate), "value": _finite(result.value), "passed": result.passed}
            for result in bundle.gates
        )
        tables["cameras"] += ({**key, **row} for row in _estimates("camera", CAMERA_VALUES, solution.cameras))
        tables["photos"] += ({**key, **row} for row in _estimates("photo", PHOTO_VALUES, solution.photos))
        points = zip(
            _estimates("point", POINT_VALUES, solution.points), solution.point_kinds, solution.point_rays, strict=True
        )
        tables["points"] += ({**key, **row, "kind": str(kind), "rays": int(rays)} for row, kind, rays in points)
    return tables


def _summary(bundle: AdjustedBundle) -> dict[str, Cell]:
    solution = bundle.solution
    counts = {name: int(figure(solution, name)) for name in ("down_weighted", "singular", "blunders", "warnings")}
    return {
        "state": "adjusted",
        "message": "",
        "status": solution.status,
        "verdict": solution.verdict,
        "run": solution.run,
        "ground_unit": solution.ground_unit,
        "crs": bundle.crs,
        "report": bundle.report,
        "sigma0": _finite(solution.sigma0),
        "redundancy": solution.redundancy,
        "iterations": len(solution.iterations),
        "photos": len(solution.photos.names),
        "points": len(solution.points.names),
        "cameras": len(solution.cameras.names),
        "observations": solution.observations,
        "unknowns": solution.unknowns,
        **counts,
        "check_points": len(solution.check_points),
        "check_rms_xy": _finite(figure(solution, "check_points.rms_xy")),
        "check_rms_z": _finite(figure(solution, "check_points.rms_z")),
        "check_max": _finite(figure(solution, "check_points.max")),
        "gates": len(bundle.gates),
        "gates_failed": sum(not result.passed for result in bundle.gates),
    }


def _estimates(kind: str, columns: Sequence[str], estimates: Estimates) -> Iterator[dict[str, Cell]]:
    for name, values, sd in zip(estimates.names, estimates.values, estimates.sd, strict=True):
        yield {kind: name, **_cells(columns, values), **_cells([f"sd_{column}" for column in columns], sd)}


def _cells(columns: Sequence[str], values: FloatArray) -> dict[str, Cell]:
    """Return values by column: None for NaN, infinite as it is (an unknown that nothing determines)."""
    numbers = map(float, values)
    return {column: None if math.isnan(value) else value for column, value in zip(columns, numbers, strict=True)}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
