"""result.json: a solution for programs, schema ``orip.result/2``.

The points of a large block are columns (`point_columns`) in place of objects by name (`points`): half as long.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Literal, get_args, get_origin

import msgspec
import numpy as np

from orip.files.identification import SCHEMA
from orip.files.result.reader import INDENT, SINGULAR, Column, Points, compact, point_columns
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Estimates, Residuals, Solution
from orip.records.results.stations import station_residuals
from orip.schemas.project import Estimate, Part
from orip.schemas.result import Blunder, Figure, InteriorOrientation, Motion, Result, VarianceComponent

RESIDUALS_FILE = "residuals.csv"

LONGEST_LEAF = 160
"""An object or list without others inside stands on one line if that line's own text is not longer than this."""


def result_document(solution: Solution) -> dict[str, object]:
    """Return the content of result.json as plain Python objects.

    Numbers that are not finite are None, apart from the standard deviation of a removed unknown, which is "singular".
    Units: mm for C, DX, DY and photo residuals, degrees for angles, ground units otherwise.
    """
    if not solution.is_large:
        return _document(solution, points_by_name(solution), None, RESIDUALS_FILE)
    columns = {name: column.rows(slice(None)) for name, column in point_columns(solution).items()}
    return _document(solution, {}, columns, RESIDUALS_FILE)


def _document(solution: Solution, points: object, point_columns: object, residuals_file: str) -> dict[str, object]:
    return _part(
        Result,
        solution,
        schema=SCHEMA,
        cameras=_cameras(solution),
        projections=dict(zip(solution.cameras.names, solution.projections, strict=True)),
        photos=_estimates(solution.photos, PHOTO_PARAMETERS),
        points=points,
        point_columns=point_columns,
        antennas=_antennas(solution),
        stations=_stations(solution),
        rigs=_rigs(solution),
        mountings=_mountings(solution),
        exposures=_exposures(solution),
        motions={row.photo: _part(Motion, row) for row in solution.motions},
        theodolites={row.set: {"R": _estimate(row.value, row.sd)} for row in solution.zero_directions},
        figures={row.name: _part(Figure, row) for row in solution.figures},
        down_weighted=_down_weighted(solution.residuals),
        blunders=[
            _part(Blunder, row, alternatives=row.alternatives.split("; ") if row.alternatives else [])
            for row in solution.blunders
        ],
        variance_components=[
            _part(VarianceComponent, row, factor=_estimate(row.factor, row.sd)) for row in solution.variance_components
        ],
        interior={
            group: {row.name: _part(InteriorOrientation, row) for row in solution.interior if row.group == group}
            for group in ("templates", "photos")
        },
        inputs=dict(solution.inputs),
        residuals_file=residuals_file,
        warnings=[{"code": code, "where": where, "text": text} for code, where, text in solution.warnings],
    )


_fields = cache(msgspec.structs.fields)


def _part(kind: type[Part], row: object, **others: object) -> dict[str, object]:
    """Return a part of the document with the keys of its type: what is not given is an attribute of the row."""
    return {
        field.name: others[field.name] if field.name in others else _written(field.type, row, field.name)
        for field in _fields(kind)
    }


def _written(kind: object, row: object, name: str) -> object:
    """Return an attribute as a type of the documents has it; the standard deviation of NAME is NAME_sd."""
    value = getattr(row, name)
    if kind is Estimate:
        return _estimate(value, getattr(row, f"{name}_sd"))
    if kind is int or kind is bool:
        return kind(value)
    parts = get_args(kind)
    if get_origin(kind) is list:
        return [_part(parts[0], entry) for entry in value]
    if kind is float or float in parts:
        return SINGULAR if _SINGULAR in parts and math.isinf(value) else _number(value)
    return value


_SINGULAR = Literal["singular"]


def result_text(solution: Solution) -> str:
    """Return result.json as text: indented, short objects on one line, shortest exact floats, a newline at the end."""
    return "".join(result_pieces(solution))


def result_pieces(solution: Solution, residuals_file: str = RESIDUALS_FILE) -> Iterator[str]:
    """Yield the text of result.json in pieces, so that a million points need little memory.

    `residuals_file` is the name of the file with the residuals, beside it.
    """
    points, columns = ({}, point_columns(solution)) if solution.is_large else (Points(solution), None)
    yield from _json_pieces(_document(solution, points, columns, residuals_file), "")
    yield "\n"


def _number(value: float) -> float | None:
    # numpy scalars are not JSON, and JSON has neither NaN nor infinity
    number = float(value)
    return number if math.isfinite(number) else None


def _estimate(value: float, sd: float) -> dict[str, object]:
    return {"value": _number(value), "sd": SINGULAR if math.isinf(sd) else _number(sd)}


def _estimates(estimates: Estimates, parameters: Sequence[str]) -> dict[str, dict[str, object]]:
    return {
        name: {parameter: _estimate(*pair) for parameter, *pair in zip(parameters, values, sds, strict=True)}
        for name, values, sds in zip(estimates.names, estimates.values.tolist(), estimates.sd.tolist(), strict=True)
    }


def _cameras(solution: Solution) -> dict[str, dict[str, object]]:
    cameras = _estimates(solution.cameras, CAMERA_PARAMETERS)
    for parameter in solution.additional:
        cameras[parameter.camera][parameter.name] = _estimate(parameter.value, parameter.sd)
    return cameras


def _antennas(solution: Solution) -> dict[str, dict[str, object]]:
    """Return the parameters of each antenna and its session, and those of its strips under ``strips``."""
    found: dict[str, dict[str, object]] = {}
    strips: dict[str, dict[str, dict[str, object]]] = {}
    for row in solution.antennas:
        own = found.setdefault(row.antenna, {})
        of_strips = strips.setdefault(row.antenna, {})
        holder = of_strips.setdefault(row.strip, {}) if row.strip else own
        holder[row.name] = _estimate(row.value, row.sd)
    return {name: {**own, "strips": strips[name]} for name, own in found.items()}


def _rigs(solution: Solution) -> list[dict[str, object]]:
    """Return the relative orientation of each two cameras that move together."""
    found: dict[tuple[str, str], dict[str, object]] = {}
    for row in solution.rigs:
        rig = found.setdefault(
            (row.first, row.second), {"first": row.first, "second": row.second, "instants": row.instants}
        )
        rig[row.name] = {**_estimate(row.value, row.sd), "scatter": _number(row.scatter)}
    return list(found.values())


def _mountings(solution: Solution) -> dict[str, dict[str, dict[str, object]]]:
    """Return the parameters of the mounting of each camera of each rig."""
    found: dict[str, dict[str, dict[str, object]]] = {}
    for row in solution.mountings:
        found.setdefault(row.rig, {}).setdefault(row.camera, {})[row.name] = _estimate(row.value, row.sd)
    return found


def _exposures(solution: Solution) -> dict[str, dict[str, object]]:
    """Return rig, place and rotation of each exposure."""
    found: dict[str, dict[str, object]] = {}
    for row in solution.rig_exposures:
        found.setdefault(row.exposure, {"rig": row.rig})[row.name] = _estimate(row.value, row.sd)
    return found


def _stations(solution: Solution) -> dict[str, dict[str, object]]:
    """Return strip and time of each photo with a station, and the residuals of its position and attitude."""
    found: dict[str, dict[str, object]] = {
        exposure.photo: {"strip": exposure.strip or None, "time": _number(exposure.time)}
        for exposure in solution.exposures
    }
    kinds: tuple[tuple[Literal["position", "attitude"], str, tuple[str, ...]], ...] = (
        ("position", "", PHOTO_PARAMETERS[:3]),
        ("attitude", "attitude_", PHOTO_PARAMETERS[3:]),
    )
    for what, prefix, components in kinds:
        rows = station_residuals(solution, what)
        names = [component.removesuffix("0") for component in components]
        for row, exposure in enumerate(rows.exposures):
            entry = found.setdefault(exposure.photo, {"strip": None, "time": None})
            for key, values in (("residual", rows.residual), ("w", rows.w), ("weight_factor", rows.weight_factor)):
                entry[prefix + key] = {
                    name: _number(value) for name, value in zip(names, values[row].tolist(), strict=True)
                }
    return found


def points_by_name(solution: Solution) -> dict[str, dict[str, object]]:
    """Return the points of a solution as plain Python objects, by name."""
    points = _estimates(solution.points, ("X", "Y", "Z"))
    for point, rays, kind in zip(points.values(), solution.point_rays.tolist(), solution.point_kinds, strict=True):
        point.update(rays=rays, kind=kind)
    return points


def _down_weighted(residuals: Residuals) -> list[dict[str, object]]:
    return [
        {
            "kind": residuals.kind[i],
            "photo": residuals.photo[i],
            "point": residuals.point[i],
            "component": residuals.component[i],
            "residual": _number(residuals.residual[i]),
            "standard_residual": _number(residuals.standard_residual[i]),
            "weight_factor": _number(residuals.weight_factor[i]),
        }
        for i in np.flatnonzero(residuals.weight_factor < 1.0).tolist()
    ]


def _json_pieces(node: object, margin: str) -> Iterator[str]:
    inner = margin + INDENT
    if isinstance(node, Points | Column):
        yield from node.pieces(margin)
        return
    if not isinstance(node, dict | list) or not node:
        yield compact(node)
        return
    entries = list(node.values()) if isinstance(node, dict) else node
    if not any(isinstance(entry, dict | list | Points | Column) for entry in entries):
        line = compact(node)
        if len(line) <= LONGEST_LEAF:
            yield line
            return
    labels = [f"{compact(key)}: " for key in node] if isinstance(node, dict) else [""] * len(entries)
    yield "{" if isinstance(node, dict) else "["
    for number, (label, entry) in enumerate(zip(labels, entries, strict=True)):
        yield f"{',' if number else ''}\n{inner}{label}"
        yield from _json_pieces(entry, inner)
    yield f"\n{margin}" + ("}" if isinstance(node, dict) else "]")
