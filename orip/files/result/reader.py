"""result.json read back, its figures by name; and points in it, of which a block may have a million."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.files.identification import SCHEMA
from orip.files.text.lines import sound_text
from orip.files.text.shown import json_fault, printable, shown_token
from orip.number_text import shortest_texts
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.records.results.tests import Figure, FigureGroup, Quantity, ResultFigures

# They are written some thousands at a time, without building a document of them.

SINGULAR = "singular"
INDENT = "  "

POINTS_PER_PIECE = 8192
ELEMENTS_PER_LINE = 1024
"""Of columns, which nobody reads element by element."""

compact = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
"""Returns JSON on one line."""


class Points(Struct, frozen=True):
    """The points of a solution, written without building a document of them: blocks have many."""

    solution: Solution

    def pieces(self, margin: str) -> Iterator[str]:
        """Yield the text; `margin` is what the lines of the object around them begin with."""
        points, rays, kinds = self.solution.points, self.solution.point_rays, self.solution.point_kinds
        if not points.names:
            yield "{}"
            return
        one = margin + INDENT
        entries = [f'"{axis}": {{"value": %s, "sd": %s}}' for axis in "XYZ"] + ['"rays": %s', '"kind": "%s"']
        form = f"\n{one}%s: {{" + ",".join(f"\n{one}{INDENT}{entry}" for entry in entries) + f"\n{one}}}"
        between = form.split("%s")
        yield "{"
        for start in range(0, len(points.names), POINTS_PER_PIECE):
            part = slice(start, start + POINTS_PER_PIECE)
            figures = [
                texts
                for k in range(3)
                for texts in (
                    _number_texts(points.values[part, k], "null"),
                    _number_texts(points.sd[part, k], f'"{SINGULAR}"'),
                )
            ]
            columns = [
                list(map(compact, points.names[part])),
                *figures,
                list(map(str, rays[part].tolist())),
                list(kinds[part]),
            ]
            yield ("," if start else "") + _woven(between, columns)
        yield f"\n{margin}}}"


class Column(Struct, frozen=True):
    """A list of `count` elements, of which `rows` returns some."""

    count: int
    rows: Callable[[slice], list[object]]

    def pieces(self, margin: str) -> Iterator[str]:
        """Yield the list as JSON, many elements on a line."""
        yield "["
        for start in range(0, self.count, ELEMENTS_PER_LINE):
            line = msgspec.json.encode(self.rows(slice(start, start + ELEMENTS_PER_LINE))).decode("utf-8")[1:-1]
            yield f"{',' if start else ''}\n{margin}{INDENT}{line}"
        yield f"\n{margin}]"


def point_columns(solution: Solution) -> dict[str, Column]:
    """Return the points of a solution as columns of equal length, by name."""
    points, count = solution.points, len(solution.points.names)
    columns: dict[str, Callable[[slice], list[object]]] = {"name": lambda rows: list(points.names[rows])}
    for k, axis in enumerate("XYZ"):
        columns[axis] = partial(_numbers, points.values[:, k], None)
        columns[f"{axis}_sd"] = partial(_numbers, points.sd[:, k], SINGULAR)
    columns["rays"] = lambda rows: solution.point_rays[rows].tolist()
    columns["kind"] = lambda rows: list(solution.point_kinds[rows])
    return {name: Column(count, rows) for name, rows in columns.items()}


def _numbers(values: FloatArray, infinite: str | None, rows: slice) -> list[object]:
    """Return some numbers as JSON has them: None for NaN, `infinite` for infinity."""
    some = values[rows]
    found: list[object] = some.tolist()
    for place in np.flatnonzero(~np.isfinite(some)).tolist():
        found[place] = None if np.isnan(some[place]) else infinite
    return found


def _woven(between: Sequence[str], columns: Sequence[Sequence[str]]) -> str:
    """Return the rows of columns of texts, separated by commas, with one more text around and between their cells."""
    count, width = len(columns[0]), 2 * len(columns) + 1
    row = [""] * width
    row[::2] = ["," + between[0], *between[1:]]
    cells = row * count
    for place, column in enumerate(columns):
        cells[2 * place + 1 :: width] = column
    cells[0] = between[0]
    return "".join(cells)


def _number_texts(values: FloatArray, infinite: str) -> list[str]:
    """Return numbers as JSON has them; `infinite` for infinity."""
    texts = shortest_texts(values, missing="null")
    for place in np.flatnonzero(np.isinf(values)).tolist():
        texts[place] = infinite
    return texts


_STATISTICS = ("sigma0", "sigma0_all", "redundancy", "redundancy_used", "observations", "unknowns")
_COUNTS = ("down_weighted", "singular", "blunders")
_QUANTITIES: Mapping[str, Quantity] = {
    **dict.fromkeys(("C", "DX", "DY"), "photo"),
    **dict.fromkeys(("X0", "Y0", "Z0", "X", "Y", "Z", "dX", "dY", "dZ"), "ground"),
    **dict.fromkeys(("OMEGA", "PHI", "KAPPA", "R"), "angle"),
}
_POWERS = {"A1": 1, "A3": 3, "A5": 5, "A7": 7, "A9": 9, "P1": 2, "P2": 2, "B1": 1, "B2": 1}
_RADIUS_MM = 10.0

_BEFORE_COLUMNS = "orip.result/1"
"""Its points are always by name."""

Found = dict[tuple[str, str], FigureGroup]


class _MalformedError(ValueError):
    """The document is JSON, but not that of a result; the message says where."""


def read_result(path: Path, shown: str) -> ResultFigures:
    """Read the figures of a result.json: those of the whole adjustment, of cameras, photos, points and check points.

    The course of the adjustment (iterations, ENP, inputs, messages) is left out.

    Raises
    ------
    InputError
        If the file cannot be read or is no result.
    """
    text, line, column = sound_text(path, shown), None, None
    try:
        return _figures(json.loads(text, parse_constant=_refused))
    except _MalformedError as fault:
        reason = str(fault)
    except json.JSONDecodeError as fault:
        reason, line, column = json_fault(fault), fault.lineno, fault.colno
    except RecursionError:
        reason = "it is nested too deeply"
    except ValueError as fault:
        reason = str(fault)
    message = f"this is not the result of an adjustment: {reason}; name a result.json that 'orip solve' wrote"
    raise InputError.single(message, shown, line, column)


def _refused(constant: str) -> None:
    message = f"JSON has no {constant}"
    raise ValueError(message)


def _figures(document: Any) -> ResultFigures:
    if not isinstance(document, dict) or document.get("schema") not in (SCHEMA, _BEFORE_COLUMNS):
        message = f'"schema" is not "{SCHEMA}"'
        raise _MalformedError(message)
    found: Found = {("", ""): FigureGroup("", _of_adjustment(document))}
    for group, kind in (("cameras", "camera"), ("photos", "photo"), ("points", "point")):
        for name, record in _object(document.get(group), group).items():
            shown = printable(f"{kind} {name}")
            key = name if kind == "point" else record_key(name)
            found[kind, key] = FigureGroup(shown, _of_record(_object(record, shown), shown))
    if document.get("point_columns") is not None:
        for name, record in _points_of_columns(_object(document["point_columns"], "point_columns")):
            shown = printable(f"point {name}")
            found["point", name] = FigureGroup(shown, _of_record(record, shown))
    for name, record in _object(document.get("theodolites", {}), "theodolites").items():
        shown = printable(f"theodolite {name}")
        found["theodolite", name] = FigureGroup(shown, _of_record(_object(record, shown), shown))
    for row in _objects(document.get("check_points"), "check_points"):
        name = _text(row.get("name"), "check_points")
        figures = {axis: Figure(_number(row.get(axis), name), _QUANTITIES[axis]) for axis in ("dX", "dY", "dZ")}
        found["check point", name] = FigureGroup(f"check point {name}", figures)
    for row in _objects(document.get("correlations"), "correlations"):
        pair = f"{_text(row.get('a'), 'correlations')} {_text(row.get('b'), 'correlations')}"
        found["correlation", record_key(pair)] = FigureGroup(
            f"correlation {pair}", {"r": Figure(_number(row.get("r"), pair), "other")}
        )
    return found


def _of_adjustment(document: Mapping[str, Any]) -> dict[str, Figure]:
    figures = {"status": Figure(_text(document.get("status"), "status"), "text")}
    figures["ground_unit"] = Figure(_text(document.get("ground_unit"), "ground_unit"), "text", adjusted=True)
    for name in _STATISTICS:
        figures[name] = Figure(_number(document.get(name), name), "other")
    for name in _COUNTS:
        figures[name] = Figure(float(len(_objects(document.get(name), name))), "other")
    return figures


def _of_record(record: Mapping[str, Any], where: str) -> dict[str, Figure]:
    figures: dict[str, Figure] = {}
    for key, entry in record.items():
        name = printable(key)
        if name == "kind":
            figures[name] = Figure(_text(entry, where), "text")
        elif name == "rays":
            figures[name] = Figure(_number(entry, where), "other")
        else:
            estimate = _object(entry, f"{where} {name}")
            quantity = _QUANTITIES.get(name, "other")
            sd = estimate.get("sd")
            deviation = None if sd == SINGULAR else _number(sd, f"{where} {name}")
            effect = _RADIUS_MM ** _POWERS.get(name, 0)
            value = _number(estimate.get("value"), f"{where} {name}")
            figures[name] = Figure(value, quantity, deviation, adjusted=sd != SINGULAR, effect=effect)
            figures[f"{name} sd"] = Figure(SINGULAR if sd == SINGULAR else deviation, "other", effect=effect)
    return figures


def _points_of_columns(columns: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and record of each point of a large block."""
    names = ("name", "rays", "kind", *(f"{axis}{what}" for axis in "XYZ" for what in ("", "_sd")))
    for name in names:
        if not isinstance(columns.get(name), list) or len(columns[name]) != len(columns["name"]):
            raise _MalformedError(_not_so(f"point_columns {name}", "a list with an element for each point"))
    for name, rays, kind, *figures in zip(*(columns[name] for name in names), strict=True):
        estimates = {
            axis: {"value": value, "sd": sd} for axis, value, sd in zip("XYZ", figures[::2], figures[1::2], strict=True)
        }
        if not isinstance(name, str):
            raise _MalformedError(_not_so("point_columns name", "a list of texts"))
        yield name, {**estimates, "rays": rays, "kind": kind}


def _object(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise _MalformedError(_not_so(where, "an object"))
    return value


def _objects(value: Any, where: str) -> list[dict[str, Any]]:
    if not isinstance(value, list):
        raise _MalformedError(_not_so(where, "a list"))
    return [_object(element, where) for element in value]


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise _MalformedError(_not_so(where, "a text"))
    return printable(value)  # it may be shown on a terminal


def _number(value: Any, where: str) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > _LARGEST:
        raise _MalformedError(_not_so(where, "a number or null"))
    return float(value)


_LARGEST = 1.7976931348623157e308


def _not_so(where: str, allowed: str) -> str:
    return f"'{shown_token(where)}' is not {allowed}"
