"""Exposure stations (.STA) and differences between them (.REL) as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from orip.errors import Complaint
from orip.files.control.covariances_text import CORRELATION_KEYS, correlation_cells, read_covariance
from orip.files.text.lines import FieldReader, TextLine, field_lines, read_lines
from orip.files.text.shown import Parsed
from orip.records.control import (
    ANGLE_ERRORS,
    GROUND_ERRORS,
    NOT_GIVEN,
    RATE_ERRORS,
    SPEED_ERRORS,
    ErrorLimits,
    Station,
    StationDifference,
    StationMotion,
    StationReference,
)
from orip.records.names import record_key
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

STATION_KEYS = (
    "photo", "X", "Y", "Z", "aX", "aY", "aZ", "OMEGA", "PHI", "KAPPA", "aOMEGA", "aPHI", "aKAPPA", "time", "strip",
    *CORRELATION_KEYS, "VX", "VY", "VZ", "aVX", "aVY", "aVZ", "WX", "WY", "WZ", "aWX", "aWY", "aWZ",
)  # fmt: skip
"""Fields of a line; those after the seventh may be missing from the end, in the groups of `OPTIONAL_KEYS`."""

_COUNTS = (7, 13, 14, 15, 18, 30, 36, 42)
_CORRELATIONS, _VELOCITY, _RATE = 15, 30, 36

OPTIONAL_KEYS = tuple(STATION_KEYS[first:end] for first, end in pairwise(_COUNTS))

_DECIMALS, _DECIMALS_OF_DEGREES, _COEFFICIENTS = 4, 10, 7

_FORM = (
    "photo X Y Z aX aY aZ, then OMEGA PHI KAPPA aOMEGA aPHI aKAPPA, time, strip, rXY rXZ rYZ, rXO ... rPK, VX VY VZ "
    "aVX aVY aVZ and WX WY WZ aWX aWY aWZ as far as known"
)
_UNKNOWN = "-"

Triple = tuple[float, float, float]


HEADINGS = ("CRS", "ANGLES")
"""First words of the lines before the stations that say what these refer to."""

_NAVIGATION = ("ROLL", "PITCH", "HEADING")
_ROTATIONS = ("OMEGA", "PHI", "KAPPA")


def read_stations(path: Path, shown: str) -> Parsed[tuple[Station, ...]]:
    """Read exposure stations: see `STATION_KEYS`; ground units, degrees, seconds.

    A file that is absent has no records.
    """
    return parse_stations(read_lines(path, shown, may_be_absent=True), shown)


def parse_stations(text: Parsed[list[str]], shown: str) -> Parsed[tuple[Station, ...]]:
    """Read a text as `read_stations` reads a file."""
    parsed = parse_stations_and_reference(text, shown)
    return Parsed(parsed.value[0], parsed.complaints)


def parse_stations_and_reference(
    text: Parsed[list[str]], shown: str
) -> Parsed[tuple[tuple[Station, ...], StationReference]]:
    """Read stations as they are written, and what they refer to.

    Lines before the first station may be ``CRS EPSG:4258`` and ``ANGLES ROLL PITCH HEADING``.
    """
    stations: list[Station] = []
    reference = StationReference()
    complaints: list[Complaint] = list(text.complaints)
    first_lines: dict[str, int] = {}
    for line in field_lines(text.value):
        reader = FieldReader(line, shown)
        if is_heading(line):
            reference = _with_heading(reader, reference, is_late=bool(first_lines))
            complaints += reader.complaints
            continue
        station = _read_station(reader)
        if station is not None:
            first = first_lines.setdefault(record_key(station.photo), line.number)
            if first != line.number:
                reader.complain(f"photo '{reader.shown_text(0)}' is already on line {first}; keep one of the two lines")
        complaints += reader.complaints
        if station is not None and not reader.complaints:
            stations.append(station)
    return Parsed((tuple(stations), reference), tuple(complaints))


def is_heading(line: TextLine) -> bool:
    """Return whether a line says what stations refer to."""
    return line.fields[0].text.upper() in HEADINGS and len(line.fields) < _COUNTS[0]


def _with_heading(reader: FieldReader, reference: StationReference, *, is_late: bool) -> StationReference:
    if is_late:
        reader.complain(f"{reader.shown_text(0)} stands after a station; write it before the first one", 0)
    if reader.text(0).upper() == "CRS":
        if reference.crs:
            reader.complain("a second CRS; all stations of a file are in one", 0)
        elif reader.has_fields((2,), "CRS and the coordinate reference system, such as EPSG:4258"):
            return replace(reference, crs=reader.text(1), line=reader.number)
        return reference
    words = tuple(reader.text(index).upper() for index in range(1, reader.count))
    if words not in {_NAVIGATION, _ROTATIONS}:
        reader.complain("write ANGLES ROLL PITCH HEADING, or ANGLES OMEGA PHI KAPPA", 0)
    return replace(reference, navigation=words == _NAVIGATION, line=reader.number)


def stations_text(stations: Sequence[Station], *, is_geographic: bool = False) -> str:
    """Return the lines of stations: coordinates to a tenth of a millimetre, angles to a millionth of a degree.

    Longitude and latitude have ten decimals of a degree, a hundredth of a millimetre.
    """
    rows = [_fields(station, _DECIMALS_OF_DEGREES if is_geographic else _DECIMALS) for station in stations]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        filled = len(row) - next((n for n, text in enumerate(reversed(row)) if text != _UNKNOWN), 0)
        count = next(count for count in _COUNTS if count >= filled)
        cells = [text.ljust(widths[0]) if n == 0 else text.rjust(widths[n]) for n, text in enumerate(row[:count])]
        lines.append("  ".join(cells).rstrip() + "\n")
    return "".join(lines)


def _fields(station: Station, decimals: int) -> list[str]:
    degrees = [angle / RADIANS_PER_DEGREE for angle in (*station.angles, *station.angle_error)]
    return [
        station.photo,
        *(_fixed(value, decimals) for value in station.position[:2]),
        *(_fixed(value, _DECIMALS) for value in (station.position[2], *station.position_error)),
        *(_fixed(value, 6) for value in degrees),
        _fixed(station.time, _DECIMALS),
        station.strip or _UNKNOWN,
        *correlation_cells(station.covariance, _DECIMALS if len(station.covariance or ()) == 3 else _COEFFICIENTS),
        *_motion_fields(station.motion or StationMotion()),
    ]


def _motion_fields(motion: StationMotion) -> list[str]:
    rates = [rate / RADIANS_PER_DEGREE for rate in (*motion.rate, *motion.rate_error)]
    return [_fixed(value, _DECIMALS) for value in (*motion.velocity, *motion.velocity_error, *rates)]


def _fixed(value: float, decimals: int) -> str:
    return _UNKNOWN if math.isnan(value) else f"{value:.{decimals}f}"


def _read_station(reader: FieldReader) -> Station | None:
    if not reader.has_fields(_COUNTS, _FORM) or reader.is_heading(range(1, 7)):
        return None
    photo = reader.name(0)
    position, position_error = observed_triple(reader, 1, GROUND_ERRORS, "position", "X, Y and Z")
    angles, angle_error = NOT_GIVEN, NOT_GIVEN
    if reader.count >= _COUNTS[1]:
        angles, angle_error = observed_triple(reader, 7, ANGLE_ERRORS, "attitude", "OMEGA, PHI and KAPPA")
    motion = _read_motion(reader)
    if math.isnan(position[0]) and math.isnan(angles[0]) and motion is None and not reader.complaints:
        reader.complain(f"photo '{reader.shown_text(0)}' has neither a position nor angles; remove the line")
    time = reader.number_or_dash(13) if reader.count > 13 else None
    strip = reader.text(14) if reader.count > 14 and reader.text(14) != _UNKNOWN else ""
    return Station(
        photo=photo,
        position=position,
        position_error=position_error,
        angles=radians(angles),
        angle_error=radians(angle_error),
        covariance=read_covariance(
            reader, (*position_error, *radians(angle_error)), _CORRELATIONS, len(CORRELATION_KEYS)
        ),
        time=math.nan if time is None else time,
        strip=strip,
        motion=motion,
        line=reader.number,
    )


def _read_motion(reader: FieldReader) -> StationMotion | None:
    """Return the motion; None where neither a velocity nor an angular rate is known."""
    velocity, velocity_error, rate, rate_error = (NOT_GIVEN,) * 4
    if reader.count > _VELOCITY:
        velocity, velocity_error = observed_triple(reader, _VELOCITY, SPEED_ERRORS, "velocity", "VX, VY and VZ")
    if reader.count > _RATE:
        rate, rate_error = observed_triple(reader, _RATE, RATE_ERRORS, "angular rate", "WX, WY and WZ")
    for start, errors in ((_VELOCITY + 3, velocity_error), (_RATE + 3, rate_error)):
        for index, error in enumerate(errors, start):
            if error < 0.0:
                reader.complain("an error of a motion is 0 or above; write '-' for a motion that is not known", index)
    if math.isnan(velocity[0]) and math.isnan(rate[0]):
        return None
    return StationMotion(velocity, velocity_error, radians(rate), radians(rate_error))


def observed_triple(
    reader: FieldReader, start: int, limits: ErrorLimits, what: str, keys: str
) -> tuple[Triple, Triple]:
    """Return three values and their a-priori errors, from a field on; all six are '-' where nothing was observed."""
    fields = range(start, start + 6)
    unknown = [reader.text(index) == _UNKNOWN for index in fields]
    if all(unknown):
        return NOT_GIVEN, NOT_GIVEN
    if any(unknown):
        index = fields[unknown.index(True)]
        message = f"'-' for a part of the {what}; give {keys} and their errors, six numbers, or '-' for all six" + (
            " (a single one is given as an element in the .ELE file)" if start < _VELOCITY else ""
        )
        reader.complain(message, index)
    values = [reader.number_or_dash(index) for index in fields[:3]]
    errors = [reader.error_or_dash(index, limits) for index in fields[3:]]
    return _triple(values), _triple(errors)


def _triple(values: Sequence[float | None]) -> Triple:
    first, second, third = (math.nan if value is None else value for value in values)
    return first, second, third


def radians(angles: Triple) -> Triple:
    """Return three angles in degrees in radians; NaN as they are."""
    return NOT_GIVEN if math.isnan(angles[0]) else _triple([angle * RADIANS_PER_DEGREE for angle in angles])


DIFFERENCE_KEYS = (
    "first", "second", "dX", "dY", "dZ", "aX", "aY", "aZ", "dOMEGA", "dPHI", "dKAPPA", "aOMEGA", "aPHI", "aKAPPA",
    *CORRELATION_KEYS,
)  # fmt: skip
"""Fields of a line; those from the ninth on may be missing in the groups of `OPTIONAL_DIFFERENCE_KEYS`."""

OPTIONAL_DIFFERENCE_KEYS = (DIFFERENCE_KEYS[8:14], DIFFERENCE_KEYS[14:])

_FORM_OF_DIFFERENCE = (
    "first second dX dY dZ aX aY aZ, then dOMEGA dPHI dKAPPA aOMEGA aPHI aKAPPA, "
    f"{len(CORRELATION_KEYS)} coefficients of correlation {CORRELATION_KEYS[0]} {CORRELATION_KEYS[1]} ... "
    f"{CORRELATION_KEYS[-1]} as far as known"
)
_COUNTS_OF_DIFFERENCE = (8, 14, len(DIFFERENCE_KEYS))


def read_differences(path: Path, shown: str) -> Parsed[tuple[StationDifference, ...]]:
    """Read differences between stations: see `DIFFERENCE_KEYS`; a file that is absent has no records."""
    return parse_differences(read_lines(path, shown, may_be_absent=True), shown)


def parse_differences(text: Parsed[list[str]], shown: str) -> Parsed[tuple[StationDifference, ...]]:
    """Read a text as `read_differences` reads a file."""
    found: list[StationDifference] = []
    complaints: list[Complaint] = list(text.complaints)
    first_lines: dict[frozenset[str], int] = {}
    for line in field_lines(text.value):
        reader = FieldReader(line, shown)
        difference = _read_difference(reader)
        if difference is not None:
            pair = frozenset({record_key(difference.first), record_key(difference.second)})
            first = first_lines.setdefault(pair, line.number)
            if len(pair) == 1:
                reader.complain(f"photo '{reader.shown_text(0)}' is both the first and the second; name two photos", 1)
            elif first != line.number:
                reader.complain(f"these two photos are already on line {first}; keep one of the two lines")
        complaints += reader.complaints
        if difference is not None and not reader.complaints:
            found.append(difference)
    return Parsed(tuple(found), tuple(complaints))


def _read_difference(reader: FieldReader) -> StationDifference | None:
    if not reader.has_fields(_COUNTS_OF_DIFFERENCE, _FORM_OF_DIFFERENCE) or reader.is_heading(range(2, 8)):
        return None
    first, second = reader.name(0), reader.name(1)
    position, position_error = observed_triple(reader, 2, GROUND_ERRORS, "position", "dX, dY and dZ")
    angles, angle_error = NOT_GIVEN, NOT_GIVEN
    if reader.count >= _COUNTS_OF_DIFFERENCE[1]:
        angles, angle_error = observed_triple(reader, 8, ANGLE_ERRORS, "rotation", "dOMEGA, dPHI and dKAPPA")
    if math.isnan(position[0]) and math.isnan(angles[0]) and not reader.complaints:
        reader.complain("the line has neither a difference of positions nor a rotation; remove it")
    errors = (*position_error, *(error * RADIANS_PER_DEGREE for error in angle_error))
    if 0.0 in errors:
        reader.complain("an error of 0; differences are observed, not constant: write an error above 0")
    return StationDifference(
        first, second, position, position_error, radians(angles), radians(angle_error),
        read_covariance(reader, errors, _COUNTS_OF_DIFFERENCE[1], len(CORRELATION_KEYS)), reader.number,
    )  # fmt: skip


_LENGTHS, _DEGREES = 5, 7
"""Decimals: a hundredth of a millimetre, a ten-millionth of a degree; rounded coefficients are to stay possible."""


def differences_text(differences: Sequence[StationDifference]) -> str:
    """Return the lines of differences, in columns."""
    rows = [_fields_of_difference(line) for line in differences]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "".join(
        "  ".join(
            text.ljust(width) if n < 2 else text.rjust(width)
            for n, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        + "\n"
        for row in rows
    )


def _fields_of_difference(line: StationDifference) -> list[str]:
    lengths = [*line.position, *line.position_error]
    degrees = [angle / RADIANS_PER_DEGREE for angle in (*line.angles, *line.angle_error)]
    return [
        line.first,
        line.second,
        *(_fixed(value, _LENGTHS) for value in lengths),
        *(_fixed(value, _DEGREES) for value in degrees),
        *correlation_cells(line.covariance, _COEFFICIENTS),
    ]
