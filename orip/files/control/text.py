"""Ground control as text: points (.PNT), elements (.ELE), distances (.LEN), directions (.DIR) and figures (.CON)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Generic, TypeVar, get_args

from orip.errors import Complaint, ProjectWarning
from orip.files.control.covariances_text import read_correlations
from orip.files.text.decimal_numbers import parse_number
from orip.files.text.lines import FieldReader, field_lines
from orip.files.text.shown import Parsed, shown_token
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.control import (
    ANGLE_ERRORS,
    COEFFICIENT_ERRORS,
    GROUND_ERRORS,
    PHOTO_ERRORS,
    TIME_ERRORS,
    ControlDirection,
    ControlDistance,
    ControlElement,
    ControlPoint,
    DistanceCode,
    ElementGroup,
    ErrorLimits,
    FigureKind,
    FigurePoint,
    GivenDirection,
)
from orip.records.names import look_alikes, record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.wording import counted

_UNKNOWN = "-"


def points_text(points: Sequence[ControlPoint]) -> str:
    """Return the lines of a .PNT file; errors of a coordinate that is known are known."""
    return "".join(
        " ".join([point.name, *map(_field, (*point.coordinates, *point.errors, *(point.correlations or ())))])
        + (" x" if point.rejected else "")
        + "\n"
        for point in points
    )


def elements_text(elements: Sequence[ControlElement]) -> str:
    """Return the lines of a .ELE file."""
    return "".join(f"{one.name} {one.group} {one.kind} {_field(one.value)} {_field(one.error)}\n" for one in elements)


def distances_text(distances: Sequence[ControlDistance]) -> str:
    """Return the lines of a .LEN file."""
    return "".join(
        f"{one.name} {one.start} {one.end} {one.code} {_field(one.distance)} {_field(one.error)}\n" for one in distances
    )


def _field(value: float | None) -> str:
    return _UNKNOWN if value is None else repr(float(value))


ELEMENT_KINDS: dict[ElementGroup, tuple[str, ...]] = {
    "CAMERA": CAMERA_PARAMETERS,
    "PHOTO": PHOTO_PARAMETERS,
    "POINT": ("X", "Y", "Z"),
    "THEODOLITE": ("R",),
}
"""Unknowns that a control element may observe, by group."""

CONTROL_EXTENSIONS = ("PNT", "ELE", "LEN", "DIR", "CON", "STA", "REL", "COV")
"""Of the control files of a project."""

_GROUPS: tuple[ElementGroup, ...] = get_args(ElementGroup)
_CODES: tuple[DistanceCode, ...] = get_args(DistanceCode)
_FIGURES: tuple[FigureKind, ...] = get_args(FigureKind)
_DIRECTION = "DIRECTION"
_NO_ZERO = "an a-priori error of 0 is not possible for a {}; write one above 0, or below to disregard"
_SIGNED_CODES = ("X", "Y", "Z")
_AXES = ("X", "Y", "Z")
_NUMBERS = 6
"""Of a control point: three coordinates and their errors."""

_CORRELATED = 9
"""Numbers of a control point with coefficients of correlation."""

Record = TypeVar("Record")


class _RecordList(Generic[Record]):
    """Records of one file, each known by a key that no other may have."""

    def __init__(self, shown: str) -> None:
        self.shown = shown
        self.records: list[Record] = []
        self.complaints: list[Complaint] = []
        self._first_lines: dict[Hashable, int] = {}

    def add(self, key: Hashable, title: str, record: Record | None, reader: FieldReader) -> None:
        """Take a record that was read without fault, or what was said of it."""
        first = self._first_lines.setdefault(key, reader.number)
        if first != reader.number:
            reader.complain(f"{title} is already on line {first}; keep one of the two lines")
        self.complaints += reader.complaints
        if record is not None and not reader.complaints:
            self.records.append(record)


def _read(
    text: Parsed[list[str]], shown: str, read_record: Callable[[FieldReader, _RecordList[Record]], None]
) -> Parsed[tuple[Record, ...]]:
    """Read the text of a control file line by line."""
    found: _RecordList[Record] = _RecordList(shown)
    for line in field_lines(text.value):
        read_record(FieldReader(line, shown), found)
    return Parsed(tuple(found.records), (*text.complaints, *found.complaints))


def parse_points(text: Parsed[list[str]], shown: str) -> Parsed[tuple[ControlPoint, ...]]:
    """Read control points: ``name X Y Z aX aY aZ [rXY rXZ rYZ] [x]``, ground units.

    A coordinate and its error may both be ``-``: not known. A last field ``x`` rejects the point.
    """
    if (blank := _blanks_in_names(text.value, shown)) is not None:
        return Parsed((), (*text.complaints, blank))
    parsed = _read(text, shown, _read_point)
    lines = {point.name: point.line for point in parsed.value}
    warnings = tuple(_similar_names(names, lines, shown) for names in look_alikes(lines))
    return Parsed(parsed.value, parsed.complaints, warnings)


def _blanks_in_names(lines: list[str], shown: str) -> Complaint | None:
    """Return one complaint for all names that seem to have blanks: words before six numbers on most lines."""
    readers = [FieldReader(line, shown) for line in field_lines(lines)]
    # a number that begins several lines is no name, but a part of one
    first_words = Counter(reader.text(0) for reader in readers)
    found = [reader for reader in readers if _has_blank(reader, first_words[reader.text(0)] > 1)]
    if 2 * len(found) <= len(readers):
        return None
    first = found[0]
    words = [first.shown_text(index) for index in range(first.count - _NUMBERS)]
    text = (
        f"names cannot have blanks, and '{' '.join(words)}' seems to be one; write {'_'.join(words)} or "
        f"{''.join(words)}, here and in the measurements ({counted(len(found), 'line')} of this file)"
    )
    return Complaint(text, shown, first.number)


def _has_blank(reader: FieldReader, begins_several: bool) -> bool:
    """Tell whether a line has six numbers and words before them, the first of which is none, or begins other lines.

    Nine numbers are those of a point with coefficients of correlation, and not three words and six numbers.
    """
    if reader.count <= 1 + _NUMBERS or (_is_number(reader.text(0)) and not begins_several):
        return False
    numbers = [field == "-" or _is_number(field) for field in map(reader.text, range(1, reader.count))]
    return all(numbers[-_NUMBERS:]) and not (len(numbers) == _CORRELATED and all(numbers))


def _is_number(field: str) -> bool:
    try:
        parse_number(field)
    except ValueError:
        return False
    return True


def _similar_names(names: Sequence[str], lines: dict[str, int], shown: str) -> ProjectWarning:
    listed = " and ".join(f"'{shown_token(name)}' (line {lines[name]})" for name in names)
    text = f"points {listed} differ only in case or leading zeros; rename one if they are the same point"
    return ProjectWarning("similar-names", f"{shown}:{lines[names[-1]]}", text)


def _read_point(reader: FieldReader, found: _RecordList[ControlPoint]) -> None:
    form = "name X Y Z aX aY aZ, then rXY rXZ rYZ if they are known, and x if the point is rejected"
    if not reader.has_fields((7, 8, 10, 11), form) or reader.is_heading(range(1, 7)):
        found.complaints += reader.complaints
        return
    name = reader.name(0)
    coordinates = [reader.number_or_dash(index) for index in range(1, 4)]
    errors = [reader.error_or_dash(index, GROUND_ERRORS) for index in range(4, 7)]
    dashes = [reader.text(index) == "-" for index in range(1, 7)]
    for axis in range(3):
        _check_dashes(reader, axis, dashes)
    if all(dashes[:3]):
        reader.complain(
            f"point '{reader.shown_text(0)}' has no coordinate at all; give one at least or remove the line"
        )
    rejected, last = reader.count in {8, 11}, reader.count - 1
    if rejected and reader.text(last) not in {"x", "X"}:
        message = f"'{reader.shown_text(last)}' is one field too many; only x (rejected) may be the last of so many"
        reader.complain(message, last)
    correlations = None
    if reader.count >= 10 and any(reader.text(index) != _UNKNOWN for index in (7, 8, 9)):
        found_coefficients = read_correlations(reader, errors, 7, 3)
        if found_coefficients is not None:
            correlations = (found_coefficients[0][1], found_coefficients[0][2], found_coefficients[1][2])
    point = ControlPoint(
        name,
        (coordinates[0], coordinates[1], coordinates[2]),
        (errors[0], errors[1], errors[2]),
        rejected,
        reader.number,
        correlations,
    )
    found.add(name, f"point '{reader.shown_text(0)}'", point, reader)


def _check_dashes(reader: FieldReader, axis: int, dashes: list[bool]) -> None:
    if dashes[axis] == dashes[axis + 3]:
        return
    missing, given = ("coordinate", "error") if dashes[axis] else ("error", "coordinate")
    message = (
        f"the {missing} of {_AXES[axis]} is '-' but its {given} is a number; "
        "write '-' for both if the coordinate is not known, else two numbers"
    )
    reader.complain(message, 1 + axis if dashes[axis] else 4 + axis)


def parse_elements(text: Parsed[list[str]], shown: str) -> Parsed[tuple[ControlElement, ...]]:
    """Read control elements: ``name GROUP KIND value a``; angles in degrees, see `ELEMENT_KINDS`."""
    return _read(text, shown, _read_element)


def _read_element(reader: FieldReader, found: _RecordList[ControlElement]) -> None:
    if not reader.has_fields((5,), "name GROUP KIND value a") or reader.is_heading((3, 4)):
        found.complaints += reader.complaints
        return
    name = reader.name(0)
    group = reader.word(1, _GROUPS, "an element group")
    kind = reader.word(2, ELEMENT_KINDS[group], f"a kind of {group}") if group is not None else None
    value = reader.decimal(3)
    error = reader.error(4, _error_limits(group, kind)) if group is not None and kind is not None else None
    if group is None or kind is None or error is None:
        found.complaints += reader.complaints
        return
    compared = record_key(name) if group in {"CAMERA", "PHOTO"} else name
    element = ControlElement(name, group, kind, value, error, reader.number)
    found.add((compared, group, kind), f"{kind} of {group} '{reader.shown_text(0)}'", element, reader)


def _error_limits(group: ElementGroup, kind: str) -> ErrorLimits:
    if group == "CAMERA":
        if kind == "READOUT":
            return TIME_ERRORS
        return PHOTO_ERRORS if kind in {"C", "DX", "DY"} else COEFFICIENT_ERRORS
    return GROUND_ERRORS if kind in {"X0", "Y0", "Z0", *_AXES} else ANGLE_ERRORS


def parse_distances(text: Parsed[list[str]], shown: str) -> Parsed[tuple[ControlDistance, ...]]:
    """Read distances: ``name from to CODE distance a``, ground units; X, Y and Z are signed (to minus from)."""
    return _read(text, shown, _read_distance)


def _read_distance(reader: FieldReader, found: _RecordList[ControlDistance]) -> None:
    if not reader.has_fields((6,), "name from to CODE distance a") or reader.is_heading((4, 5)):
        found.complaints += reader.complaints
        return
    name, start, end = reader.name(0), reader.name(1), reader.name(2)
    code = reader.word(3, _CODES, "a distance code")
    distance, error = reader.decimal(4), reader.error(5, GROUND_ERRORS)
    if start == end:
        reader.complain(
            f"distance '{reader.shown_text(0)}' goes from '{reader.shown_text(1)}' to itself; name two points", 2
        )
    if code is None:
        found.complaints += reader.complaints
        return
    if code not in _SIGNED_CODES and distance <= 0:
        reader.complain(
            f"distance '{reader.shown_text(0)}' of code {code} is {reader.shown_text(4)}; "
            "write a length above 0 (only X, Y and Z have a sign)",
            4,
        )
    record = ControlDistance(name, start, end, code, distance, error, reader.number)
    title = f"distance '{reader.shown_text(0)}' {code} from '{reader.shown_text(1)}' to '{reader.shown_text(2)}'"
    found.add((name, start, end, code), title, record, reader)


def parse_directions(text: Parsed[list[str]], shown: str) -> Parsed[tuple[ControlDirection, ...]]:
    """Read theodolite directions: ``set station target direction a [zenith a]``, degrees.

    All directions of a set are of one station, because a set has one zero direction.
    """
    parsed = _read(text, shown, _read_direction)
    return Parsed(parsed.value, (*parsed.complaints, *_moved_sets(parsed.value, shown)))


def _moved_sets(directions: Sequence[ControlDirection], shown: str) -> Iterator[Complaint]:
    first: dict[str, ControlDirection] = {}
    for direction in directions:
        known = first.setdefault(direction.set, direction)
        if known.station != direction.station:
            message = (
                f"set '{shown_token(direction.set)}' is at station '{shown_token(known.station)}' on line {known.line} "
                f"and at '{shown_token(direction.station)}' here; give each station sets of its own"
            )
            yield Complaint(message, shown, direction.line)


def _read_direction(reader: FieldReader, found: _RecordList[ControlDirection]) -> None:
    form = "set station target direction a, and zenith a if it was measured"
    if not reader.has_fields((5, 7), form) or reader.is_heading((3, 4)):
        found.complaints += reader.complaints
        return
    name, station, target = reader.name(0), reader.name(1), reader.name(2)
    direction, direction_error = reader.decimal(3), reader.error(4, ANGLE_ERRORS)
    zenith, zenith_error = (reader.decimal(5), reader.error(6, ANGLE_ERRORS)) if reader.count == 7 else (None, None)
    if station == target:
        reader.complain(
            f"set '{reader.shown_text(0)}' points from '{reader.shown_text(1)}' to itself; name two points", 2
        )
    for index, error in ((4, direction_error), (6, zenith_error)):
        if error == 0.0:
            reader.complain(
                "an a-priori error of 0 is not possible for a direction; write one above 0, or below to disregard",
                index,
            )
    record = ControlDirection(name, station, target, direction, direction_error, zenith, zenith_error, reader.number)
    title = f"the direction of set '{reader.shown_text(0)}' to '{reader.shown_text(2)}'"
    found.add((name, station, target), title, record, reader)


def parse_figures(text: Parsed[list[str]], shown: str) -> Parsed[tuple[FigurePoint | GivenDirection, ...]]:
    """Read points that lie on figures: ``figure KIND point a``, ground units; a figure is of one kind.

    Given directions are ``name DIRECTION from a to dX dY dZ``, the error in degrees.
    """
    parsed = _read(text, shown, _read_figure_point)
    return Parsed(parsed.value, (*parsed.complaints, *_other_kinds(parsed.value, shown)))


def _other_kinds(points: Sequence[FigurePoint | GivenDirection], shown: str) -> Iterator[Complaint]:
    first: dict[str, FigurePoint] = {}
    for point in points:
        if isinstance(point, GivenDirection):
            continue
        known = first.setdefault(point.figure, point)
        if known.kind != point.kind:
            message = (
                f"figure '{shown_token(point.figure)}' is a {known.kind} on line {known.line} and a {point.kind} here; "
                "give each figure a name of its own"
            )
            yield Complaint(message, shown, point.line)


def _read_given_direction(reader: FieldReader, found: _RecordList[FigurePoint | GivenDirection]) -> None:
    if not reader.has_fields((8,), "name DIRECTION from a to dX dY dZ"):
        found.complaints += reader.complaints
        return
    name, start, error, end = reader.name(0), reader.name(2), reader.error(3, ANGLE_ERRORS), reader.name(4)
    direction = (reader.decimal(5), reader.decimal(6), reader.decimal(7))
    if start == end:
        reader.complain(
            f"direction '{reader.shown_text(0)}' goes from '{reader.shown_text(2)}' to itself; name two points", 4
        )
    if direction == (0.0, 0.0, 0.0):
        reader.complain(f"direction '{reader.shown_text(0)}' has no length; give dX, dY or dZ other than 0", 5)
    if error == 0.0:
        reader.complain(_NO_ZERO.format("given direction"), 3)
    title = f"direction '{reader.shown_text(0)}' from '{reader.shown_text(2)}'"
    found.add((name, start), title, GivenDirection(name, start, end, direction, error, reader.number), reader)


def _read_figure_point(reader: FieldReader, found: _RecordList[FigurePoint | GivenDirection]) -> None:
    if reader.count > 1 and reader.text(1).upper() == _DIRECTION:
        _read_given_direction(reader, found)
        return
    if not reader.has_fields((4,), "figure KIND point a") or reader.is_heading((3,)):
        found.complaints += reader.complaints
        return
    figure, kind, point = reader.name(0), reader.word(1, _FIGURES, "a kind of figure"), reader.name(2)
    error = reader.error(3, GROUND_ERRORS)
    if error == 0.0:
        reader.complain(_NO_ZERO.format("point of a figure"), 3)
    record = None if kind is None else FigurePoint(figure, kind, point, error, reader.number)
    title = f"point '{reader.shown_text(2)}' of figure '{reader.shown_text(0)}'"
    found.add((figure, point), title, record, reader)
