"""Tables of stations in foreign text files: rows of numbers in named columns, every fault kept with its place."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
from msgspec import Struct, field

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.files.text.decimal_numbers import degrees_and_side, is_number, parse_degrees, parse_number
from orip.files.text.lines import foreign_text, no_text_complaint, read_bytes
from orip.files.text.separated import (
    DEGREES,
    EASTINGS,
    EXTRA_FIELDS,
    EXTRA_WORDS,
    HEIGHTS,
    METRES,
    NAMES_OF_PHOTOS,
    NORTHINGS,
    fields_of_line,
    folded,
    has_decimal_commas,
    separator_of,
    unit_of,
)
from orip.files.text.shown import Parsed, printable, shown_token
from orip.records.epochs import SECONDS_PER_WEEK, Epochs, Mount, Quality, epochs, seconds_of_date
from orip.records.names import name_fault
from orip.units import METRES_PER_GROUND_UNIT, RADIANS_PER_DEGREE

MOST_COMPLAINTS = 200
"""After so many faults the rest of a file is not read: it is probably of another kind."""

LARGEST_PLACE = 1e8
"""Metres; the largest coordinate that a place on the earth has."""


class Row(Struct, frozen=True):
    """A line with its fields; `column` (from 1) of each."""

    number: int
    fields: tuple[str, ...]
    column: tuple[int, ...]


class RowReader(Struct):
    """Reads fields of rows and keeps what is wrong with them."""

    shown: str
    complaints: list[Complaint] = field(default_factory=list)

    @property
    def is_full(self) -> bool:
        """Return whether the rest of the file is not worth reading."""
        return len(self.complaints) >= MOST_COMPLAINTS

    def complain(self, message: str, row: Row, index: int | None = None) -> None:
        """Keep a complaint about a row, or about one of its fields."""
        column = row.column[index] if index is not None and index < len(row.column) else None
        self.complaints.append(Complaint(printable(message), self.shown, row.number, column))

    def number(
        self, row: Row, index: int, least: float = -math.inf, largest: float = math.inf, sides: str = ""
    ) -> float:
        """Return a field that is a number within limits; NaN, and a complaint kept, if it is not one.

        Parameters
        ----------
        sides : str
            Of a longitude or latitude: see `parse_degrees`.
        """
        try:
            value = parse_degrees(row.fields[index], sides) if sides else parse_number(row.fields[index])
        except ValueError as fault:
            self.complain(str(fault), row, index)
            return math.nan
        if not least <= value <= largest:
            shown = shown_token(row.fields[index])
            text = f"'{shown}' is not between {least:g} and {largest:g}; correct it, or name the columns"
            self.complain(text, row, index)
            return math.nan
        return value

    def numbers(self, row: Row, indices: Sequence[int]) -> list[float]:
        """Return fields that are numbers."""
        return [self.number(row, index) for index in indices]


_LOOKED_AT = 4096


def text_rows(path: Path, reader: RowReader, separators: str = r"\s") -> Iterator[Row]:
    """Iterate over the lines of a file that have fields, comments included."""
    data, complaints = read_bytes(path, reader.shown)
    reader.complaints += complaints
    if no_text := no_text_complaint((data or b"")[:_LOOKED_AT], reader.shown):
        reader.complaints.append(no_text)
        return
    pattern = re.compile(rf"[^{separators}]+")
    for number, line in enumerate(foreign_text(data or b"").split("\n"), start=1):
        found = [(match[0], match.start() + 1) for match in pattern.finditer(line)]
        if found:
            yield Row(number, tuple(word for word, _ in found), tuple(column for _, column in found))


HEADINGS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "photo": f"{NAMES_OF_PHOTOS} name label id",
        "time": "time gpstime gpst tow sow timestamp seconds datetime zeit uhrzeit",
        "longitude": "longitude lon long lng xlongitude lange laenge langengrad laengengrad longitud longitudine",
        "latitude": "latitude lat ylatitude breite breitengrad latitud latitudine",
        "X": f"{EASTINGS} x0 xeasting xeast",
        "Y": f"{NORTHINGS} y0 ynorthing ynorth",
        "Z": f"{HEIGHTS} alt ellipsoidalheight ellh z0 zaltitude",
        "aX": "ax sx sde stdx sigmax xsd accuracyx sdx stdlon sigmaeast sdeast",
        "aY": "ay sy sdn stdy sigmay ysd accuracyy sdy stdlat sigmanorth sdnorth",
        "aZ": "az sz sdu stdz sigmaz zsd accuracyz sdz stdheight sigmaup sdup",
        "omega": "omega om",
        "phi": "phi ph",
        "kappa": "kappa ka",
        "roll": "roll",
        "pitch": "pitch",
        "heading": "heading yaw",
        "quality": "q quality fix status",
        "strip": "strip line flightline session streifen flugstreifen",
    }
)
"""What orip takes from a table, and the headings by which it is recognised, as `folded` and without units."""

_FULL_TURN = 360.0
_QUALITY: Mapping[str, Quality] = {
    "1": "fixed", "fix": "fixed", "fixed": "fixed", "50": "fixed", "2": "float", "float": "float", "34": "float",
}  # fmt: skip
_SIDES = {"longitude": "EW", "latitude": "NS"}
_ERRORS = {"aX", "aY", "aZ"}
_LENGTHS = {"X", "Y", "Z", *_ERRORS}
_NOT_KNOWN = {"", "-"}


def read_station_table(
    path: Path, shown: str, columns: Mapping[str, str] | None = None, ground_unit: str = ""
) -> Parsed[Epochs]:
    """Read a table.

    Parameters
    ----------
    columns : mapping of str to str, optional
        Headings by key of `HEADINGS`, where they are not recognised.
    ground_unit : str
        The project's, that of X, Y and Z whose heading names another one.
    """
    data, complaints = read_bytes(path, shown)
    reader = RowReader(shown, list(complaints))
    if no_text := no_text_complaint((data or b"")[:_LOOKED_AT], shown):
        reader.complaints.append(no_text)
        data = None
    separator, rows = _table_rows(data or b"")
    if not rows:
        if not reader.complaints:
            reader.complaints.append(Complaint("the table is empty; it needs a heading and rows", shown))
        return Parsed(epochs(shown, np.zeros(0, dtype=np.int64)), tuple(reader.complaints))
    heading, width = rows[0], len(rows[0].fields)
    places = _columns(reader, heading, columns or {})
    records = []
    for row in rows[1:]:
        if reader.is_full or not places:
            break
        if len(row.fields) < width:
            reader.complain(f"a field is missing, {len(row.fields)} found; the heading has {width}", row)
        elif separator in (",", None) and any(row.fields[width:]):
            hint = EXTRA_FIELDS if separator else EXTRA_WORDS
            reader.complain(f"{len(row.fields)} fields, and the heading has {width}{hint}", row)
        else:
            records.append(row)
    if separator != "," and has_decimal_commas(word for row in records for word in row.fields):
        records = [Row(row.number, tuple(_with_point(word) for word in row.fields), row.column) for row in records]
    return Parsed(_epochs(reader, records, places, heading, ground_unit), tuple(reader.complaints))


def _with_point(word: str) -> str:
    return word.replace(",", ".") if has_decimal_commas([word]) else word


def _table_rows(data: bytes) -> tuple[str | None, list[Row]]:
    """Return what separates the fields of a table, and its rows with the heading as first; comments are left out."""
    lines = [
        (number, line)
        for number, line in enumerate(foreign_text(data).split("\n"), start=1)
        if line.strip() and line.lstrip()[0] not in "!%"
    ]
    while lines and lines[0][1].lstrip().startswith("#") and not _is_heading(lines[0][1]):
        del lines[0]
    separator = separator_of(lines[0][1]) if lines else None
    kept = (pair for place, pair in enumerate(lines) if place == 0 or not pair[1].lstrip().startswith("#"))
    return separator, [_row(number, line, separator) for number, line in kept]


def _row(number: int, line: str, separator: str | None) -> Row:
    """Return the fields of a line, those that are empty too, with their columns."""
    fields = fields_of_line(line, separator)
    written = re.finditer(r"\S+" if separator is None else rf"(?:^|{separator})\s*()", line)
    columns = [match.end(1) + 1 if separator else match.start() + 1 for match in written]
    return Row(number, tuple(fields), tuple(columns))


def _is_heading(line: str) -> bool:
    """Return whether a line that begins as a comment names columns."""
    known = " ".join(HEADINGS.values()).split()
    return len(set(_plain(fields_of_line(line, separator_of(line)))) & set(known)) > 1


def _plain(headings: Sequence[str]) -> list[str]:
    """Return headings in small letters, without units."""
    return [re.sub(r"\(.*?\)|\[.*?\]|[^a-z0-9]", "", folded(heading)) for heading in headings]


def _columns(reader: RowReader, heading: Row, wanted: Mapping[str, str]) -> dict[str, int]:
    """Return the columns by key."""
    written = heading.fields
    plain = _plain(written)
    found: dict[str, int] = {}
    for key, names in HEADINGS.items():
        if key in wanted:
            if wanted[key] in written:
                found[key] = written.index(wanted[key])
            else:
                shown = shown_token(wanted[key])
                reader.complain(
                    f"there is no column '{shown}'; there are: {', '.join(map(shown_token, written))}", heading
                )
            continue
        named = [index for index, name in enumerate(plain) if name in names.split() and index not in found.values()]
        if named:
            found[key] = named[0]
    if missing := _missing(found):
        if fault := _no_heading(written):
            reader.complain(
                f"{fault} with a heading above its columns, such as photo,X,Y,Z or photo,lon,lat,Z", heading
            )
            return {}
        reader.complain(
            f"no column is known as {missing}; the headings are: {', '.join(map(shown_token, written))}. "
            f"Name the columns with --column KEY=HEADING; keys are: {', '.join(HEADINGS)}",
            heading,
        )
        return {}
    return found


def _no_heading(fields: Sequence[str]) -> str:
    """Return what a first line is that names no columns, and what to do; "" where it may name them."""
    if fields[0].startswith(("<", "{", "[")):
        return "this is XML or JSON; export it as a table"
    if sum(map(is_number, fields)) > len(fields) // 2 or any(degrees_and_side(one) for one in fields):
        return "the first line is no heading, but has numbers; write the table"
    return ""


def _missing(found: Mapping[str, int]) -> str:
    if "photo" not in found and "time" not in found:
        return "photo or time"
    place = {"longitude", "latitude"} if "longitude" in found or "latitude" in found else {"X", "Y"}
    if found.keys() & {"longitude", "latitude", "X", "Y", "Z"}:
        return ", ".join(sorted((place | {"Z"}) - found.keys()))
    for group in (("omega", "phi", "kappa"), ("roll", "pitch", "heading")):
        if found.keys() & set(group):
            return ", ".join(key for key in group if key not in found)
    return ""


def _epochs(
    reader: RowReader, rows: Sequence[Row], places: Mapping[str, int], heading: Row, ground_unit: str
) -> Epochs:
    count = len(rows)

    def column(key: str, least: float = -math.inf, largest: float = math.inf) -> FloatArray:
        if key not in places:
            return np.full(count, np.nan)
        sides = _SIDES.get(key, "")
        numbers = [_number(reader, row, places[key], least, largest, sides) for row in rows]
        of_ground = "m" if is_geographic else ground_unit or unit("Z")
        written = unit(key) or (unit("Z") if key in _ERRORS and not is_geographic else "")
        return _scale(key, written, of_ground) * np.array(numbers, dtype=np.float64)

    def unit(key: str) -> str:
        return unit_of(heading.fields[places[key]]) if key in places else ""

    def triple(*keys: str, limit: float = math.inf) -> FloatArray:
        return np.column_stack([column(key, -limit, limit) for key in keys]).reshape(count, 3)

    is_geographic = "longitude" in places
    if is_geographic:
        place = triple("longitude", "latitude", "Z", limit=LARGEST_PLACE)
        if len(place) and np.nanmax(np.abs(place[:, 1]), initial=0.0) > 90.0:
            reader.complain("a latitude is beyond 90 degrees; are longitude and latitude exchanged?", heading)
        place = place * [RADIANS_PER_DEGREE, RADIANS_PER_DEGREE, 1.0]
    else:
        place = triple("X", "Y", "Z", limit=LARGEST_PLACE)
    if not reader.complaints:
        for row, missing in zip(rows, np.isnan(place), strict=True):
            if 0 < np.count_nonzero(missing) < len(missing):
                reader.complain("a coordinate is missing; write all three, or none", row)
    errors = triple("aX", "aY", "aZ", limit=1e6)
    mount: Mount = "photo" if "omega" in places else "body"
    angles = triple("omega", "phi", "kappa") if mount == "photo" else triple("roll", "pitch", "heading")
    _refuse_beyond_a_turn(reader, angles, heading)
    time = np.array([_time(reader, row, places["time"]) if "time" in places else math.nan for row in rows])
    return epochs(
        reader.shown,
        np.array([row.number for row in rows], dtype=np.int64),
        photo=tuple(_name(reader, row, places["photo"]) if "photo" in places else "" for row in rows),
        time=time,
        has_week=bool((time > SECONDS_PER_WEEK).any()),
        place=place,
        is_geographic=is_geographic,
        covariance=errors[:, :, None] * np.eye(3) * errors[:, None, :],
        quality=tuple(_quality(row, places) for row in rows),
        angles=angles * RADIANS_PER_DEGREE,
        mount=mount,
        strip=tuple(row.fields[places["strip"]] if "strip" in places else "" for row in rows),
    )


def _refuse_beyond_a_turn(reader: RowReader, degrees: FloatArray, heading: Row) -> None:
    if (np.abs(degrees) > _FULL_TURN).any():
        reader.complain("angles are beyond 360 degrees; write their unit into the heading, as kappa (gon)", heading)


def _scale(key: str, unit: str, of_ground: str) -> float:
    """Return what numbers of a column are multiplied by: angles become degrees, lengths those of the ground unit."""
    if key not in _LENGTHS:
        return DEGREES.get(unit, 1.0)
    ground = METRES_PER_GROUND_UNIT.get(of_ground) or METRES.get(of_ground, 1.0)
    return METRES.get(unit, ground) / ground


def _number(reader: RowReader, row: Row, index: int, least: float, largest: float, sides: str) -> float:
    return math.nan if row.fields[index] in _NOT_KNOWN else reader.number(row, index, least, largest, sides)


def _name(reader: RowReader, row: Row, index: int) -> str:
    """Return the name of a photo: that of its file without folder and ending."""
    written = re.split(r"[/\\]", row.fields[index])[-1]
    name = re.sub(r"\.(?:jpe?g|tiff?|png|dng|raw|arw|cr2|nef)$", "", written, flags=re.IGNORECASE)
    if fault := name_fault(name):
        reader.complain(fault, row, index)
    return name


def _time(reader: RowReader, row: Row, index: int) -> float:
    written = row.fields[index]
    if written in _NOT_KNOWN:
        return math.nan
    dated = re.fullmatch(r"(\d{4}[-/:]\d{1,2}[-/:]\d{1,2})[T ]\s*(\d{1,2}:\d{2}:\d{2}(?:\.\d{1,9})?)Z?", written)
    if dated is None:
        return reader.number(Row(row.number, (written,), row.column[index : index + 1]), 0, 0.0, 1e12)
    try:
        return seconds_of_date(dated[1], dated[2])
    except (ValueError, OverflowError):
        reader.complain(f"'{shown_token(written)}' is not a time; write seconds, or yyyy-mm-ddThh:mm:ss", row, index)
        return math.nan


def _quality(row: Row, places: Mapping[str, int]) -> Quality:
    if "quality" not in places:
        return ""
    return _QUALITY.get(row.fields[places["quality"]].lower(), "code")
