"""The rows of the tables of results that a project with adjusted bundles has."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from msgspec import Struct

from orip.archive.outcome import Tables, rows_of_error
from orip.archive.tables import CAMERA_VALUES, PHOTO_VALUES, POINT_VALUES, Cell, Row
from orip.arrays import FloatArray
from orip.bundle.results.figures import figure
from orip.records.results.result_tests import GateResult
from orip.records.results.solution import Estimates, Solution


class AdjustedBundle(Struct, frozen=True):
    """A bundle of a project, adjusted.

    Parameters
    ----------
    solution : Solution
    gates : tuple of GateResult
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
