"""Ground control points of OpenSfM (``ground_control_points.json``), and the lists of OpenDroneMap."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from msgspec import Struct

from orip.exchange.sources.json_tree import JsonValue
from orip.exchange.sources.text import Faults, text_lines
from orip.files.text.shown import shown_token

# The first line of both names the coordinate system: ``EPSG:n``, ``WGS84 UTM 33N``, ``WGS84 UPS south``, ``WGS84``
# (longitude, latitude, height), a string of PROJ or WKT. A ground control point has no name there, and is known by its
# coordinates.

_UTM = re.compile(r"WGS\s*84\s*/?\s*UTM\s*(?:zone)?\s*([0-9]{1,2})\s*([A-Z]|north|south)", re.IGNORECASE)
_UPS = re.compile(r"WGS\s*84\s*/?\s*UPS\s*(N|S|north|south)(?:\s*pole)?(?:\s*\(.*\))?", re.IGNORECASE)
_EPSG = re.compile(r"(?:\+init\s*=\s*)?EPSG\s*:\s*([0-9]{4,6}(?:\+[0-9]{4,6})?)", re.IGNORECASE)
_ZONE = re.compile(r"\+zone=([0-9]{1,2})([A-Z])\b", re.IGNORECASE)
_GEOGRAPHIC = "EPSG:4326"
_UPS_CODES = {"N": "EPSG:5041", "S": "EPSG:5042"}
"""Easting first."""

_ZONES = 60
_SOUTHERN_BANDS = "CDEFGHJKLMS"
"""Letters of the bands of latitude south of the equator; S beside a zone means the south, as N means the north."""


class ControlMark(Struct, frozen=True):
    """A ground control point measured in a photo.

    Parameters
    ----------
    coordinates : tuple of 3 floats
        x, y, z as written: east, north, height, or longitude, latitude, height; z NaN where it is not known.
    pixel : tuple of 2 floats
        Column and row; the centre of the first pixel is 0.
    label : str
        What follows in the line; empty where nothing does.
    """

    coordinates: tuple[float, float, float]
    pixel: tuple[float, float]
    photo: str
    label: str
    line: int


class ControlList(Struct, frozen=True):
    """A file ``gcp_list.txt``; `crs` is for pyproj, x before y in any case."""

    crs: str
    marks: tuple[ControlMark, ...]


class PhotoPlace(Struct, frozen=True):
    """Where a photo was taken: z NaN if not known; `accuracy` horizontal and vertical, None if not given.

    `angles` are yaw, pitch and roll in degrees, all 0 for a photo that looks down with its top to the north; None if
    not given.
    """

    photo: str
    coordinates: tuple[float, float, float]
    accuracy: tuple[float, float] | None
    line: int
    angles: tuple[float, float, float] | None = None


class PlaceList(Struct, frozen=True):
    """A file ``geo.txt``; `crs` is for pyproj, x before y in any case."""

    crs: str
    places: tuple[PhotoPlace, ...]


def read_control_list(path: Path, faults: Faults) -> ControlList:
    """Read ``gcp_list.txt``: ``x y z column row photo [label]``."""
    crs, rows = _rows(path, faults)
    marks = []
    for line, words in rows:
        if len(words) < _CONTROL_FIELDS:
            faults.complain(
                f"a field is missing, {len(words)} found; the line is: x y z column row photo [label]", line
            )
            continue
        coordinates = _coordinates(words[:3], line, faults)
        column, row = (faults.decimal(word, "column and row", line) for word in words[3:5])
        if coordinates is not None and not (math.isnan(column) or math.isnan(row)):
            marks.append(ControlMark(coordinates, (column, row), words[5], " ".join(words[6:7]), line))
    return ControlList(crs, tuple(marks))


def read_place_list(path: Path, faults: Faults) -> PlaceList:
    """Read ``geo.txt``: ``photo x y [z [yaw pitch roll [horizontal vertical accuracy]]]``."""
    crs, rows = _rows(path, faults)
    places = []
    for line, words in rows:
        if len(words) < _PLACE_FIELDS:
            faults.complain(f"a field is missing, {len(words)} found; the line is: photo x y [z ...]", line)
            continue
        coordinates = _coordinates([*words[1:4], "nan"][:3], line, faults)
        if coordinates is not None:
            places.append(
                PhotoPlace(words[0], coordinates, _accuracy(words, line, faults), line, _angles(words, line, faults))
            )
    return PlaceList(crs, tuple(places))


_CONTROL_FIELDS, _PLACE_FIELDS, _FIELDS_WITH_ANGLES, _FIELDS_WITH_ACCURACY = 6, 3, 7, 9


def _rows(path: Path, faults: Faults) -> tuple[str, Iterator[tuple[int, list[str]]]]:
    numbered = ((number, line.strip()) for number, line in enumerate(text_lines(path, faults), start=1))
    texts = ((number, text) for number, text in numbered if text and not text.startswith("#"))
    number, heading = next(texts, (1, ""))
    crs = crs_of_heading(heading)
    if crs is None:
        faults.complain(
            f"'{shown_token(heading)}' names no coordinate system; the first line is EPSG:n, WGS84 UTM 33N, WGS84 UPS "
            "south, WGS84 (longitude, latitude) or a string of PROJ (+proj=...)",
            number,
        )
    return crs or "", ((line, _words(text)) for line, text in texts)


def _words(text: str) -> list[str]:
    """Return the fields of a line; where tabs are between them, names may have blanks."""
    words = [word.strip() for word in text.split("\t")]
    return words if len(words) >= _PLACE_FIELDS else text.split()


def crs_of_heading(heading: str) -> str | None:
    """Return the coordinate system that a first line names, for pyproj; None if it names none."""
    text = heading.strip()
    epsg, utm, ups = _EPSG.fullmatch(text), _UTM.fullmatch(text), _UPS.fullmatch(text)
    if epsg:
        return f"EPSG:{epsg[1]}"
    if utm and 1 <= int(utm[1]) <= _ZONES:
        return f"EPSG:{(32700 if _is_south(utm[2]) else 32600) + int(utm[1])}"
    if ups:
        return _UPS_CODES[ups[1][0].upper()]
    if text.replace(" ", "").upper() in ("WGS84", "WGS84LATLON", "WGS84LONLAT"):
        return _GEOGRAPHIC
    if text.startswith("+proj"):
        return _ZONE.sub(_zone, text)
    return text if text.startswith(_WKT) else None


_WKT = ("PROJCS[", "PROJCRS[", "GEOGCS[", "GEOGCRS[", "COMPD_CS[", "COMPOUNDCRS[")


def _is_south(letter: str) -> bool:
    """Return whether a hemisphere, or a band of latitude, is the southern one."""
    return letter.lower() == "south" or (len(letter) == 1 and letter.upper() in _SOUTHERN_BANDS)


def _zone(found: re.Match[str]) -> str:
    """Return a zone with a letter as PROJ has it."""
    return f"+zone={found[1]} +south" if _is_south(found[2]) else f"+zone={found[1]}"


def _coordinates(words: list[str], line: int, faults: Faults) -> tuple[float, float, float] | None:
    x, y = (faults.decimal(word, "x and y", line) for word in words[:2])
    unknown = words[2].lower() == "nan"
    z = math.nan if unknown else faults.decimal(words[2], "z", line)
    return None if math.isnan(x) or math.isnan(y) or (math.isnan(z) and not unknown) else (x, y, z)


def _angles(words: list[str], line: int, faults: Faults) -> tuple[float, float, float] | None:
    if len(words) < _FIELDS_WITH_ANGLES or any(word.lower() == "nan" for word in words[4:7]):
        return None
    yaw, pitch, roll = (faults.decimal(word, "yaw, pitch, roll", line) for word in words[4:7])
    return yaw, pitch, roll


def _accuracy(words: list[str], line: int, faults: Faults) -> tuple[float, float] | None:
    if len(words) < _FIELDS_WITH_ACCURACY:
        return None
    horizontal, vertical = (faults.decimal(word, "accuracy", line) for word in words[7:9])
    return (horizontal, vertical) if horizontal > 0 and vertical > 0 else None


# Positions are latitude, longitude and height; a point without a position is a tie point measured by hand. Projections
# are normalised as those of tracks.


class MarkedPoint(Struct, frozen=True):
    """A point with its measurements.

    Parameters
    ----------
    coordinates : tuple of 3 (float or None), or None
        x before y: longitude, latitude, height; or east, north, height. None where the point has no position.
    marks : tuple of (photo, coordinates)
        Normalised coordinates, or pixels from the centre of the first one.
    line : int
        0 where it is not known.
    """

    name: str
    coordinates: tuple[float | None, float | None, float | None] | None
    marks: tuple[tuple[str, tuple[float, float]], ...]
    line: int = 0


def marked_points_of_document(document: JsonValue) -> tuple[MarkedPoint, ...]:
    """Return the points of a ``ground_control_points.json``."""
    points = document.required("points")
    found = []
    for point in points.items() if points is not None else ():
        name = _name(point)
        if name is not None:
            found.append(MarkedPoint(name, _position(point), _marks(point)))
    return tuple(found)


def _name(point: JsonValue) -> str | None:
    name = point.required("id")
    if name is None or isinstance(name.value, str | int):
        return None if name is None else str(name.value)
    name.complain("a name should be here; correct it")
    return None


def _position(point: JsonValue) -> tuple[float | None, float | None, float | None] | None:
    position = point.get("position")
    if position is None:
        return None
    height = position.number("altitude") if position.get("altitude") is not None else None
    return position.number("longitude"), position.number("latitude"), height


def _marks(point: JsonValue) -> tuple[tuple[str, tuple[float, float]], ...]:
    observations = point.get("observations")
    found = []
    for observation in observations.items() if observations is not None else ():
        shot, projection = observation.text("shot_id"), observation.numbers("projection", 2)
        if shot is not None and projection is not None:
            found.append((shot, (projection[0], projection[1])))
    return tuple(found)


def marked_points_of_list(control: ControlList) -> tuple[MarkedPoint, ...]:
    """Return the points of a ``gcp_list.txt``: marks of equal coordinates are those of one point.

    A point is named after its label where all its marks have the same, and no other point has it; else GCP1, GCP2, ...
    """
    groups: dict[tuple[float, float, float | None], list[ControlMark]] = {}
    for mark in control.marks:
        x, y, z = mark.coordinates
        groups.setdefault((x, y, None if math.isnan(z) else z), []).append(mark)
    names = _names(groups)
    return tuple(
        MarkedPoint(names[place], place, tuple((mark.photo, mark.pixel) for mark in marks), marks[0].line)
        for place, marks in groups.items()
    )


def _names(
    groups: Mapping[tuple[float, float, float | None], list[ControlMark]],
) -> dict[tuple[float, float, float | None], str]:
    labels = {place: {mark.label for mark in marks} for place, marks in groups.items()}
    single = [min(found) for found in labels.values() if len(found) == 1]
    return {
        place: min(found) if len(found) == 1 and min(found) and single.count(min(found)) == 1 else f"GCP{number}"
        for number, (place, found) in enumerate(labels.items(), start=1)
    }
