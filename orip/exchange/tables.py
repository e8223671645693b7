"""A folder of tables: observations and cameras, and photos, control, points and stations as far as there are any."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from msgspec import Struct, field

from orip.errors import Complaint
from orip.exchange.format import Conventions, Format, never
from orip.exchange.gis import READING as DRAWN
from orip.exchange.gis import write_tables
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, PhotoNames
from orip.exchange.sources.text import GROUND_LENGTHS, Faults, Row, Table, read_table
from orip.files.text.separated import EASTINGS, HEIGHTS, NAMES_OF_PHOTOS, NAMES_OF_POINTS, NORTHINGS
from orip.files.text.shown import Parsed
from orip.records.control import ControlPoint, Station
from orip.records.exchanged import (
    PIXELS,
    ExchangedCamera,
    ExchangedPhoto,
    ExchangedProject,
    ImageAxes,
    PoseReading,
)
from orip.structs import replace
from orip.units import METRES_PER_FOOT
from orip.wording import counted

# Coordinates in images are columns and rows from the outer corner of the upper left pixel, or millimetres from the
# middle of the frame, y up. Cameras are in OpenCV's form, in pixels. Angles are orip's omega, phi, kappa in degrees.

READING = PoseReading("y_up", "to_ground", "omega_phi_kappa", "degree")
MILLIMETRES = ImageAxes("mm", "frame_centre", "up")

_GROUND = {"X": EASTINGS, "Y": NORTHINGS, "Z": HEIGHTS}
_DEVIATIONS = {
    "sX": "sx ax sigmax stdx sde accuracyx",
    "sY": "sy ay sigmay stdy sdn accuracyy",
    "sZ": "sz az sigmaz stdz sdu accuracyz",
}

COLUMNS: Final[Mapping[str, Mapping[str, str]]] = MappingProxyType(
    {
        "cameras": {
            "camera": "camera name label", "columns": "columns width_px w", "rows": "rows height_px h",
            "f": "f focal_px fx", "cx": "cx", "cy": "cy", "k1": "k1", "k2": "k2", "k3": "k3", "p1": "p1", "p2": "p2",
            "width": "width width_mm", "height": "height height_mm",
        },
        "photos": {
            "photo": f"{NAMES_OF_PHOTOS} name label", "camera": "camera", "X0": "x0 x", "Y0": "y0 y", "Z0": "z0 z",
            "OMEGA": "omega", "PHI": "phi", "KAPPA": "kappa",
        },
        "observations": {
            "photo": NAMES_OF_PHOTOS, "point": NAMES_OF_POINTS, "column": "column col x_px x u", "row": "row y_px y v",
            "x": "x_mm", "y": "y_mm", "deviation": "s sigma deviation", "used": "used active",
        },
        "control": {"point": NAMES_OF_POINTS, **_GROUND, **_DEVIATIONS, "kind": "kind type"},
        "points": {"point": NAMES_OF_POINTS, **_GROUND},
        "stations": {
            "photo": f"{NAMES_OF_PHOTOS} name label",
            "X": f"{EASTINGS} x0", "Y": f"{NORTHINGS} y0", "Z": f"{HEIGHTS} z0", **_DEVIATIONS,
        },
    }
)  # fmt: skip
"""Tables by the name of their file, without .csv; orip's names of their columns and those by which they are known."""

_NEEDED = {
    "cameras": ("camera", "columns", "rows", "f"), "photos": ("photo",), "observations": ("photo", "point"),
    "control": ("point", "X", "Y", "Z"), "points": ("point", "X", "Y", "Z"),
    "stations": ("photo", "X", "Y", "Z", "sX", "sY", "sZ"),
}  # fmt: skip
_ENDINGS = (".csv", ".txt", ".tsv")
_LENS = ("k1", "k2", "k3", "p1", "p2")
_UNUSED = {"0", "false", "no"}


class _Read(Struct):
    """What has been read of a folder."""

    cameras: dict[str, ExchangedCamera] = field(default_factory=dict)
    photos: dict[str, ExchangedPhoto] = field(default_factory=dict)
    points: CollectedPoints = field(default_factory=CollectedPoints)
    rays: CollectedRays = field(default_factory=CollectedRays)
    control: list[ControlPoint] = field(default_factory=list)
    stations: list[Station] = field(default_factory=list)


def tables_of(source: Path) -> dict[str, Path]:
    """Return the tables of a folder by their names."""
    return {
        name: source / f"{name}{ending}"
        for name in COLUMNS
        for ending in reversed(_ENDINGS)
        if (source / f"{name}{ending}").is_file()
    }


def is_tables(source: Path) -> bool:
    """Return whether a folder has tables of observations and cameras."""
    return source.is_dir() and {"observations", "cameras"} <= set(tables_of(source))


def read_tables(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a folder of tables."""
    files = tables_of(source) if source.is_dir() else {}
    if not {"observations", "cameras"} <= set(files):
        message = (
            "the folder should have observations.csv and cameras.csv; photos, control, points and stations may be there"
        )
        return Parsed(None, (Complaint(message, shown),))
    tables = {
        name: read_table(path, f"{shown}/{path.name}", COLUMNS[name], _NEEDED[name]) for name, path in files.items()
    }
    found = _filled(tables)
    complaints = [complaint for table in tables.values() for complaint in table.faults.complaints]
    if not complaints and not found.photos:
        complaints.append(Complaint("there is no observation and no photo", shown))
    if complaints:
        return Parsed(None, tuple(complaints))
    return Parsed(_project(found, tables))


def _filled(tables: Mapping[str, Table]) -> _Read:
    """Return what the rows of tables say; what is wrong in them is kept with the tables."""
    found = _Read()
    axes = MILLIMETRES if {"x", "y"} <= set(tables["observations"].columns) else PIXELS
    for row in tables["cameras"].rows:
        _add_camera(tables["cameras"], row, axes, found)
    if photos := tables.get("photos"):
        for row in photos.rows:
            _add_photo(photos, row, found)
    if points := tables.get("points"):
        for row in points.rows:
            found.points.add(row.text("point"), points.numbers(row, ("X", "Y", "Z")))
    _add_rays(tables["observations"], axes, found)
    if control := tables.get("control"):
        found.control += list(_control(control))
    if stations := tables.get("stations"):
        found.stations += list(_stations(stations))
    return found


def _project(found: _Read, tables: Mapping[str, Table]) -> ExchangedProject:
    names = PhotoNames(found.photos)
    photos = list(found.photos)
    stations = tuple(
        replace(station, photo=photos[place])
        for station in found.stations
        if (place := names.place(station.photo)) is not None
    )
    notes = names.notes("stations.csv", "station")
    notes += [
        f"{name}: {counted(len(table.ignored), 'column')} not read: {', '.join(table.ignored)}."
        for name, table in tables.items()
        if table.ignored
    ]
    notes += [f"{name}.csv has a heading alone: nothing was read." for name, table in tables.items() if not table.rows]
    notes += [note for name, table in tables.items() for note in _said_of_units(name, table)]
    commas = [name for name, table in tables.items() if table.has_decimal_commas]
    notes += [f"Numbers with decimal commas: {', '.join(commas)}."] if commas else []
    return ExchangedProject(
        "",
        tuple(found.cameras.values()),
        tuple(found.photos.values()),
        found.points.points(),
        found.rays.rays(),
        (READING,),
        control=tuple(found.control),
        stations=stations,
        ground_unit="m" if found.control or found.stations else "unit",
        notes=tuple(notes),
    )


def _said_of_units(name: str, table: Table) -> Iterator[str]:
    """Yield a sentence for each unit of lengths but metres."""
    factors = {column: table.scale.get(column, 1.0) for column in table.columns if column in GROUND_LENGTHS}
    for factor in sorted(set(factors.values()) - {1.0}):
        columns = ", ".join(column for column, its in factors.items() if its == factor)
        foot = " (international feet; write ftUS for those of the US survey)" if factor == METRES_PER_FOOT else ""
        yield f"{name}: {columns} multiplied by {factor:.10g} to be in metres{foot}."


def _add_camera(table: Table, row: Row, axes: ImageAxes, found: _Read) -> None:
    columns, rows = (table.faults.whole(row.text(name), name, row.line, 1) for name in ("columns", "rows"))
    focal = table.number(row, "f")
    if columns is None or rows is None or not focal > 0.0:
        table.faults.complain("a camera needs columns, rows and f in pixels, all above 0", row.line)
        return
    size = table.numbers(row, ("width", "height"))
    sensor = (size[0], size[1]) if all(value > 0.0 for value in size) else None
    if sensor is None and axes is MILLIMETRES:
        table.faults.complain("observations in millimetres need the camera's width and height in mm", row.line)
    given = {name: value for name in _LENS if not math.isnan(value := table.number(row, name))}
    cx, cy = table.numbers(row, ("cx", "cy"))
    parameters = {
        "fx": focal, "fy": focal, "cx": columns / 2.0 if math.isnan(cx) else cx,
        "cy": rows / 2.0 if math.isnan(cy) else cy, **given,
    }  # fmt: skip
    name = row.text("camera")
    if name in found.cameras:
        table.faults.complain(f"camera {name} is in the table already", row.line)
    found.cameras[name] = ExchangedCamera(
        name, columns, rows, "opencv", parameters, "OpenCV", ray_axes=axes, sensor_mm=sensor
    )


def _camera_place(name: str, line: int, found: _Read, faults: Faults) -> int:
    """Return the place of a camera; of the only one if none is named."""
    names = list(found.cameras)
    if name in names:
        return names.index(name)
    if name or len(names) != 1:
        said = f"camera '{name}' is not in cameras.csv" if name else "name the camera of each photo in photos.csv"
        faults.complain(said, line)
    return 0


def _add_photo(table: Table, row: Row, found: _Read) -> None:
    name = row.text("photo")
    if not name or name in found.photos:
        table.faults.complain(f"photo {name} is in the table already" if name else "the photo has no name", row.line)
        return
    camera = _camera_place(row.text("camera"), row.line, found, table.faults)
    places, angles = ("X0", "Y0", "Z0"), ("OMEGA", "PHI", "KAPPA")
    position = table.numbers(row, places) if row.has(*places) else ()
    rotation = table.numbers(row, angles) if row.has(*angles) else ()
    found.photos[name] = ExchangedPhoto(name, camera, rotation, position, key=len(found.photos))


def _add_rays(table: Table, axes: ImageAxes, found: _Read) -> None:
    columns = ("x", "y") if axes is MILLIMETRES else ("column", "row")
    if table.rows and not set(columns) <= set(table.columns):
        table.faults.complain("there are no columns column and row (pixels), or x_mm and y_mm")
        return
    number = {name: n for n, name in enumerate(found.photos)}
    for row in table.rows:
        name, point = row.text("photo"), row.text("point")
        if not name or not point or not row.has(*columns):
            table.faults.complain("an observation needs photo, point and both coordinates", row.line)
            continue
        if name not in number:
            number[name] = len(number)
            camera = _camera_place("", row.line, found, table.faults)
            found.photos[name] = ExchangedPhoto(name, camera, key=number[name])
        is_active = row.text("used").lower() not in _UNUSED
        found.rays.add(
            number[name],
            found.points.add(point),
            table.numbers(row, columns),
            table.number(row, "deviation"),
            is_active=is_active,
        )


def _control(table: Table) -> Iterator[ControlPoint]:
    """Yield control; a coordinate that is empty is not known, and one without a deviation has none."""
    for row in table.rows:
        coordinates = [None if math.isnan(v) else v for v in table.numbers(row, ("X", "Y", "Z"))]
        given = table.numbers(row, ("sX", "sY", "sZ"))
        sign = -1.0 if row.text("kind").lower() == "check" else 1.0
        if sign < 0.0 and any(math.isnan(one) for one in given):
            table.faults.complain(f"check point {row.text('point')} needs sX, sY and sZ", row.line)
            continue
        errors = [
            None if value is None or math.isnan(one) else sign * one
            for value, one in zip(coordinates, given, strict=True)
        ]
        if not row.text("point") or all(value is None for value in coordinates):
            table.faults.complain("a control point needs a name and a coordinate", row.line)
            continue
        x, y, z = coordinates
        yield ControlPoint(row.text("point"), (x, y, z), (errors[0], errors[1], errors[2]), line=row.line)


def _stations(table: Table) -> Iterator[Station]:
    for row in table.rows:
        x, y, z, *errors = table.numbers(row, ("X", "Y", "Z", "sX", "sY", "sZ"))
        if any(map(math.isnan, (x, y, z, *errors))):
            table.faults.complain("a station needs X, Y, Z and sX, sY, sZ", row.line)
            continue
        yield Station(row.text("photo"), (x, y, z), (errors[0], errors[1], errors[2]), line=row.line)


CSV_FORMAT = Format(
    "csv",
    "CSV: tables of observations, cameras and more are read; adjusted points and photos are written",
    read_tables,
    is_tables,
    write=write_tables,
    conventions=Conventions(None, DRAWN, is_cartesian=False, is_copied=never),
)
