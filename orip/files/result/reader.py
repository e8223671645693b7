"""result.json read back: its figures by name."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from orip.errors import InputError
from orip.files.result.identification import SCHEMA
from orip.files.result.json_points import SINGULAR
from orip.files.text.lines import sound_text
from orip.files.text.shown import printable, shown_token
from orip.records.names import record_key
from orip.records.results.result_tests import Figure, FigureGroup, Quantity, ResultFigures

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
    text = sound_text(path, shown)
    try:
        return _figures(json.loads(text, parse_constant=_refused))
    except _MalformedError as fault:
        reason = str(fault)
    except (ValueError, RecursionError) as fault:
        reason = "it is nested too deeply" if isinstance(fault, RecursionError) else f"it is not JSON: {fault}"
    message = f"this is not the result of an adjustment: {reason}; name a result.json that 'orip solve' wrote"
    raise InputError.single(message, shown)


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
