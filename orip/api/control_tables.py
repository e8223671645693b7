"""Arrays and tables of control that a caller hands over: shapes, types and numbers; all that is wrong is named."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from orip.api.columns import Columns
from orip.api.given import (
    ControlPoints,
    Directions,
    Distances,
    Elements,
    Figures,
    GivenDirections,
    PreliminaryPoints,
    Stations,
)
from orip.arrays import FloatArray
from orip.errors import Complaint, ProjectWarning
from orip.files.control.covariances_text import CORRELATION_KEYS
from orip.files.control.preliminary_text import parse_preliminary
from orip.files.control.stations_text import parse_stations
from orip.files.control.text import parse_directions, parse_distances, parse_elements, parse_figures, parse_points
from orip.files.text.shown import Parsed
from orip.records.control import (
    ControlDirection,
    ControlDistance,
    ControlElement,
    ControlPoint,
    FigurePoint,
    GivenDirection,
    PointCorrelation,
    PreliminaryPoint,
    Station,
)
from orip.structs import replace

_SYMMETRIC = 1e-9
"""Part of the errors by which elements on both sides of the diagonal may differ."""

_UNCORRELATED = 1e-12


def errors_and_correlations(
    columns: Columns, given: ArrayLike, coordinates: FloatArray
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the a-priori errors (n, 3) and the coefficients of correlation (3 n, 3 n) of coordinates (n, 3).

    None for both where the covariances, (n, 3, 3) or (3 n, 3 n), are not fit for use; complaints are kept.
    """
    count = len(coordinates)
    try:
        found = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        columns.complain("is no array of numbers", "covariance")
        return None, None
    if found.shape not in {(count, 3, 3), (3 * count, 3 * count)}:
        shapes = f"({count}, 3, 3) or ({3 * count}, {3 * count})"
        columns.complain(f"has the shape {found.shape}; {shapes} is needed", "covariance")
        return None, None
    if np.isnan(coordinates).any():
        columns.complain("needs all coordinates; give error for points with NaN", "covariance")
        return None, None
    whole = _along_diagonal(found) if found.ndim == 3 else found
    variances = np.diagonal(whole)
    if not np.isfinite(whole).all() or not (variances > 0.0).all():
        wrong = int(np.flatnonzero(~(np.isfinite(whole).all(axis=1) & (variances > 0.0)))[0])
        columns.complain("has to be finite, and above 0 on the diagonal", "covariance", (wrong, wrong))
        return None, None
    errors = np.sqrt(variances)
    coefficients = whole / np.outer(errors, errors)
    if np.abs(coefficients - coefficients.T).max() > _SYMMETRIC:
        columns.complain("is not symmetric", "covariance")
        return None, None
    if np.linalg.eigvalsh(coefficients)[0] <= 0.0:
        columns.complain("is not positive definite; give the covariances as one adjustment has them", "covariance")
        return None, None
    return errors.reshape(-1, 3), coefficients


def with_correlations(
    points: tuple[ControlPoint, ...], coefficients: FloatArray | None
) -> tuple[tuple[ControlPoint, ...], tuple[PointCorrelation, ...]]:
    """Return n points with how their own coordinates are correlated (3 n, 3 n), and the correlated pairs of them."""
    if coefficients is None or len(coefficients) != 3 * len(points):
        return points, ()
    blocks = coefficients.reshape(len(points), 3, len(points), 3).transpose(0, 2, 1, 3)
    own = [
        replace(point, correlations=(float(block[0, 1]), float(block[0, 2]), float(block[1, 2])))
        if np.abs(block - np.eye(3)).max() > _UNCORRELATED
        else point
        for point, block in zip(points, blocks[np.arange(len(points)), np.arange(len(points))], strict=True)
    ]
    first, second = np.nonzero(np.triu(np.abs(blocks).max(axis=(2, 3)) > _UNCORRELATED, 1))
    pairs = (
        PointCorrelation(points[a].name, points[b].name, tuple(map(tuple, blocks[a, b].tolist())))
        for a, b in zip(first.tolist(), second.tolist(), strict=True)
    )
    return tuple(own), tuple(pairs)


def _along_diagonal(blocks: FloatArray) -> FloatArray:
    count = len(blocks)
    found = np.zeros((count, 3, count, 3))
    found[np.arange(count), :, np.arange(count), :] = blocks
    return found.reshape(3 * count, 3 * count)


_UNKNOWN = "-"
_LINE = re.compile(r"\b(on )?line (\d+)\b")

Record = TypeVar("Record")
Records = Parsed[tuple[Record, ...]]


class _Field(NamedTuple):
    """A field of a line: the column of the table, and the place in its row if it has several."""

    column: str
    place: int | None
    text: str


def control_points(
    given: ControlPoints | None,
) -> tuple[Records[ControlPoint], tuple[PointCorrelation, ...]]:
    """Return control points, and pairs that are correlated; a coordinate that is NaN is not known, and has no error."""
    if given is None:
        return Parsed(()), ()
    columns = Columns("control_points")
    names = columns.names("name", given.name)
    coordinates = columns.array("coordinates", given.coordinates, 3)
    error, correlated = _errors(columns, given, coordinates)
    if names is None or coordinates is None or error is None:
        return Parsed((), tuple(columns.complaints)), ()
    known = ~np.isnan(coordinates)
    rows = [
        [_Field("name", None, name), *_numbers("coordinates", xyz), *_numbers("error", a)]
        for name, xyz, a in zip(names, coordinates, np.where(known, error, np.nan), strict=True)
    ]
    found = _read(columns, rows, parse_points)
    points, pairs = with_correlations(found.value, correlated)
    return Parsed(points, found.complaints, found.warnings), pairs


def _errors(
    columns: Columns, given: ControlPoints, coordinates: FloatArray | None
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the a-priori errors (n, 3), and the coefficients of correlation (3 n, 3 n) where there are any."""
    if (given.error is None) == (given.covariance is None):
        columns.complain("has both or none of error and covariance; give one of the two")
        return None, None
    if given.error is not None:
        return columns.array("error", given.error, 3, may_be_one=True), None
    if given.covariance is None or coordinates is None:
        return None, None
    return errors_and_correlations(columns, given.covariance, coordinates)


def elements(given: Elements | None) -> Records[ControlElement]:
    """Return observed elements."""
    return _table("elements", given, ("name", "group", "kind"), ("value", "error"), parse_elements)


def distances(given: Distances | None) -> Records[ControlDistance]:
    """Return distances."""
    return _table("distances", given, ("name", "start", "end", "code"), ("distance", "error"), parse_distances)


def directions(given: Directions | None) -> Records[ControlDirection]:
    """Return theodolite directions; a zenith angle that is NaN was not observed."""
    zeniths: tuple[str, ...] = ("zenith", "zenith_error")
    if given is not None:
        observed = any(getattr(given, column) is not None for column in zeniths)
        given = replace(given, **{column: np.nan for column in zeniths if getattr(given, column) is None})
        zeniths = zeniths if observed else ()
    return _table("directions", given, ("set", "station", "target"), ("direction", "error", *zeniths), parse_directions)


def figures(given: Figures | None) -> Records[FigurePoint]:
    """Return points that lie on figures."""
    found = _table("figures", given, ("figure", "kind", "point"), ("error",), parse_figures)
    points = tuple(point for point in found.value if isinstance(point, FigurePoint))
    return Parsed(points, found.complaints, found.warnings)


def given_directions(given: GivenDirections | None) -> Records[GivenDirection]:
    """Return given directions from one point to another."""
    if given is None:
        return Parsed(())
    columns = Columns("given_directions")
    names, start, end = (columns.names(name, getattr(given, name)) for name in ("name", "start", "end"))
    along = columns.numbers("direction", given.direction, 3)
    error = columns.array("error", given.error, may_be_one=True)
    if names is None or start is None or end is None or along is None or error is None:
        return Parsed((), tuple(columns.complaints))
    rows = [
        [
            _Field("name", None, name), _Field("name", None, "DIRECTION"), _Field("start", None, first),
            _Field("error", None, repr(one)), _Field("end", None, last), *_numbers("direction", axis),
        ]
        for name, first, last, axis, one in zip(names, start, end, along, error.tolist(), strict=True)
    ]  # fmt: skip
    found = _read(columns, rows, parse_figures)
    lines = tuple(line for line in found.value if isinstance(line, GivenDirection))
    return Parsed(lines, found.complaints, found.warnings)


def stations(given: Stations | None) -> Records[Station]:
    """Return exposure stations; what is NaN was not observed."""
    if given is None:
        return Parsed(())
    columns = Columns("stations")
    names = columns.names("name", given.name)
    tables: dict[str, FloatArray | None] = {}
    for values, error in _OF_STATIONS.items():
        is_given = getattr(given, values) is not None
        for column in (values, error):
            numbers = getattr(given, column) if is_given else np.nan
            may_be_one = column == error or not is_given
            tables[column] = columns.array(column, np.nan if numbers is None else numbers, 3, may_be_one=may_be_one)
    time = columns.array("time", np.nan if given.time is None else given.time, may_be_one=True)
    strips: list[str] | None = [_UNKNOWN] * (columns.count or 0)
    if given.strip is not None:
        strips = columns.names("strip", given.strip, may_be_one=True)
    found = {column: table for column, table in tables.items() if table is not None}
    if names is None or strips is None or time is None or len(found) < len(tables):
        return Parsed((), tuple(columns.complaints))
    for values, error in _OF_STATIONS.items():
        found[error] = np.where(np.isnan(found[values]), np.nan, found[error])
    place_and_attitude, motion = list(found)[:4], list(found)[4:]
    rows = [
        [
            _Field("name", None, name),
            *(field for column in place_and_attitude for field in _numbers(column, found[column][row])),
            _Field("time", None, _numbers("time", time[row : row + 1])[0].text),
            _Field("strip", None, strip),
            *[_Field("error", None, _UNKNOWN)] * len(CORRELATION_KEYS),
            *(field for column in motion for field in _numbers(column, found[column][row])),
        ]
        for row, (name, strip) in enumerate(zip(names, strips, strict=True))
    ]
    return _read(columns, rows, parse_stations)


_OF_STATIONS = {"coordinates": "error", "angles": "angle_error", "velocity": "velocity_error", "rate": "rate_error"}
"""Columns of stations with three numbers each, in the order of the fields of a line, and those of their errors."""


def preliminary_points(given: PreliminaryPoints | None) -> Records[PreliminaryPoint]:
    """Return starting values of points."""
    if given is None:
        return Parsed(())
    columns = Columns("preliminary_points")
    names = columns.names("name", given.name)
    coordinates = columns.array("coordinates", given.coordinates, 3)
    if names is None or coordinates is None:
        return Parsed((), tuple(columns.complaints))
    rows = [
        [_Field("name", None, name), *_numbers("coordinates", xyz, unknown="nan")]
        for name, xyz in zip(names, coordinates, strict=True)
    ]
    return _read(columns, rows, parse_preliminary)


_MAY_BE_ONE = frozenset({"group", "kind", "code", "error", "zenith", "zenith_error"})
"""Columns that may be one word or number, valid for all rows."""


def _table(
    table: str,
    given: Elements | Distances | Directions | Figures | None,
    words: Sequence[str],
    numbers: Sequence[str],
    parse: Callable[[Parsed[list[str]], str], Records[Record]],
) -> Records[Record]:
    """Read a table whose columns have one word or number a row; zenith angles that are NaN are left out."""
    if given is None:
        return Parsed(())
    columns = Columns(table)
    listed: list[Any] = [columns.names(name, getattr(given, name), may_be_one=name in _MAY_BE_ONE) for name in words]
    for name in numbers:
        found = columns.array(name, getattr(given, name), may_be_one=name in _MAY_BE_ONE)
        listed.append(None if found is None else found.tolist())
    if any(column is None for column in listed):
        return Parsed((), tuple(columns.complaints))
    rows = []
    for row in zip(*listed, strict=True):
        texts = [text if isinstance(text, str) else repr(text) for text in row]
        fields = [_Field(column, None, text) for column, text in zip((*words, *numbers), texts, strict=True)]
        unobserved = [field.text for field in fields if field.column.startswith("zenith")] == ["nan", "nan"]
        rows.append(fields[:-2] if unobserved else fields)
    return _read(columns, rows, parse)


def _read(
    columns: Columns,
    rows: Sequence[Sequence[_Field]],
    parse: Callable[[Parsed[list[str]], str], Records[Record]],
) -> Records[Record]:
    """Read rows as lines of a control file; complaints name table, column and index in place of file and line."""
    parsed = parse(Parsed([" ".join(field.text for field in row) for row in rows]), columns.table)
    for complaint in parsed.complaints:
        _complain(columns, complaint, rows[(complaint.line or 1) - 1])
    warnings = tuple(
        ProjectWarning(
            warning.code,
            f"{columns.table}[{int(warning.where.rpartition(':')[2]) - 1}]",
            in_rows(warning.text),
        )
        for warning in parsed.warnings
    )
    return Parsed(parsed.value, tuple(columns.complaints), warnings)


def in_rows(message: str) -> str:
    """Return a message of a file's reader as one about arrays: rows count from 0, and NaN is what is not known."""
    rows = _LINE.sub(lambda found: f"{'in ' if found[1] else ''}row {int(found[2]) - 1}", message)
    return rows.replace("of the two lines", "of the two rows").replace(f"'{_UNKNOWN}'", "NaN")


def _complain(columns: Columns, complaint: Complaint, row: Sequence[_Field]) -> None:
    number = (complaint.line or 1) - 1
    if complaint.column is None:
        columns.complain(in_rows(complaint.message), "", number)
        return
    before = " ".join(field.text for field in row)[: complaint.column - 1]
    field = row[min(len(before.split()), len(row) - 1)]
    columns.complain(in_rows(complaint.message), field.column, number if field.place is None else (number, field.place))


def _numbers(column: str, values: FloatArray, unknown: str = _UNKNOWN) -> list[_Field]:
    return [
        _Field(column, place, unknown if np.isnan(value) else repr(value))
        for place, value in enumerate(values.tolist())
    ]
