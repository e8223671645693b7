"""Reference tables of Metashape (CSV): places and angles of cameras, in the place of those of a document."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct, field

from orip.exchange.metashape.chunk import DEFAULT_ANGLE, DEFAULT_POSITION, LEAST_RADIUS
from orip.exchange.sources.collected import PhotoNames
from orip.exchange.sources.text import Faults, text_lines
from orip.files.text.regular_file import beginning
from orip.files.text.separated import EXTRA_FIELDS, fields_of_line, separator_of
from orip.files.text.shown import Parsed, shown_token
from orip.records.control import NOT_GIVEN, ControlPoint, Station, StationReference
from orip.records.exchanged import ExchangedProject
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE
from orip.wording import counted

# The columns are named by a comment that begins with ``#Label``; user and version choose them and what separates them.
# Where there is no such line the columns are named by letters as in Metashape's own import: n label, o enabled, x y z
# coordinates, X Y Z their accuracies, a b c yaw, pitch and roll, A B C their accuracies, any other letter a column that
# is passed over. Their order is never guessed.

COORDINATES = ("x", "y", "z")
ACCURACIES = ("accuracy_x", "accuracy_y", "accuracy_z")
ANGLES = ("yaw", "pitch", "roll")
ANGLE_ACCURACIES = ("accuracy_yaw", "accuracy_pitch", "accuracy_roll")

_LETTERS: Final[Mapping[str, str]] = {
    "n": "label",
    "o": "enabled",
    **dict(zip("xyzXYZabcABC", (*COORDINATES, *ACCURACIES, *ANGLES, *ANGLE_ACCURACIES), strict=True)),
}
_HEADINGS: Final[Mapping[str, str]] = {
    "label": "label", "name": "label", "enable": "enabled", "enabled": "enabled", "enableflag": "enabled",
    **{axis: axis for axis in COORDINATES}, **{angle: angle for angle in ANGLES},
    "longitude": "x", "easting": "x", "east": "x", "latitude": "y", "northing": "y", "north": "y",
    "altitude": "z", "height": "z", "elevation": "z",
}  # fmt: skip
_SYSTEM = re.compile(r"#\s*CoordinateSystem\s*:?\s*(.+)", re.IGNORECASE)
_FALSE = {"0", "false", "no"}
_BEGINNING = 4000
_ENDINGS = (".csv", ".txt", ".tsv")


class Reference(Struct, frozen=True):
    """What a table gives of a camera or marker; a triple is empty where one of its numbers is missing.

    Parameters
    ----------
    coordinates : tuple of 3 (float or None)
    accuracy : tuple of 3 float, or empty
        Metres.
    angles, angle_accuracy : tuple of 3 float, or empty
        Yaw, pitch and roll, degrees.
    """

    label: str
    coordinates: tuple[float | None, float | None, float | None]
    accuracy: tuple[float, ...] = ()
    angles: tuple[float, ...] = ()
    angle_accuracy: tuple[float, ...] = ()
    is_enabled: bool = True
    line: int = 0


class ReferenceTable(Struct, frozen=True):
    """A table.

    Parameters
    ----------
    crs : str
        What its coordinates refer to; empty where it does not say.
    """

    crs: str
    references: tuple[Reference, ...]


def reference_tables_beside(document: Path) -> list[Path]:
    """Return the tables in the folder of a document that begin as Metashape writes them."""
    return sorted(path for path in document.parent.iterdir() if path.suffix.lower() in _ENDINGS and _is_table(path))


def _is_table(path: Path) -> bool:
    lines = beginning(path, _BEGINNING).splitlines() if path.is_file() else []
    return any(line.startswith("#") and "x" in _columns_of_heading(line) for line in lines)


def read_reference_table(path: Path, faults: Faults, letters: str = "") -> ReferenceTable:
    """Read a table; what is wrong with it is kept with its line.

    Parameters
    ----------
    letters : str
        Names of the columns, a letter each; empty: the table's heading names them.
    """
    lines = text_lines(path, faults)
    if faults.complaints:
        return ReferenceTable("", ())
    systems = [match[1].strip() for line in lines if (match := _SYSTEM.match(line))]
    rows = _lettered(lines, letters) if letters else _headed(lines, faults)
    references = [
        found for number, fields, separator in rows if (found := _reference(fields, separator, number, faults))
    ]
    return ReferenceTable(systems[0] if systems else "", tuple(references))


def require_letters(letters: str) -> str | None:
    """Return what is wrong with the letters of columns; None if they have a label and coordinates, each once."""
    known = [letter for letter in letters if letter in _LETTERS]
    if not letters.isalpha() or len(set(known)) < len(known) or not {"n", "x", "y"} <= set(known):
        return "write a letter for each column, such as nxyzXYZabc: n label, x y z coordinates, X Y Z accuracies"
    return None


_Fields = tuple[int, Mapping[str, str], str | None]


def _lettered(lines: Sequence[str], letters: str) -> Iterator[_Fields]:
    columns = {_LETTERS[letter]: place for place, letter in enumerate(letters) if letter in _LETTERS}
    filled = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    separator = separator_of(filled[0][1]) if filled else None
    for number, line in filled:
        fields = fields_of_line(line, separator)
        yield number, {name: fields[place] for name, place in columns.items() if place < len(fields)}, separator


def _headed(lines: Sequence[str], faults: Faults) -> Iterator[_Fields]:
    """Yield the rows below headings that name coordinates; scale bars have a heading of their own without them."""
    columns: dict[str, int] = {}
    separator: str | None = None
    width = 0
    is_headed = False
    for number, line in enumerate(lines, 1):
        found = _columns_of_heading(line) if line.startswith("#") or not is_headed else {}
        if found:
            columns, separator, is_headed = found, separator_of(line), True
            width = len(fields_of_line(line, separator))
        elif line.strip() and not line.startswith("#") and {"x", "y"} <= set(columns):
            fields = fields_of_line(line, separator)
            if len(fields) <= max(columns[name] for name in ("label", "x", "y")):
                faults.complain(f"{len(fields)} fields, and label and coordinates are beyond; correct the row", number)
                continue
            if separator == "," and any(fields[width:]):
                faults.complain(f"{len(fields)} fields, and the heading has {width}{EXTRA_FIELDS}", number)
                continue
            yield number, {name: fields[place] for name, place in columns.items() if place < len(fields)}, separator
    if not is_headed:
        faults.complain(
            "no line names the columns: it begins with #Label; name them with --reference-columns, a letter each, such "
            "as nxyzXYZ",
            1,
        )


def _columns_of_heading(line: str) -> dict[str, int]:
    """Return the columns that a heading names by what they hold; nothing if the line is not a heading."""
    written = fields_of_line(line.lstrip("# \t"), separator_of(line))
    found: dict[str, int] = {}
    for place, heading in enumerate(written):
        for name in _held(heading):
            found.setdefault(name, place)
    return found if found.get("label") == 0 else {}


def _held(heading: str) -> tuple[str, ...]:
    """Return what a column holds; nothing for errors and estimates, which Metashape has computed."""
    text = heading.strip().lower()
    plain = re.sub(r"\(.*?\)|\s", "", text).strip("_")
    if plain.startswith(("accuracy", "acc_")):
        of = plain.removeprefix("accuracy").removeprefix("acc_").strip("_")
        if not of:
            return ANGLE_ACCURACIES if "deg" in text else ACCURACIES
        names = [f"accuracy_{part}" for part in of.split("/")]
        return tuple(name for name in names if name in ACCURACIES + ANGLE_ACCURACIES)
    name = _HEADINGS.get(plain) or _HEADINGS.get(plain.partition("/")[0])
    return () if name is None else (name,)


_SIDES = {"x": "EW", "y": "NS"}
"""Of longitude and latitude, which stand where a plain system has x and y."""


def _reference(fields: Mapping[str, str], separator: str | None, line: int, faults: Faults) -> Reference | None:
    def number(name: str) -> float | None:
        word = fields.get(name, "").strip()
        if not word:
            return None
        written = word if separator == "," else word.replace(",", ".")
        value = (
            faults.degrees(written, name, _SIDES[name], line) if name in _SIDES else faults.decimal(written, name, line)
        )
        return None if math.isnan(value) else value

    def triple(names: tuple[str, ...]) -> tuple[float, ...]:
        values = [number(name) for name in names]
        return tuple(value for value in values if value is not None) if None not in values else ()

    label = fields.get("label", "").strip()
    x, y, z = (number(name) for name in COORDINATES)
    if not label:
        faults.complain("the row has no label; correct it", line)
    accuracy = triple(ACCURACIES)
    for names, values in ((ACCURACIES, accuracy), (ANGLE_ACCURACIES, angle_accuracy := triple(ANGLE_ACCURACIES))):
        if any(value < 0.0 for value in values):
            faults.complain(f"{names[0].partition('_')[0]} of '{shown_token(label)}' is below 0; correct it", line)
    if not label or (x is None and y is None and z is None):
        return None
    is_enabled = fields.get("enabled", "1").strip().lower() not in _FALSE
    return Reference(label, (x, y, z), accuracy, triple(ANGLES), angle_accuracy, is_enabled, line)


_LOCAL = "LOCAL"


class _Placed(Struct):
    """References by what they belong to."""

    stations: dict[str, Station] = field(default_factory=dict)
    control: dict[str, ControlPoint] = field(default_factory=dict)
    compared: dict[str, bool] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)
    incomplete: int = 0
    without_accuracy: int = 0


def with_references(project: ExchangedProject, path: Path, shown: str, letters: str = "") -> Parsed[ExchangedProject]:
    """Return a project with the references of a table, or as it was and complaints about the table.

    Labels of the table are those of cameras or of markers, and those of neither are named in a note. Angles without
    accuracies of their own are only compared.

    Parameters
    ----------
    project : ExchangedProject
        As `read_metashape` returns it.
    shown : str
        The table as the user would name it.
    letters : str
        Names of the columns; see `read_reference_table`.
    """
    faults = Faults(shown)
    table = read_reference_table(path, faults, letters)
    if not faults.complaints and (fault := _other_system(project, table)):
        faults.complain(fault)
    if faults.complaints:
        return Parsed(project, tuple(faults.complaints))
    found = _placed(project, table)
    empty = [] if table.references else [f"{path.name} has a heading alone: no reference was read."]
    is_on_the_ground = project.ground_unit == "m"
    stations = {station.photo: station for station in project.stations} | (found.stations if is_on_the_ground else {})
    control = {point.name: point for point in project.control} | found.control
    is_geocentric = project.frame.kind == "geocentric"
    crs = table.crs or project.control_crs
    is_turned = any(station.has_angles for station in stations.values())
    changed = replace(
        project,
        stations=tuple(stations.values()),
        control=tuple(control.values()),
        checks=frozenset(name for name in control if found.compared.get(name, name in project.checks)),
        control_crs=crs if is_geocentric else "",
        station_reference=StationReference(crs if is_geocentric else "", navigation=is_turned),
        notes=(*project.notes, *empty, *_notes(found, path.name, is_on_the_ground=is_on_the_ground)),
    )
    return Parsed(changed)


def _other_system(project: ExchangedProject, table: ReferenceTable) -> str:
    """Return what is wrong with the coordinate system of a table; empty if it fits."""
    known = project.control_crs
    if project.frame.kind != "geocentric":
        is_local = not table.crs or table.crs.startswith(_LOCAL)
        return "" if is_local else "the table is in a system of the earth, and the chunk is not; export both again"
    if not (table.crs or known) and any(map(_is_near, table.references)):
        return "neither the table nor the chunk says what coordinates refer to; export the cameras again"
    if table.crs and known and "".join(table.crs.split()) != "".join(known.split()):
        return "the table has another coordinate system than the chunk; export both in the same one"
    return ""


def _is_near(reference: Reference) -> bool:
    """Return whether coordinates are not geocentric."""
    return math.hypot(*(value or 0.0 for value in reference.coordinates)) < LEAST_RADIUS


def _placed(project: ExchangedProject, table: ReferenceTable) -> _Placed:
    found = _Placed()
    photos = {photo.name for photo in project.photos}
    names = PhotoNames(photo.name for photo in project.photos)
    markers = {*project.points.marks, *(point.name for point in project.control)}
    known_stations = {station.photo: station.position_error for station in project.stations}
    known_control = {point.name: point.errors for point in project.control}
    for given in table.references:
        reference = given
        if given.label not in photos and given.label not in markers:
            place = names.place(given.label)
            reference = given if place is None else replace(given, label=project.photos[place].name)
        if reference.label in photos and None in reference.coordinates:
            found.incomplete += 1
        elif reference.label in photos:
            found.without_accuracy += not (reference.accuracy or reference.label in known_stations)
            found.stations[reference.label] = _station(reference, known_stations)
        elif reference.label in markers:
            found.control[reference.label] = _control(reference, known_control)
            found.compared[reference.label] = not reference.is_enabled
        else:
            found.unknown.append(reference.label)
    return found


def _station(reference: Reference, known: Mapping[str, tuple[float, float, float]]) -> Station:
    x, y, z = reference.coordinates
    sign = 1.0 if reference.is_enabled else -1.0
    errors = reference.accuracy or known.get(reference.label, (DEFAULT_POSITION,) * 3)
    turns = reference.angle_accuracy or (DEFAULT_ANGLE,) * 3
    turn_sign = sign if reference.angle_accuracy else -1.0
    yaw, pitch, roll = (value * RADIANS_PER_DEGREE for value in reference.angles or (math.nan,) * 3)
    sx, sy, sz = (sign * abs(value) for value in errors)
    s_yaw, s_pitch, s_roll = (turn_sign * value * RADIANS_PER_DEGREE for value in turns)
    return Station(
        reference.label,
        (x or 0.0, y or 0.0, z or 0.0),
        (sx, sy, sz),
        (roll, pitch, yaw),
        (s_roll, s_pitch, s_yaw) if reference.angles else NOT_GIVEN,
        line=reference.line,
    )


def _control(
    reference: Reference, known: Mapping[str, tuple[float | None, float | None, float | None]]
) -> ControlPoint:
    sign = 1.0 if reference.is_enabled else -1.0
    given = reference.accuracy or known.get(reference.label, (None, None, None))
    x, y, z = (
        None if value is None or error is None else sign * abs(error)
        for value, error in zip(reference.coordinates, given, strict=True)
    )
    return ControlPoint(reference.label, reference.coordinates, (x, y, z), line=reference.line)


def _notes(found: _Placed, shown: str, *, is_on_the_ground: bool) -> list[str]:
    counts = [(len(found.stations), "camera"), (len(found.control), "marker")]
    named = ", ".join(counted(number, noun) for number, noun in counts if number)
    notes = [f"References from {shown}: {named}."] if named else []
    if found.stations and not is_on_the_ground:
        notes.append("The chunk is not on the ground: references of cameras are left out.")
    if found.incomplete:
        notes.append(f"{counted(found.incomplete, 'camera')} without all coordinates left out.")
    if found.without_accuracy:
        notes.append(
            f"{counted(found.without_accuracy, 'camera')} without accuracy: {DEFAULT_POSITION:g} m were assumed, as "
            "Metashape does."
        )
    if found.unknown:
        more = f" and {len(found.unknown) - 3} more" if len(found.unknown) > 3 else ""
        notes.append(
            f"{counted(len(found.unknown), 'label')} of {shown} left out, as no oriented camera or marker has it: "
            f"{', '.join(found.unknown[:3])}{more}."
        )
    return notes
