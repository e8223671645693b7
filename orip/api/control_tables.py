"""Arrays and tables of control that a caller hands over: shapes, types and numbers; all that is wrong is named."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orip.api.given import ControlPoints, Directions, Distances, Elements, Figures, PreliminaryPoints, Stations
from orip.arrays import BoolArray, FloatArray
from orip.errors import Complaint, ProjectWarning
from orip.files.control.preliminary_text import parse_preliminary
from orip.files.control.stations_text import parse_stations
from orip.files.control.text import parse_directions, parse_distances, parse_elements, parse_figures, parse_points
from orip.files.text.decimal_numbers import LARGEST_NUMBER, parse_number
from orip.files.text.shown import Parsed, printable, shown_token
from orip.records.control import (
    ControlDirection,
    ControlDistance,
    ControlElement,
    ControlPoint,
    FigurePoint,
    PreliminaryPoint,
    Station,
)
from orip.records.names import name_fault
from orip.structs import replace

_MOST_OF_A_COLUMN = 20
"""Complaints of one array that are given one by one."""

Element = TypeVar("Element", bound=np.generic)


class Columns:
    """Takes the arrays of one table and keeps what is wrong with them.

    Parameters
    ----------
    table : str
        What it is called in messages, such as "photo_points".
    """

    def __init__(self, table: str) -> None:
        self.table = table
        self.complaints: list[Complaint] = []
        self.count: int | None = None
        """Rows, as the first array of names has them; None: it cannot be told."""
        self._first = ""

    def names(self, column: str, given: ArrayLike, *, may_be_one: bool = False) -> list[str] | None:
        """Return names, one a row; None, and complaints kept, where they are not fit for use.

        Parameters
        ----------
        column : str
        given : (n,) of str
        may_be_one : bool
            A single text stands for all rows.
        """
        found = [given] * (self.count or 0) if may_be_one and isinstance(given, str) else self._listed(column, given)
        if found is None or not self._has_length(column, len(found)):
            return None
        faults = [(row, fault) for row, name in enumerate(found) if (fault := _fault_of(name)) is not None]
        self.complain_of(column, faults)
        return None if faults else [str(name) for name in found]

    def numbers(
        self, column: str, given: ArrayLike, width: int | None = None, *, unknown: bool = False
    ) -> FloatArray | None:
        """Return numbers, a row for each name; None, and complaints kept, where they are not fit for use.

        Parameters
        ----------
        column : str
        given : array (n,) or (n, width)
        width : int or None
            None: one number a row.
        unknown : bool
            NaN stands for what is not known, and one number or row for all of them. Numbers are finite otherwise.
        """
        found = self.array(column, given, width, may_be_one=unknown)
        if found is None:
            return None
        fit = np.abs(np.where(np.isnan(found), 0.0, found) if unknown else found) <= LARGEST_NUMBER
        wrong = [tuple(map(int, index)) for index in np.argwhere(~fit)]
        self.complain_of(column, [(index if width else index[0], _fault_of_number(found[index])) for index in wrong])
        return None if wrong else found

    def array(
        self, column: str, given: ArrayLike, width: int | None = None, *, may_be_one: bool = False
    ) -> FloatArray | None:
        """Return an array (n,) or (n, width) of any numbers; None, and a complaint kept, where it is none.

        Parameters
        ----------
        may_be_one : bool
            Anything that NumPy can broadcast to the shape will do.
        """
        return self._shaped(column, given, np.float64, width, may_be_one=may_be_one)

    def flags(self, column: str, given: ArrayLike, width: int) -> BoolArray | None:
        """Return an array (n, width) of bool; None, and a complaint kept, where it is none."""
        return self._shaped(column, given, np.bool_, width, may_be_one=False)

    def complain(self, message: str, column: str = "", row: object = None) -> None:
        """Keep a complaint about the table, about an array, or about an element of it."""
        index = "" if row is None else f"[{', '.join(map(str, row)) if isinstance(row, tuple) else row}]"
        self.complaints.append(Complaint(printable(message), f"{self.table}{'.' if column else ''}{column}{index}"))

    def _listed(self, column: str, given: ArrayLike) -> list[Any] | None:
        if self._masks(column, given):
            return None
        found = np.asarray(given, dtype=object)
        if found.ndim != 1:
            self.complain(f"has the shape {found.shape}; a list of names is needed", column)
            return None
        return list(found)

    def _shaped(
        self, column: str, given: ArrayLike, dtype: type[Element], width: int | None, *, may_be_one: bool
    ) -> NDArray[Element] | None:
        if self._masks(column, given):
            return None
        wanted = "(n,)" if width is None else f"(n, {width})"
        try:
            found = np.asarray(given)
        except ValueError:  # rows of different lengths
            self.complain(f"is not an array; its shape is {wanted}", column)
            return None
        kinds = "b" if dtype is np.bool_ else "iuf"
        if found.dtype.kind not in kinds and found.size:
            what = "True and False" if dtype is np.bool_ else "numbers"
            self.complain(f"is an array of {found.dtype}; {what} are needed", column)
            return None
        if self.count is None:
            return None
        shape = (self.count,) if width is None else (self.count, width)
        if may_be_one and _can_be_broadcast(found.shape, shape):
            return np.broadcast_to(found.astype(dtype), shape)
        if found.shape != shape and found.size + self.count:
            as_many = f" as {self._first} has {self.count} rows" if self._first else ""
            self.complain(f"has the shape {found.shape}; {shape} is needed{as_many}", column)
            return None
        return found.astype(dtype).reshape(shape)

    def _masks(self, column: str, given: ArrayLike) -> bool:
        """Return whether elements are masked; they are complained of, as NumPy would take what is under the mask."""
        masked = np.argwhere(np.ma.getmaskarray(given)) if isinstance(given, np.ma.MaskedArray) else ()
        places = [tuple(map(int, index)) for index in masked]
        message = "is masked; leave out the row, or write a value"
        self.complain_of(column, [(place if len(place) > 1 else place[0], message) for place in places])
        return bool(places)

    def _has_length(self, column: str, length: int) -> bool:
        if self.count is None:
            self.count, self._first = length, f"{self.table}.{column}"
        if length != self.count:
            self.complain(f"has {length} rows; {self.count} are needed as {self._first} has them", column)
        return length == self.count

    def complain_of(self, column: str, faults: Sequence[tuple[object, str]]) -> None:
        """Keep complaints about rows or elements, (index, message), the first of them one by one."""
        for row, fault in faults[:_MOST_OF_A_COLUMN]:
            self.complain(fault, column, row)
        if (more := len(faults) - _MOST_OF_A_COLUMN) > 0:
            self.complain(f"and {more} more of this kind", column)


def _fault_of_number(number: float) -> str:
    """Say what a measurement file would say of a number that is not fit."""
    try:
        parse_number(repr(float(number)))
    except ValueError as fault:
        return str(fault)
    return ""


def _fault_of(name: object) -> str | None:
    if not isinstance(name, str):
        return f"{shown_token(repr(name))} is not text; a name is text"
    fault = name_fault(name)
    return None if fault is None else f"{fault}; choose another name"


def _can_be_broadcast(given: tuple[int, ...], wanted: tuple[int, ...]) -> bool:
    try:
        return np.broadcast_shapes(given, wanted) == wanted
    except ValueError:
        return False


_UNKNOWN = "-"
_LINE = re.compile(r"\b(on )?line (\d+)\b")

Record = TypeVar("Record")
Records = Parsed[tuple[Record, ...]]


class _Field(NamedTuple):
    """A field of a line: the column of the table, and the place in its row if it has several."""

    column: str
    place: int | None
    text: str


def control_points(given: ControlPoints | None) -> Records[ControlPoint]:
    """Return control points; a coordinate that is NaN is not known, and has no error."""
    if given is None:
        return Parsed(())
    columns = Columns("control_points")
    names = columns.names("name", given.name)
    coordinates = columns.array("coordinates", given.coordinates, 3)
    error = columns.array("error", given.error, 3, may_be_one=True)
    if names is None or coordinates is None or error is None:
        return Parsed((), tuple(columns.complaints))
    known = ~np.isnan(coordinates)
    rows = [
        [_Field("name", None, name), *_numbers("coordinates", xyz), *_numbers("error", a)]
        for name, xyz, a in zip(names, coordinates, np.where(known, error, np.nan), strict=True)
    ]
    return _read(columns, rows, parse_points)


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


def stations(given: Stations | None) -> Records[Station]:
    """Return exposure stations; a position or attitude that is NaN was not observed."""
    if given is None:
        return Parsed(())
    columns = Columns("stations")
    names = columns.names("name", given.name)
    angles, angle_error = given.angles, given.angle_error
    if names is not None and angles is None:
        angles, angle_error = np.full((len(names), 3), np.nan), np.nan
    tables: dict[str, FloatArray | None] = {
        "coordinates": columns.array("coordinates", given.coordinates, 3),
        "error": columns.array("error", given.error, 3, may_be_one=True),
        "angles": columns.array("angles", np.nan if angles is None else angles, 3),
        "angle_error": columns.array("angle_error", np.nan if angle_error is None else angle_error, 3, may_be_one=True),
        "time": columns.array("time", np.nan if given.time is None else given.time, may_be_one=True),
    }
    strips: list[str] | None = [_UNKNOWN] * (columns.count or 0)
    if given.strip is not None:
        strips = columns.names("strip", given.strip, may_be_one=True)
    found = {column: table for column, table in tables.items() if table is not None}
    if names is None or strips is None or len(found) < len(tables):
        return Parsed((), tuple(columns.complaints))
    for values, error in (("coordinates", "error"), ("angles", "angle_error")):
        found[error] = np.where(np.isnan(found[values]), np.nan, found[error])
    rows = [
        [
            _Field("name", None, name),
            *(field for column in list(found)[:4] for field in _numbers(column, found[column][row])),
            _Field("time", None, _numbers("time", found["time"][row : row + 1])[0].text),
            _Field("strip", None, strip),
        ]
        for row, (name, strip) in enumerate(zip(names, strips, strict=True))
    ]
    return _read(columns, rows, parse_stations)


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
