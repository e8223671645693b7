"""BINGO: ``image.dat`` with measurements, ``geoin.dat`` with cameras and control, read and written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct, field

from orip.errors import Complaint
from orip.exchange.format import OBSERVED, PIXEL_MM, Conventions, Format, never, with_assumed_frame
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, PhotoNames
from orip.exchange.sources.names import distinct_names, names_file, short_names, with_original_names
from orip.exchange.sources.text import Faults, numbered_words, text_lines
from orip.files.text.shown import Parsed
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, ImageAxes, PoseReading
from orip.wording import counted

# Image coordinates are millimetres from the centre of the image, y up. Orientations have phi, omega, kappa in gon; as
# programs differ in that, the measurements decide. Lines that begin with ``*`` or ``C`` are comments.

READING = PoseReading("y_up", "to_ground", "phi_omega_kappa", "gon", "centre")

AXES = ImageAxes("mm", "frame_centre", "up")
_FILES = ("image.dat", "geoin.dat", "itera.dat")
_COMMENTS = "*"
_END = "-99"
_CAMERA, _CONTROL, _CHECK, _ORIENTATION, _POINT = "CAPA", "CONT", "CHCK", "ORIA", "CORD"
_PRECISION_PX = 0.005 / PIXEL_MM
"""A-priori error of a measurement: 5 micrometres."""

_CHECK_ERROR = -0.01
"""Where a check point has no errors; a negative one makes a point a check point."""


class _Ground(Struct):
    """What ``geoin.dat`` has: cameras by name, control, and keywords that are not read."""

    cameras: dict[str, ExchangedCamera] = field(default_factory=dict)
    control: list[ControlPoint] = field(default_factory=list)
    others: dict[str, int] = field(default_factory=dict)


def is_bingo(source: Path) -> bool:
    """Return whether a folder has the files."""
    return source.is_dir() and all((source / name).is_file() for name in _FILES)


def read_bingo(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a folder with image.dat, geoin.dat and itera.dat."""
    if not is_bingo(source):
        return Parsed(None, (Complaint(f"the folder should have {', '.join(_FILES)}", shown),))
    complaints: list[Complaint] = []

    def rows_of(name: str) -> tuple[Iterator[tuple[int, list[str]]], Faults]:
        faults = Faults(f"{shown}/{name}", complaints)
        return numbered_words(text_lines(source / name, faults), _COMMENTS), faults

    ground = _read_ground(*rows_of("geoin.dat"))
    points, rays = CollectedPoints(), CollectedRays()
    rows, faults = rows_of("itera.dat")
    poses = _poses(rows, points, faults)
    cameras = tuple(ground.cameras.values())
    places = {name: n for n, name in enumerate(ground.cameras)}
    rows, faults = rows_of("image.dat")
    oriented = PhotoNames(poses)
    photos = _photos(rows, places, list(poses.values()), oriented, points, rays, faults)
    if not photos and not complaints:
        complaints.append(Complaint("image.dat has no photo", shown))
    if complaints:
        return Parsed(None, tuple(complaints))
    found = rays.rays()
    notes = [_said_of_keywords(ground.others)] if ground.others else []
    of_ray = np.array([photo.camera for photo in photos])[found.photo]
    framed = [with_assumed_frame(camera, found.image[of_ray == n]) for n, camera in enumerate(cameras)]
    notes += [note for _, note in framed]
    notes += oriented.notes("image.dat", "photo", "without orientation")
    project = ExchangedProject(
        "", tuple(camera for camera, _ in framed), tuple(photos), points.points(), found, (READING,),
        tuple(ground.control), ground_unit="m", precision=_PRECISION_PX, notes=tuple(notes),
    )  # fmt: skip
    return Parsed(with_original_names(project, source))


def _said_of_keywords(others: dict[str, int]) -> str:
    said = ", ".join(f"{key} ({counted(number, 'line')})" for key, number in others.items())
    return f"Keywords of geoin.dat that are not read: {said}."


def _read_ground(rows: Iterator[tuple[int, list[str]]], faults: Faults) -> _Ground:
    found = _Ground()
    known: dict[str, int] = {}
    for number, words in rows:
        key = words[0].upper()
        if key == _CAMERA and len(words) > 5:
            c, x, y = (faults.decimal(word, "principal distance and point", number) for word in words[-3:])
            parameters = {"f": c, "cx": x, "cy": y}
            found.cameras[words[1]] = ExchangedCamera(words[1], 0, 0, "isp", parameters, "BINGO", AXES, AXES)
        elif key in (_CONTROL, _CHECK):
            point = _control(words, number, key, faults)
            if point is not None and faults.is_first(point.name, "point", number, known):
                found.control.append(point)
        elif key != "C":
            found.others[key] = found.others.get(key, 0) + 1
    return found


def _control(words: list[str], number: int, key: str, faults: Faults) -> ControlPoint | None:
    if len(words) not in (5, 8):
        faults.complain(f"{len(words)} fields, and 5 or 8 should be here: {key} point E N H [deviations]", number)
        return None
    x, y, z, *given = (faults.decimal(word, "E N H and their deviations", number) for word in words[2:])
    if key == _CHECK:
        errors = [-abs(value) or _CHECK_ERROR for value in given] or [_CHECK_ERROR] * 3
        return ControlPoint(words[1], (x, y, z), (errors[0], errors[1], errors[2]), line=number)
    if not given:
        return ControlPoint(words[1], (x, y, z), (None, None, None), line=number)
    return ControlPoint(words[1], (x, y, z), (given[0], given[1], given[2]), line=number)


def _poses(
    rows: Iterator[tuple[int, list[str]]], points: CollectedPoints, faults: Faults
) -> dict[str, tuple[float, ...]]:
    """Return X Y Z, omega, phi, kappa by photo; adjusted points are added."""
    poses: dict[str, tuple[float, ...]] = {}
    for number, words in rows:
        key = words[0].upper()
        if key not in (_ORIENTATION, _POINT):
            continue
        count = 6 if key == _ORIENTATION else 3
        values = faults.decimals(" ".join(words[2 : 2 + count]), count, key, number)
        if values is None:
            continue
        if key == _POINT:
            points.add(words[1], values)
        else:
            x, y, z, phi, omega, kappa = values
            poses[words[1]] = (x, y, z, omega, phi, kappa)
    return poses


def _photos(
    rows: Iterator[tuple[int, list[str]]],
    cameras: dict[str, int],
    poses: Sequence[tuple[float, ...]],
    oriented: PhotoNames,
    points: CollectedPoints,
    rays: CollectedRays,
    faults: Faults,
) -> list[ExchangedPhoto]:
    """Return the photos of image.dat; a photo begins with its name and camera, and ends with -99."""
    photos: list[ExchangedPhoto] = []
    known: dict[str, int] = {}
    is_open, number = False, 0
    for number, words in rows:
        if words[0] == _END:
            is_open = False
        elif not is_open or len(words) == 2:
            is_open = True
            faults.is_first(words[0], "photo", number, known)
            camera = cameras.get(words[1]) if len(words) > 1 else None
            if camera is None:
                faults.complain("a photo should begin with its name and a camera of geoin.dat (CAPA)", number)
            place = oriented.place(words[0])
            pose = () if place is None else poses[place]
            photos.append(ExchangedPhoto(words[0], camera or 0, pose[3:], pose[:3], key=len(photos)))
        else:
            _add_ray(words, number, len(photos) - 1, points, rays, faults)
    if is_open:
        faults.complain_of_end(f"photo {photos[-1].name}", _END, number)
    return photos


def _add_ray(
    words: list[str], number: int, photo: int, points: CollectedPoints, rays: CollectedRays, faults: Faults
) -> None:
    """Add a measurement; a minus before the name of a point says that it is not used."""
    if len(words) < 3:
        faults.complain("the line should be: point x y", number)
        return
    x, y = (faults.decimal(word, "x and y", number) for word in words[1:3])
    name = words[0].removeprefix("-")
    rays.add(photo, points.add(name or words[0]), (x, y), is_active=not words[0].startswith("-"))


BINGO_TERMS = ("f", "cx", "cy")

_LONGEST = 15
_RESERVED = {"C", "-99"}
"""A line that begins so is a comment, or the end of a photo."""


def write_bingo(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:  # noqa: ARG001  # new
    """Return the files of a folder."""
    cameras = short_names([camera.name for camera in project.cameras], _suits)
    photos = short_names([photo.name for photo in project.photos], _suits)
    points = project.points
    given = distinct_names(points, marks_tracks=True)
    names = short_names(given, _suits, first=list(points.marks.values()))
    control = {name: names[place] for name, place in points.marks.items()}
    return {
        "image.dat": "".join(_image_lines(project, photos, cameras, names)).encode(),
        "geoin.dat": "".join(_ground_lines(project, cameras, control)).encode(),
        "itera.dat": "".join(_result_lines(project, photos, names)).encode(),
        **names_file(
            [
                ("camera", cameras, [camera.name for camera in project.cameras]),
                ("photo", photos, [photo.name for photo in project.photos]),
                ("point", names, given),
            ]
        ),
    }


def _suits(name: str) -> bool:
    is_one_word = name.isascii() and name.split() == [name]
    return is_one_word and len(name) <= _LONGEST and name not in _RESERVED and name[0] not in "*-"


def _image_lines(
    project: ExchangedProject, photos: Sequence[str], cameras: Sequence[str], points: Sequence[str]
) -> Iterator[str]:
    rays = project.rays
    for number, photo in enumerate(project.photos):
        yield f"{photos[number]} {cameras[photo.camera]}\n"
        for row in np.flatnonzero(rays.photo == number).tolist():
            unused = "" if rays.is_active[row] else "-"
            yield f"{unused}{points[rays.point[row]]} {_numbers(rays.image[row].tolist())}\n"
        yield "-99\n"


def _ground_lines(project: ExchangedProject, cameras: Sequence[str], points: Mapping[str, str]) -> Iterator[str]:
    for name, camera in zip(cameras, project.cameras, strict=True):
        parameters = [camera.parameters.get(term, 0.0) for term in BINGO_TERMS]
        yield f"CAPA {name} 0 {_numbers(parameters)}\n"
    for point in project.control:
        yield _control_line(point, points.get(point.name, point.name))


def _control_line(point: ControlPoint, name: str) -> str:
    xyz = [value for value in point.coordinates if value is not None]
    errors = [value for value in point.errors if value is not None]
    signs = {error < 0.0 for error in errors}
    if point.rejected or len(xyz) < 3 or len(signs) > 1 or not _suits(name):
        return f"* {point.name} is rejected, or not given or used in all coordinates: not written\n"
    deviations = f" {_numbers([abs(error) for error in errors])}" if len(errors) == 3 else ""
    return f"{'CHCK' if point.kind == 'check' and errors else 'CONT'} {name} {_numbers(xyz)}{deviations}\n"


def _result_lines(project: ExchangedProject, photos: Sequence[str], points: Sequence[str]) -> Iterator[str]:
    for name, photo in zip(photos, project.photos, strict=True):
        if photo.rotation and photo.position:
            omega, phi, kappa = photo.rotation
            yield f"ORIA {name} {_numbers([*photo.position, phi, omega, kappa])}\n"
    for name, xyz in zip(points, project.points.coordinates.tolist(), strict=True):
        if np.isfinite(xyz).all():
            yield f"CORD {name} {_numbers(xyz)}\n"


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


BINGO_FORMAT = Format(
    "bingo", "BINGO: folder with image.dat, geoin.dat, itera.dat", read_bingo, is_bingo, write_bingo,
    Conventions(
        "isp", READING, AXES, AXES, is_cartesian=False, terms=BINGO_TERMS, is_copied=never, lacks=OBSERVED,
    ),
)  # fmt: skip
