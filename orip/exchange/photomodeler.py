"""PhotoModeler's text export of a project (``Export Text File``), as DBAT reads it.

Six lines for each photo after a head of five, then control points, object points and marks, with an empty line between
them. Lengths of a camera are millimetres; its principal point counts from the upper left corner, and its distortion
takes measured coordinates to ideal ones. Angles are kappa, phi, omega in degrees; marks are columns and rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from orip.errors import Complaint
from orip.exchange.format import Format
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.text import Faults, text_lines
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, ImageAxes, PoseReading

READING = PoseReading("y_up", "to_ground", "omega_phi_kappa", "degree", "centre")

_LENS_AXES = ImageAxes("mm", "frame_centre", "up")
_CAMERA = ("f", "cx", "cy", "width", "height", "k1", "k2", "k3", "p1", "p2")
_HEAD_LINES, _PHOTO_LINES = 5, 6
_BEGINNING = 2000


def is_photomodeler(source: Path) -> bool:
    """Return whether a file begins as such an export does."""
    return _has_head(beginning(source, _BEGINNING).splitlines()[:_HEAD_LINES])


def _has_head(lines: list[str]) -> bool:
    if len(lines) < _HEAD_LINES:
        return False
    counts = [len(line.split()) for line in lines[1:]]
    return counts[0] in (2, 4) and counts[1:] == [9, len(_CAMERA), len(_CAMERA)]


def read_photomodeler(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read an export."""
    faults = Faults(shown)
    lines = text_lines(source, faults)
    if not _has_head(lines[:_HEAD_LINES]):
        faults.complain("this is not a text export of PhotoModeler: the five lines of its head are not there", 1)
        return Parsed(None, tuple(faults.complaints))
    size = faults.decimals(lines[1], len(lines[1].split()), "tolerance, iterations, columns and rows", 2)
    photos, cameras, end = _photos(lines, size, faults)
    points, rays = CollectedPoints(), CollectedRays()
    sections = _sections(lines, end)
    control = tuple(point for number, line in sections[0] if (point := _control(line, number, faults)) is not None)
    wanted = len(sections[1][0][1].split()) if sections[1] else 0
    for number, line in sections[1]:
        words = line.split()
        values = faults.decimals(" ".join(words[1:4]), 3, "object point", number)
        if len(words) != wanted:
            faults.complain(f"object point: {len(words)} fields, and the first one has {wanted}; complete it", number)
        elif values is not None:
            points.add(words[0], values, is_track=False)
    for number, line in sections[2]:
        _add_mark(line, number, len(photos), points, rays, faults)
    if not photos and not faults.complaints:
        faults.complaints.append(Complaint("the file has no photo", shown))
    if faults.complaints:
        return Parsed(None, tuple(faults.complaints))
    return Parsed(
        ExchangedProject(
            lines[0].strip(), tuple(cameras), tuple(photos), points.points(), rays.rays(), (READING,), control
        )
    )


def _photos(
    lines: list[str], size: tuple[float, ...] | None, faults: Faults
) -> tuple[list[ExchangedPhoto], list[ExchangedCamera], int]:
    """Return photos, their different cameras, and where the sections begin."""
    photos: list[ExchangedPhoto] = []
    cameras: dict[tuple[tuple[float, ...], tuple[bool, ...]], int] = {}
    start = _HEAD_LINES
    while start < len(lines) and lines[start].strip():
        if start + _PHOTO_LINES > len(lines):
            faults.complain("the last photo is incomplete: a photo has six lines", start + 1)
            break
        name = lines[start].split(maxsplit=1)[-1].strip()
        pose = faults.decimals(lines[start + 1], 7, "photo, X Y Z, kappa phi omega", start + 2)
        values = faults.decimals(lines[start + 4], 1 + len(_CAMERA), "camera of the photo", start + 5)
        sigmas = faults.decimals(lines[start + 5], 1 + len(_CAMERA), "deviations of the camera", start + 6)
        if pose is not None and values is not None and sigmas is not None:
            _, x, y, z, kappa, phi, omega = pose
            camera = cameras.setdefault((values[1:], tuple(sigma > 0 for sigma in sigmas[1:])), len(cameras))
            photos.append(ExchangedPhoto(name, camera, (omega, phi, kappa), (x, y, z), key=len(photos)))
        start += _PHOTO_LINES
    columns, rows = (int(size[2]), int(size[3])) if size is not None and len(size) > 2 else (0, 0)
    found = [
        _camera(f"camera{number}", values, is_free, (columns, rows), faults)
        for number, (values, is_free) in enumerate(cameras, start=1)
    ]
    return photos, found, start


def _camera(
    name: str, values: tuple[float, ...], is_free: tuple[bool, ...], size: tuple[int, int], faults: Faults
) -> ExchangedCamera:
    """Return a camera; what has a deviation of 0 was held."""
    value = dict(zip(_CAMERA, values, strict=True))
    width, height = value.pop("width"), value.pop("height")
    if min(width, height, value["f"]) <= 0:
        faults.complain(f"{name}: focal length and size of the sensor have to be above 0")
    value["cx"], value["cy"] = value["cx"] - width / 2.0, height / 2.0 - value["cy"]
    return ExchangedCamera(
        name, *size, "measured", value, "PhotoModeler", lens_axes=_LENS_AXES, sensor_mm=(width, height),
        free=tuple(term for term, free in zip(_CAMERA, is_free, strict=True) if free and term in value),
    )  # fmt: skip


_SECTIONS = 3
"""Control points, object points, marks."""


def _sections(lines: list[str], start: int) -> list[list[tuple[int, str]]]:
    """Return the lines of the sections: an empty line ends one, so that two of them are an empty section."""
    sections: list[list[tuple[int, str]]] = [[]]
    for number in range(start + 1, len(lines)):
        if lines[number].strip():
            sections[-1].append((number + 1, lines[number]))
        elif len(sections) == _SECTIONS:
            break
        else:
            sections.append([])
    return [*sections, [], [], []][:_SECTIONS]


def _control(line: str, number: int, faults: Faults) -> ControlPoint | None:
    words = line.split()
    values = faults.decimals(" ".join(words[1:]), 6, "control point: X Y Z and their deviations", number)
    if values is None:
        return None
    x, y, z, sx, sy, sz = values
    return ControlPoint(words[0], (x, y, z), (sx, sy, sz), line=number)


def _add_mark(
    line: str, number: int, photos: int, points: CollectedPoints, rays: CollectedRays, faults: Faults
) -> None:
    words: Sequence[str] = line.split()
    values = faults.decimals(" ".join(words[2:]), 4, "mark: photo, point, x y and their deviations", number)
    photo = faults.whole(words[0], "photo", number)
    if values is None or photo is None:
        return
    if photo >= photos:
        faults.complain(f"photo {photo}: there are {photos}, counted from 0", number)
        return
    deviation = max(values[2:])
    rays.add(photo, points.add(words[1]), values[:2], deviation if deviation > 0 else float("nan"))


PHOTOMODELER_FORMAT = Format("photomodeler", "PhotoModeler: text export", read_photomodeler, is_photomodeler)
