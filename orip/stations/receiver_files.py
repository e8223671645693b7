"""Files of receivers and trajectories: solutions and time marks of RTKLIB, image logs, SBET and SMRMSG."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct, field

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.files.text.lines import read_bytes
from orip.files.text.shown import Parsed, shown_token
from orip.geometry.ground_ellipsoid import geographic_from_geocentric, place_axes
from orip.records.epochs import Epochs, Quality, epochs, seconds_of_date, seconds_of_week_time
from orip.stations.interpolation import WGS84
from orip.stations.table import LARGEST_PLACE, MOST_COMPLAINTS, Row, RowReader, text_rows
from orip.units import RADIANS_PER_DEGREE

# A line is: number of the photo, seconds of the GPS week, [week], offset from the antenna to the camera ``…,N`` ``…,E``
# ``…,V`` (mm, V downwards), position of the camera ``…,Lat`` ``…,Lon`` ``…,Ellh``, standard deviations north, east, up
# (m), and the kind of position ``50,Q`` (50 fixed, 34 float, 16 code). The position has the offset in it already
# (user manual of the Matrice 4 series, 2025, p. 92); the offset serves positions of the antenna that were computed
# afterwards.

_TAGS = ("N", "E", "V", "LAT", "LON", "ELLH")
_FORM = "number seconds [week] mm,N mm,E mm,V degrees,Lat degrees,Lon metres,Ellh sN, sE, sU code,Q"
_FIXED, _FLOAT = 50, range(32, 50)


def read_dji_mrk(path: Path, shown: str) -> Parsed[Epochs]:
    """Read an image log: the events at which photos were taken, with their numbers and positions."""
    reader = RowReader(shown)
    rows: list[tuple[float, ...]] = []
    for row in text_rows(path, reader, r"\s,"):
        if reader.is_full:
            break
        found = _read_mrk_row(reader, row)
        if found is not None:
            rows.append(found)
    return Parsed(_mrk_epochs(shown, np.array(rows, dtype=np.float64).reshape(len(rows), 13)), tuple(reader.complaints))


def _read_mrk_row(reader: RowReader, row: Row) -> tuple[float, ...] | None:
    """Return line, number, time, E, N, up, longitude, latitude, height, sE, sN, sU, flag."""
    before = len(reader.complaints)
    tags = {field.upper(): index for index, field in reversed(list(enumerate(row.fields)))}
    missing = [tag for tag in (*_TAGS, "Q") if tag not in tags]
    if missing or len(row.fields) < 4:
        reader.complain(f"{', '.join(missing) or 'fields'} missing; a line of an image log (.MRK) is: {_FORM}", row)
        return None
    number = reader.number(row, 0, 0.0, 1e9)
    week = re.fullmatch(r"\[(\d{1,5})\]", row.fields[2])
    seconds = reader.number(row, 1)
    time = seconds_of_week_time(float(week[1]), seconds) if week else math.nan
    if math.isnan(time) and not math.isnan(seconds):
        reader.complain(
            f"'{shown_token(row.fields[1])} {shown_token(row.fields[2])}' is not a time; write seconds and [GPS week]",
            row, 1,
        )  # fmt: skip
    north, east, down = (reader.number(row, tags[tag] - 1, -1e5, 1e5) / 1000.0 for tag in "NEV")
    latitude = reader.number(row, tags["LAT"] - 1, -90.0, 90.0) * RADIANS_PER_DEGREE
    longitude = reader.number(row, tags["LON"] - 1, -360.0, 360.0) * RADIANS_PER_DEGREE
    height = reader.number(row, tags["ELLH"] - 1, -LARGEST_PLACE, LARGEST_PLACE)
    start, end = tags["ELLH"] + 1, tags["Q"] - 1
    errors = reader.numbers(row, range(start, end)) if end - start == 3 else [math.nan] * 3
    flag = reader.number(row, end)
    if len(reader.complaints) > before:
        return None
    deviations = (errors[1], errors[0], errors[2])
    return (row.number, number, time, east, north, -down, longitude, latitude, height, *deviations, flag)


def _mrk_epochs(shown: str, rows: FloatArray) -> Epochs:
    flags = rows[:, 12].tolist()
    covariance = np.zeros((len(rows), 3, 3))
    covariance[:, range(3), range(3)] = rows[:, 9:12] ** 2
    return epochs(
        shown,
        rows[:, 0].astype(np.int64),
        number=rows[:, 1].astype(np.int64),
        time=rows[:, 2],
        to_camera=rows[:, 3:6],
        place=rows[:, 6:9],
        covariance=covariance,
        quality=tuple(_quality(flag) for flag in flags),
    )


def _quality(flag: float) -> Quality:
    return "fixed" if flag == _FIXED else "float" if int(flag) in _FLOAT else "code"


# A text whose comments begin with %; the last one before the data names the columns. Q 1 is fixed, 2 float, others code
# measurements. sdne, sdeu and sdun are roots of the sizes of covariances with their signs (RTKLIB, src/solution.c).

_SEPARATORS = r"\s,;"
_QUALITY: dict[int, Quality] = {1: "fixed", 2: "float", 6: "fixed"}
_TIME_SYSTEMS = ("GPST", "UTC", "JST")
_LEAST_RADIUS = 6e6
"""Metres from the centre of the Earth."""


class _Form(Struct):
    """How the columns of a file are to be read."""

    system: str = "GPST"
    kind: str = "geographic"
    sexagesimal: bool = False
    names: tuple[str, ...] = ()
    heights_are_orthometric: bool = False

    @property
    def width(self) -> int:
        """Return the number of fields of a place."""
        return 7 if self.sexagesimal else 3

    def hear(self, comment: str, row: Row) -> None:
        """Take in what a comment says of the columns."""
        words = [word.strip("%") for word in row.fields if word.strip("%")]
        if "lat/lon/height=" in comment.replace(" ", ""):
            self.heights_are_orthometric = "geodetic" in comment
        if words[:1] and words[0] in _TIME_SYSTEMS:
            self.system = words[0]
            self.names = tuple(re.sub(r"\(.*?\)", "", word) for word in words[1:])
            self.sexagesimal = "latitude(d'" in comment
            first = self.names[:1]
            self.kind = "geocentric" if first == ("x-ecef",) else "local" if first == ("e-baseline",) else "geographic"


class _Found(Struct):
    line: list[int] = field(default_factory=list)
    time: list[float] = field(default_factory=list)
    place: list[list[float]] = field(default_factory=list)
    covariance: list[FloatArray] = field(default_factory=list)
    quality: list[Quality] = field(default_factory=list)
    velocity: list[list[float]] = field(default_factory=list)


def read_rtklib_pos(path: Path, shown: str) -> Parsed[Epochs]:
    """Read a solution of RTKLIB: positions with their covariances, quality and, if written, velocities."""
    reader, form, found = RowReader(shown), _Form(), _Found()
    for row in text_rows(path, reader, _SEPARATORS):
        if reader.is_full:
            break
        if row.fields[0].startswith("%"):
            form.hear(" ".join(row.fields), row)
        else:
            _read_row(reader, row, form, found)
    if form.heights_are_orthometric:
        reader.complaints.append(_orthometric(shown))
    return Parsed(_epochs(shown, form, found), tuple(reader.complaints))


def _orthometric(shown: str) -> Complaint:
    return Complaint(
        "heights are above a geoid that the file does not name (its head says geodetic); "
        "let RTKLIB write ellipsoidal heights, orip takes them to those of the project",
        shown,
    )


def _read_row(reader: RowReader, row: Row, form: _Form, found: _Found) -> None:
    before = len(reader.complaints)
    start = 2
    if len(row.fields) < start + form.width + 1:
        reader.complain(
            f"a field is missing, {len(row.fields)} found; a row is: date time latitude longitude height Q ... "
            "(a .pos file of RTKLIB)",
            row,
        )
        return
    time = _time(reader, row, form)
    place = _place(reader, row, form)
    rest = start + form.width
    quality = reader.number(row, rest)
    deviations = _deviations(reader, row, rest + 2)
    velocity = _velocity(reader, row, form, rest)
    if len(reader.complaints) > before:
        return
    found.line.append(row.number)
    found.time.append(time)
    found.place.append(place)
    found.quality.append(_QUALITY.get(int(quality), "code"))
    found.covariance.append(_covariance(deviations, form))
    found.velocity.append(velocity)


def _time(reader: RowReader, row: Row, form: _Form) -> float:
    if "/" in row.fields[0]:
        try:
            return seconds_of_date(row.fields[0], row.fields[1], form.system)
        except (ValueError, OverflowError):
            seconds = math.nan
    else:
        seconds = seconds_of_week_time(reader.number(row, 0), reader.number(row, 1))
    if math.isnan(seconds):
        shown = shown_token(f"{row.fields[0]} {row.fields[1]}")
        reader.complain(f"'{shown}' is not a time; write yyyy/mm/dd hh:mm:ss.sss, or GPS week and seconds", row, 0)
    return seconds


def _place(reader: RowReader, row: Row, form: _Form) -> list[float]:
    if form.kind != "geographic":
        place = [reader.number(row, index, -LARGEST_PLACE, LARGEST_PLACE) for index in (2, 3, 4)]
        if form.kind == "geocentric" and math.dist(place, (0.0, 0.0, 0.0)) < _LEAST_RADIUS:
            reader.complain("these geocentric coordinates are of a place within the Earth", row, 2)
        return place
    if form.sexagesimal:
        latitude, longitude = (_sexagesimal(reader, row, index) for index in (2, 5))
        height = reader.number(row, 8, -LARGEST_PLACE, LARGEST_PLACE)
    else:
        latitude, longitude = reader.number(row, 2, -90.0, 90.0), reader.number(row, 3, -360.0, 360.0)
        height = reader.number(row, 4, -LARGEST_PLACE, LARGEST_PLACE)
    return [longitude * RADIANS_PER_DEGREE, latitude * RADIANS_PER_DEGREE, height]


def _sexagesimal(reader: RowReader, row: Row, index: int) -> float:
    degrees = reader.number(row, index, -360.0, 360.0)
    minutes, seconds = reader.number(row, index + 1, 0.0, 60.0), reader.number(row, index + 2, 0.0, 60.0)
    return math.copysign(abs(degrees) + minutes / 60.0 + seconds / 3600.0, -1.0 if row.fields[index][0] == "-" else 1.0)


def _deviations(reader: RowReader, row: Row, start: int) -> list[float]:
    if len(row.fields) < start + 6:
        return [math.nan] * 6
    return reader.numbers(row, range(start, start + 6))


def _covariance(deviations: Sequence[float], form: _Form) -> FloatArray:
    """Return the covariance matrix, along east, north and up of a geographic place."""
    squares = [math.copysign(value * value, value) for value in deviations]
    first, second, third, first_second, second_third, third_first = squares
    if form.kind == "geographic":  # sdn sde sdu sdne sdeu sdun
        north, east, up, north_east, east_up, up_north = squares
        return np.array([[east, north_east, east_up], [north_east, north, up_north], [east_up, up_north, up]])
    return np.array(
        [[first, first_second, third_first], [first_second, second, second_third], [third_first, second_third, third]]
    )


def _velocity(reader: RowReader, row: Row, form: _Form, rest: int) -> list[float]:
    """Return the velocity along east, north, up, if the head names its columns."""
    after = form.names[3:]
    if form.kind != "geographic" or not {"vn", "ve", "vu"} <= set(after):
        return [math.nan] * 3
    places = [rest + after.index(name) for name in ("ve", "vn", "vu")]
    return reader.numbers(row, places) if max(places) < len(row.fields) else [math.nan] * 3


def _epochs(shown: str, form: _Form, found: _Found) -> Epochs:
    count = len(found.line)
    place = np.array(found.place, dtype=np.float64).reshape(count, 3)
    covariance = np.array(found.covariance, dtype=np.float64).reshape(count, 3, 3)
    if form.kind == "geocentric":
        place = geographic_from_geocentric(place, WGS84)
        axes = place_axes(place)
        covariance = axes @ covariance @ np.swapaxes(axes, 1, 2)
    return epochs(
        shown,
        np.array(found.line, dtype=np.int64),
        time=np.array(found.time, dtype=np.float64),
        place=place,
        is_geographic=form.kind != "local",
        covariance=covariance,
        quality=tuple(found.quality),
        velocity=np.array(found.velocity, dtype=np.float64).reshape(count, 3),
    )


# SBET: records of 17 little-endian float64: seconds of the GPS week, latitude, longitude (radians), height above the
# ellipsoid (m), velocity along x, y, z (m/s), roll, pitch, platform heading, wander angle (radians), acceleration,
# rates. The axes of the velocity are level: x is turned from north by the wander angle, counterclockwise, y is to its
# left, z up; hence true heading = platform heading - wander angle.
#
# SMRMSG: records of 10: seconds, deviations north, east, down (m), of the velocity, of roll, pitch, heading (minutes of
# arc).


_FIELDS, _DEVIATION_FIELDS = 17, 10
_TIME, _LATITUDE, _LONGITUDE, _HEIGHT, _VELOCITY, _ROLL, _HEADING, _WANDER = 0, 1, 2, 3, 4, 7, 9, 10

_FASTEST = 1000.0
"""m/s; what is faster is no velocity of an aeroplane."""


def read_sbet(path: Path, shown: str, deviations: Path | None = None, shown_deviations: str = "") -> Parsed[Epochs]:
    """Read a trajectory, and its standard deviations from the file beside it if there is one."""
    records, complaints = _records(path, shown, _FIELDS, "SBET")
    complaints += _impossible(records, shown)
    errors, angle_errors = np.full((len(records), 3), np.nan), np.full((len(records), 3), np.nan)
    if deviations is not None and not complaints:
        errors, angle_errors, more = _sbet_deviations(deviations, shown_deviations, records[:, _TIME])
        complaints += more
    covariance = np.full((len(records), 3, 3), np.nan)
    if deviations is not None:
        covariance = errors[:, :, None] * np.eye(3) * errors[:, None, :]
    angles = records[:, _ROLL : _HEADING + 1].copy()
    angles[:, 2] -= records[:, _WANDER]
    return Parsed(
        epochs(
            shown,
            np.arange(1, len(records) + 1),
            time=records[:, _TIME],
            has_week=False,
            place=records[:, [_LONGITUDE, _LATITUDE, _HEIGHT]],
            covariance=covariance,
            velocity=_along_east_north_up(records[:, _VELOCITY:_ROLL], records[:, _WANDER]),
            angles=angles,
            angle_error=angle_errors,
        ),
        tuple(complaints),
    )


def _along_east_north_up(velocity: FloatArray, wander: FloatArray) -> FloatArray:
    """Return velocities (n, 3) in wander axes along east, north and up."""
    (x, y, up), cosine, sine = velocity.T, np.cos(wander), np.sin(wander)
    return np.column_stack([-x * sine - y * cosine, x * cosine - y * sine, up])


def _records(path: Path, shown: str, fields: int, what: str) -> tuple[FloatArray, list[Complaint]]:
    data, complaints = read_bytes(path, shown)
    data = data or b""
    size = 8 * fields
    faults = list(complaints)
    if not faults and (len(data) % size or not data):
        message = (
            f"the file has {len(data)} bytes, but {what} has records of {size} bytes; it is cut off, or of another kind"
        )
        faults.append(Complaint(message, shown))
    whole = 0 if faults else len(data) // size
    return np.frombuffer(data, "<f8", whole * fields).reshape(whole, fields).astype(np.float64), faults


def _impossible(records: FloatArray, shown: str) -> list[Complaint]:
    limits = np.full(_FIELDS, np.inf)
    limits[[_LATITUDE, _LONGITUDE, _HEIGHT]] = 0.5 * np.pi, 2.0 * np.pi, LARGEST_PLACE
    limits[_VELOCITY:_ROLL] = _FASTEST
    limits[_ROLL : _WANDER + 1] = 4.0 * np.pi
    with np.errstate(invalid="ignore"):
        fit = (np.isfinite(records) & (np.abs(records) <= limits)).all(axis=1)
    return [
        Complaint(
            "this record has numbers that cannot be a place, velocity and attitude; the file is damaged, or not "
            "an SBET of little-endian numbers",
            shown,
            int(row) + 1,
        )
        for row in np.flatnonzero(~fit)[:MOST_COMPLAINTS]
    ]


def _sbet_deviations(path: Path, shown: str, time: FloatArray) -> tuple[FloatArray, FloatArray, list[Complaint]]:
    """Return deviations east, north, up (m) and of roll, pitch, heading (radians) at times."""
    records, complaints = _records(path, shown, _DEVIATION_FIELDS, "SMRMSG")
    nothing = np.full((len(time), 3), np.nan)
    with np.errstate(invalid="ignore"):
        fit = (np.isfinite(records) & (records >= 0.0)).all(axis=1)
    complaints += [
        Complaint("this record has numbers that cannot be standard deviations", shown, int(row) + 1)
        for row in np.flatnonzero(~fit)[:MOST_COMPLAINTS]
    ]
    if complaints:
        return nothing, nothing, complaints
    if (np.diff(records[:, 0]) <= 0.0).any():
        row = int(np.flatnonzero(np.diff(records[:, 0]) <= 0.0)[0]) + 2
        return nothing, nothing, [Complaint("this record is not later than the one before it", shown, row)]
    if records[0, 0] > time[-1] or records[-1, 0] < time[0]:
        message = f"the deviations are of {records[0, 0]:.1f} to {records[-1, 0]:.1f} s, the trajectory of other times"
        return nothing, nothing, [Complaint(message, shown)]
    at_times = np.column_stack([np.interp(time, records[:, 0], column) for column in records.T])
    return at_times[:, [2, 1, 3]], at_times[:, 7:10] * RADIANS_PER_DEGREE / 60.0, []
