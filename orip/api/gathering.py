"""From plain arrays to a block: the checks of orip.toml, of control files and of measurement files, all at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict

from orip.api import control_tables
from orip.api.columns import Columns
from orip.api.given import (
    Camera,
    ControlPoints,
    Directions,
    Distances,
    Elements,
    Figures,
    GivenDirections,
    PhotoPoints,
    Photos,
    PreliminaryPoints,
    Stations,
)
from orip.bundle.assemble import BlockInput
from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.project.reader import checked_tables
from orip.files.project.records import project_definition
from orip.files.text.shown import Parsed, printable, shown_token
from orip.interior.definitions import Definitions
from orip.interior.in_force import interior_orientation
from orip.records.control import PHOTO_ERRORS, Control, PreliminaryPoint
from orip.records.definition import ProjectDefinition
from orip.records.measurement import Measured, PhotoObservations
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.wording import listed_names
from orip.workflow.records.reconcile import with_polynomial

_PROJECT = "BLOCK"
"""A name that a project must have; it appears nowhere."""

_TABLES = {
    "camera": "cameras",
    "photo": "photos",
    "antenna": "antennas",
    "rig": "rigs",
    "exposure": "exposures",
}
"""What the sections of orip.toml are called as arguments of a block."""

_KINDS: Mapping[str, tuple[type, bool]] = {
    "photos": (Photos, True),
    "photo_points": (PhotoPoints, True),
    "control_points": (ControlPoints, False),
    "elements": (Elements, False),
    "distances": (Distances, False),
    "directions": (Directions, False),
    "figures": (Figures, False),
    "given_directions": (GivenDirections, False),
    "stations": (Stations, False),
    "preliminary_points": (PreliminaryPoints, False),
}
"""The class of each table, and whether it must be given."""


class Given(Struct, frozen=True):
    """What a block is made from; see `orip.Block`."""

    cameras: Sequence[Camera]
    photos: Photos
    photo_points: PhotoPoints
    control_points: ControlPoints | None
    elements: Elements | None
    distances: Distances | None
    directions: Directions | None
    figures: Figures | None
    given_directions: GivenDirections | None
    stations: Stations | None
    antennas: Sequence[Mapping[str, Any]]
    rigs: Sequence[Mapping[str, Any]]
    exposures: Sequence[Mapping[str, Any]]
    preliminary_points: PreliminaryPoints | None
    ground_unit: str
    crs: str | None
    settings: Mapping[str, Any]


def block_input(given: Given) -> BlockInput:
    """Check all that is given, and return what a block is gathered from.

    Raises
    ------
    InputError
        With everything that is wrong.
    """
    if wrong := list(_wrong_tables(given)):
        raise InputError(wrong)
    definition, complaints = _definition(given)
    observations = _observations(given)
    points, correlations = control_tables.control_points(given.control_points)
    elements = control_tables.elements(given.elements)
    distances = control_tables.distances(given.distances)
    directions = control_tables.directions(given.directions)
    figures = control_tables.figures(given.figures)
    given_directions = control_tables.given_directions(given.given_directions)
    stations = control_tables.stations(given.stations)
    preliminary = control_tables.preliminary_points(given.preliminary_points)
    tables: tuple[Parsed[Any], ...] = (
        observations, points, elements, distances, directions, figures, given_directions, stations, preliminary,
    )  # fmt: skip
    complaints += [complaint for table in tables for complaint in table.complaints]
    if complaints or definition is None or observations.value is None:
        raise InputError(complaints)
    control = Control(
        points.value, elements.value, distances.value, directions.value, stations.value,
        correlations=correlations, figure_points=figures.value, given_directions=given_directions.value,
    )  # fmt: skip
    return _block_input(definition, observations.value, control, preliminary.value, points.warnings)


def _wrong_tables(given: Given) -> Iterator[Complaint]:
    """Yield a complaint for each table that is something else."""
    cameras: object = given.cameras
    if not isinstance(cameras, list | tuple):
        yield Complaint(f"is {shown_token(repr(cameras))}; a list of orip.Camera is needed", "cameras")
    for name in ("antennas", "rigs", "exposures"):
        dicts: object = getattr(given, name)
        if not isinstance(dicts, list | tuple):
            yield Complaint(f"is {shown_token(repr(dicts))}; a list of dicts is needed", name)
            continue
        for row, one in enumerate(dicts):
            if not isinstance(one, Mapping):
                yield Complaint(f"is {shown_token(repr(one))}; a dict is needed", f"{name}[{row}]")
    for name, (kind, is_needed) in _KINDS.items():
        table = getattr(given, name)
        if not isinstance(table, kind) and (is_needed or table is not None):
            yield Complaint(f"is {shown_token(repr(table))}; an orip.{kind.__name__} is needed", name)


def _block_input(
    definition: ProjectDefinition,
    observations: PhotoObservations,
    control: Control,
    preliminary: tuple[PreliminaryPoint, ...],
    warnings: tuple[ProjectWarning, ...],
) -> BlockInput:
    cameras = tuple(map(with_polynomial, definition.cameras))
    (bundle,) = definition.bundles
    records = Definitions(
        {record_key(camera.name): camera for camera in cameras},
        {},
        {},
        {record_key(photo.name): photo for photo in definition.photos},
        {record_key(bundle.name): bundle.name},
    )
    measured = Measured(observations={record_key(bundle.name): observations})
    interior = interior_orientation(records, measured)
    unit, crs = definition.ground_unit, definition.crs
    antennas, rigs = definition.antennas, definition.rigs
    return BlockInput(bundle, records, measured, interior, control, preliminary, unit, crs, warnings, antennas, rigs)


# cameras, photos and settings, as the tables of orip.toml


def _definition(given: Given) -> tuple[ProjectDefinition | None, list[Complaint]]:
    complaints: list[Complaint] = []
    cameras = list(_camera_tables(given.cameras, complaints))
    photos, of_photos = _photo_tables(given.photos)
    settings = {key: _plain(value) for key, value in given.settings.items()}
    document = {
        "project": {"name": _PROJECT, "ground_unit": given.ground_unit} | ({"crs": given.crs} if given.crs else {}),
        "camera": cameras,
        "photo": photos,
        "antenna": list(map(_plain, given.antennas)),
        "rig": list(map(_plain, given.rigs)),
        "exposure": list(map(_plain, given.exposures)),
        "bundle": [settings],
    }
    source, faults = checked_tables(document, lambda place: int(place[1]) + 1 if len(place) > 1 else 0)
    complaints += of_photos
    for place, message in faults:
        where = f"{_TABLES[str(place[0])]}[{place[1]}]" if place and place[0] in _TABLES and len(place) > 1 else ""
        complaints.append(Complaint(printable(control_tables.in_rows(message)), where))
    if complaints or source.project is None:
        return None, list(dict.fromkeys(complaints))
    return project_definition(source, source.project), []


def _camera_tables(cameras: Sequence[object], complaints: list[Complaint]) -> Iterator[dict[str, Any]]:
    for index, camera in enumerate(cameras):
        if not isinstance(camera, Camera):
            message = f"is {shown_token(repr(camera))}; an orip.Camera is needed"
            complaints.append(Complaint(message, f"cameras[{index}]"))
            continue
        values = asdict(camera)
        values["set"] = values.pop("additional_set")
        yield {key: _plain(value) for key, value in values.items() if value is not None}


def _photo_tables(given: Photos) -> tuple[list[dict[str, Any]], list[Complaint]]:
    columns = Columns("photos")
    names = columns.names("name", given.name)
    cameras = columns.names("camera", given.camera, may_be_one=True)
    unknown = np.nan if given.orientation is None else given.orientation
    orientation = columns.numbers("orientation", unknown, 6, unknown=True)
    constant = None if given.constant is None else columns.flags("constant", given.constant, 6)
    tables = []
    for row, name in enumerate(names or ()):
        table: dict[str, Any] = {"name": name} | ({} if cameras is None else {"camera": cameras[row]})
        if orientation is not None:
            values = zip(PHOTO_PARAMETERS, orientation[row].tolist(), strict=True)
            table |= {kind: value for kind, value in values if not np.isnan(value)}
        if constant is not None:
            table["constant"] = [kind for kind, held in zip(PHOTO_PARAMETERS, constant[row], strict=True) if held]
        if cameras is not None:
            tables.append(table)
    return tables, columns.complaints


def _plain(value: Any) -> Any:
    """Return a value as `tomllib` would have read it: lists, tables, texts and numbers of Python."""
    if isinstance(value, Mapping):
        return {key: _plain(element) for key, element in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_plain(element) for element in value] if isinstance(value, list | tuple) else value


# photo points


def _observations(given: Given) -> Parsed[PhotoObservations | None]:
    columns = Columns("photo_points")
    points = given.photo_points
    photo = columns.names("photo", points.photo)
    point = columns.names("point", points.point)
    xy = columns.numbers("xy", points.xy, 2)
    error = columns.numbers("error", np.nan if points.error is None else points.error, 2, unknown=True)
    if photo is not None:
        _check_photos(columns, photo, given.photos)
    if photo is not None and point is not None:
        _check_repeated(columns, photo, point)
    if error is not None:
        message = "an a-priori error of 0 is not allowed here; write a positive one, or a negative one to disregard it"
        columns.complain_of("error", [(tuple(index), message) for index in np.argwhere(error == 0.0).tolist()])
        faults = ((index, PHOTO_ERRORS.fault(value)) for index, value in np.ndenumerate(error))
        columns.complain_of("error", [(index, fault) for index, fault in faults if fault is not None])
    if photo is None or point is None or xy is None or error is None or columns.complaints:
        return Parsed(None, tuple(columns.complaints))
    first = {key: row for row, key in reversed(list(enumerate(map(record_key, photo))))}
    # photo by photo, as a measurement log is replayed
    order = np.argsort([first[record_key(name)] for name in photo], kind="stable")
    return Parsed(
        PhotoObservations(
            str(given.settings["name"]),
            tuple(photo[row] for row in order),
            tuple(point[row] for row in order),
            xy[order],
            error[order],
            np.zeros(len(order), dtype=np.bool_),
        )
    )


def _check_photos(columns: Columns, photo: Sequence[str], photos: Photos) -> None:
    known = [name for name in np.asarray(photos.name, dtype=object).ravel().tolist() if isinstance(name, str)]
    keys = set(map(record_key, known))
    first: dict[str, int] = {}
    for row, name in enumerate(photo):
        if record_key(name) not in keys:
            first.setdefault(name, row)
    listed = listed_names(known)
    faults = [(row, f"photo {shown_token(name)} is not defined; known are: {listed}") for name, row in first.items()]
    columns.complain_of("photo", faults)


def _check_repeated(columns: Columns, photo: Sequence[str], point: Sequence[str]) -> None:
    first: dict[tuple[str, str], int] = {}
    faults = []
    for row, (of, name) in enumerate(zip(photo, point, strict=True)):
        known = first.setdefault((record_key(of), name), row)
        if known != row:
            message = f"point '{shown_token(name)}' of photo '{shown_token(of)}' is already in row {known}"
            faults.append((row, f"{message}; keep one of the two rows"))
    columns.complain_of("", faults)
