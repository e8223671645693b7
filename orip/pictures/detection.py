"""`orip detect`: targets of the pictures of a project to a measurement file, boards to its control."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, InputError
from orip.files.control.editing import read_control_lines
from orip.files.control.text import distances_text, parse_points, points_text
from orip.files.log.writing import points_header
from orip.files.text.lines import read_lines
from orip.files.text.regular_file import natural_key
from orip.images.image_files import IMAGE_ENDINGS, Grey, read_colours, read_grey, read_header
from orip.pictures.targets.boards import Board, board_points
from orip.pictures.targets.marks import FoundTargets, Mark
from orip.pictures.targets.sheets import Sheet, sheet_of
from orip.progress import stage
from orip.records.camera import Camera
from orip.records.control import ControlDistance, ControlPoint
from orip.records.names import near_names, record_key
from orip.records.photo import Photo
from orip.workflow.project.commit import Change
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import EditedText, digest_of_text
from orip.workflow.project.state import ProjectState
from orip.workflow.project.texts import is_measurement_file

HEADING = "! targets detected by orip"
"""Of measurement files that the next run may replace."""

_UNITS = {"mm": 1.0, "cm": 0.1, "m": 0.001}
_DIGITS = 4

Finder = Callable[[Any], FoundTargets]


class Detection(Struct, frozen=True):
    """What is detected in which pictures, and where it goes.

    Parameters
    ----------
    what : str
        One line that says what is looked for.
    find : callable
        From grey values to targets.
    images : tuple of Path
        Files and folders, relative to the project.
    bundle : str or None
        None: the only one of the project.
    output : Path
        Measurement file, relative to the project.
    least_error : float
        Added in quadrature to the standard deviations of the marks, pixels.
    control : tuple of ControlPoint or ControlDistance
        Lines for the project's control, where it does not have them.
    replaces : bool
        Another measurement file may be replaced.
    """

    what: str
    find: Finder
    images: tuple[Path, ...]
    bundle: str | None
    output: Path
    least_error: float
    control: tuple[ControlPoint, ...] | tuple[ControlDistance, ...] = ()
    replaces: bool = False


class DetectedPhoto(Struct, frozen=True):
    """The targets of one photo; `fault` says why the picture has none."""

    photo: str
    image: str
    found: FoundTargets


class Detected(Struct, frozen=True):
    """What was detected, and the files that it is, or would be, written to."""

    photos: tuple[DetectedPhoto, ...]
    files: tuple[str, ...]
    dry_run: bool


def detect(state: ProjectState, detection: Detection, *, dry_run: bool = False) -> Change[Detected]:
    """Return the targets of pictures as a measurement file.

    Raises
    ------
    InputError
        If pictures are no photos of the project, or there is no target in any of them.
    """
    project = state.project
    pictures = _pictures(state, detection.images)
    output = project.folder / detection.output
    _require_measurement_file(project, output, replaces=detection.replaces)
    bundle = _bundle(state, detection.bundle)
    photos = []
    with stage("detecting targets", len(pictures)) as advance:
        for done, (photo, path, camera) in enumerate(pictures, start=1):
            shown = project.shown(path)
            photos.append(DetectedPhoto(photo.name, shown, _found(path, shown, photo, camera, detection.find)))
            advance(done)
    if not any(one.found.marks for one in photos):
        raise InputError([Complaint(one.found.fault, one.image) for one in photos])
    text = _measurements(photos, bundle, detection, {photo.name: photo for photo, _, _ in pictures})
    texts = [EditedText(output, digest_of_text(output), text, "the file is unchanged"), *_control(project, detection)]
    outcome = Detected(tuple(photos), tuple(project.shown(one.path) for one in texts), dry_run)
    if dry_run:
        return Change(state, outcome)
    return Change(state, outcome, is_compared=False, edited_texts=tuple(texts))


def _found(path: Path, shown: str, photo: Photo, camera: Camera | None, find: Finder) -> FoundTargets:
    try:
        header = read_header(path, shown)
        fault = _misfit(photo, camera, header.columns, header.rows)
        return FoundTargets((), (), fault) if fault else find(_green(path, shown))
    except InputError as error:  # the other pictures are used
        return FoundTargets((), (), "; ".join(complaint.message for complaint in error.complaints))


def _misfit(photo: Photo, camera: Camera | None, columns: int, rows: int) -> str:
    sensor = None if camera is None else camera.sensor
    if sensor is None or camera is None:
        return "" if photo.scan else f"photo {photo.name} is measured in mm; give its camera a sensor, or a scan"
    if (sensor.columns, sensor.rows) == (columns, rows):
        return ""
    return f"has {columns} x {rows} pixels, but camera {camera.name} has {sensor.columns} x {sensor.rows}"


def _green(path: Path, shown: str) -> Grey:
    """Return the green band of a colour picture of 8 bits, else grey values.

    A lens images each colour at a scale of its own, so that grey values mixed of all have edges of three places; green
    is the sharpest band of most sensors, with twice as many pixels as the others.
    """
    header = read_header(path, shown)
    if header.format == "TIFF" or header.bits == 16 or header.channels == 1:
        return read_grey(path, shown=shown)
    return np.ascontiguousarray(read_colours(path, shown=shown)[:, :, 1])


def _pictures(state: ProjectState, images: Sequence[Path]) -> list[tuple[Photo, Path, Camera | None]]:
    """Return the photos that pictures belong to: their names are those of the files, whatever the ending.

    Without pictures those that the photos name themselves are meant.
    """
    photos, cameras = _records(state)
    if not images:
        named = [photo for photo in photos.values() if photo.image]
        folder = state.project.folder
        if named:
            return [(one, folder / str(one.image), cameras.get(record_key(one.camera))) for one in named]
    complaints: list[Complaint] = []
    found: list[tuple[Photo, Path, Camera | None]] = []
    seen: dict[str, str] = {}
    for path in _files(state.project, images, complaints):
        photo = photos.get(record_key(path.stem))
        shown = state.project.shown(path)
        if photo is None:
            near = near_names(path.stem, (known.name for known in photos.values()))
            complaints.append(Complaint(f"no photo of the project is called {path.stem}; {near}", shown))
        elif (before := seen.setdefault(record_key(path.stem), shown)) != shown:
            complaints.append(Complaint(f"photo {photo.name} has another picture already: {before}", shown))
        else:
            found.append((photo, path, cameras.get(record_key(photo.camera))))
    if complaints or not found:
        raise InputError(
            complaints
            or [Complaint("name the pictures, or a folder of them: JPEG, PNG or TIFF; or write image in [[photo]]")]
        )
    return found


def _records(state: ProjectState) -> tuple[dict[str, Photo], dict[str, Camera]]:
    """Return the photos and cameras of orip.toml and of the stores by their keys; the text has precedence."""
    definition = state.project.definition
    photos = {record_key(photo.name): photo for photo in (*state.records.photos.values(), *definition.photos)}
    cameras = {record_key(one.name): one for one in (*state.records.cameras.values(), *definition.cameras)}
    return photos, cameras


def _files(project: ProjectFolder, images: Sequence[Path], complaints: list[Complaint]) -> Iterator[Path]:
    for named in images:
        path = project.folder / named
        try:
            inside = sorted(path.iterdir(), key=lambda one: natural_key(one.name)) if path.is_dir() else [path]
        except OSError as error:
            complaints.append(Complaint(f"the folder cannot be read ({error.strerror})", project.shown(path)))
            continue
        yield from (one for one in inside if one == path or one.suffix.lower() in IMAGE_ENDINGS)


def _bundle(state: ProjectState, name: str | None) -> str:
    known = [bundle.name for bundle in state.project.definition.bundles]
    if name is None:
        if len(known) != 1:
            message = f"the project has {len(known)} bundles; name one with --bundle"
            raise InputError.single(message, state.project.shown(state.project.text))
        return known[0]
    for bundle in known:
        if record_key(bundle) == record_key(name):
            return bundle
    message = f"bundle {name} is not defined; {near_names(name, known)}"
    raise InputError.single(message)


def _require_measurement_file(project: ProjectFolder, path: Path, *, replaces: bool) -> None:
    shown = project.shown(path)
    if not is_measurement_file(project, path):
        patterns = ", ".join(project.definition.measurement_files)
        message = f"{shown} would not be read: measurement_files is {patterns}"
        raise InputError.single(message, project.shown(project.text))
    there = read_lines(path, shown, may_be_absent=True).value
    if there and not there[0].startswith(HEADING) and not replaces:
        message = "was not written by 'orip detect'; name another file with --output, or give --replace"
        raise InputError.single(message, shown)


def _measurements(
    photos: Sequence[DetectedPhoto], bundle: str, detection: Detection, records: Mapping[str, Photo]
) -> str:
    lines = [f"{HEADING}: {detection.what}"]
    for one in photos:
        if one.found.marks:
            scan = records[one.photo].scan
            shift = 0.5 if scan is not None and scan.origin == "centre" else 0.0
            marks = (_line(mark, shift, detection.least_error) for mark in one.found.marks)
            lines += ["", points_header(bundle, one.photo), *marks]
    return "\n".join(lines) + "\n"


def _line(mark: Mark, shift: float, least: float) -> str:
    ex, ey = (max(float(np.hypot(one, least)), 10.0**-_DIGITS) for one in mark.deviation)
    place = f"{mark.column - shift:11.4f} {mark.row - shift:11.4f}"
    return f"  {mark.name:<8} {place}  {ex:.{_DIGITS}f}px {ey:.{_DIGITS}f}px"


def _control(project: ProjectFolder, detection: Detection) -> list[EditedText]:
    """Return the control file with the lines that it lacks, if there are any."""
    if not detection.control:
        return []
    is_points = isinstance(detection.control[0], ControlPoint)
    path = project.folder / f"{project.definition.control_files}.{'PNT' if is_points else 'LEN'}"
    lines = read_control_lines(path, project.shown(path))
    there = {line.fields[0].text for line in lines.records()}
    points = [one for one in detection.control if isinstance(one, ControlPoint) and one.name not in there]
    distances = [one for one in detection.control if isinstance(one, ControlDistance) and one.name not in there]
    if not points and not distances:
        return []
    before = lines.text if not lines.text or lines.text.endswith("\n") else lines.text + "\n"
    text = before + f"! {detection.what}\n" + points_text(points) + distances_text(distances)
    return [EditedText(path, digest_of_text(path), text, "the file is unchanged")]


def control_of_board(
    board: Board, kind: Literal["points", "distances", "none"], error_mm: float, ground_unit: str
) -> tuple[ControlPoint, ...] | tuple[ControlDistance, ...]:
    """Return the points of a board as control with their errors, or distances between them.

    Distances are those of the first point and the one farthest from it, and of both with the one farthest from their
    line: they give scale along and across the board.

    Raises
    ------
    InputError
        If the ground unit is neither mm, cm nor m.
    """
    if kind == "none":
        return ()
    if ground_unit not in _UNITS:
        message = f"the size of a board is known in millimetres, but ground_unit is {ground_unit}: give --control none"
        raise InputError.single(message)
    scale = _UNITS[ground_unit]
    points = board_points(board)
    error = round(error_mm * scale, 12)
    if kind == "points":
        return tuple(
            ControlPoint(name, (round(x * scale, 10), round(y * scale, 10), 0.0), (error,) * 3)
            for name, (x, y) in points.items()
        )
    names, xy = list(points), np.array(list(points.values())) * scale
    far = int(np.argmax(np.hypot(*(xy - xy[0]).T)))
    along = xy[far] - xy[0]
    aside = int(np.argmax(np.abs((xy - xy[0]) @ (along[1], -along[0]))))
    pairs = ((0, far), (0, aside), (far, aside))
    return tuple(
        ControlDistance(
            f"{board.prefix}D{index}", names[i], names[j], "XYZ", round(float(np.hypot(*(xy[j] - xy[i]))), 10), error
        )
        for index, (i, j) in enumerate(pairs, start=1)
    )


def read_sheet(path: Path, shown: str, rings: Sequence[tuple[str, int]], radius: float | None) -> Sheet:
    """Return the sheet that a .PNT file describes.

    Parameters
    ----------
    rings : sequence of (name, int)
        Names of coded dots, and how many parts their rings have.
    radius : float or None
        Of the dots, ground units.

    Raises
    ------
    InputError
        With everything that is wrong in the file, and names that it does not have.
    """
    parsed = parse_points(read_lines(path, shown), shown)
    points = {point.name: point for point in parsed.value if None not in point.coordinates and not point.rejected}
    complaints = list(parsed.complaints)
    complaints += [
        Complaint(f"coded dot {name} is not in the file with X, Y and Z; {near_names(name, points)}", shown)
        for name, _ in rings
        if name not in points and not parsed.complaints
    ]
    if len({parts for _, parts in rings}) < len(rings) or len({name for name, _ in rings}) < len(rings):
        complaints.append(Complaint("two coded dots have rings of the same number of parts, or one is named twice"))
    if complaints:
        raise InputError(complaints)
    xyz = np.array([point.coordinates for point in points.values()], dtype=float).reshape(-1, 3)
    return sheet_of(list(points), xyz, dict(rings), radius)
