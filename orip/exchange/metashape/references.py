"""A project of Metashape with the references of a table: they take the place of those in the document."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from msgspec import Struct, field

from orip.exchange.metashape.chunk import DEFAULT_POSITION, LEAST_RADIUS
from orip.exchange.metashape.reference_table import Reference, ReferenceTable, read_reference_table
from orip.exchange.sources.collected import PhotoNames
from orip.exchange.sources.faults import Faults
from orip.files.text.shown import Parsed
from orip.records.exchanged import ExchangedProject
from orip.records.observations.control import ControlPoint
from orip.records.observations.station import NOT_GIVEN, Station, StationReference
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE
from orip.wording import counted

_DEFAULT_ANGLE = 2.0
"""Degrees: Metashape's own accuracy of the angles of a camera where nothing else is known."""

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
    path : Path
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
        notes=(*project.notes, *_notes(found, path.name, is_on_the_ground=is_on_the_ground)),
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
    turns = reference.angle_accuracy or (_DEFAULT_ANGLE,) * 3
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
