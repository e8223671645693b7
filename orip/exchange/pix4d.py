"""Pix4D's folder ``1_initial/params``: photos with cameras, poses and the coordinates' offset.

``*_calibrated_camera_parameters.txt``, with the project's name in front or without, has for each photo its camera
matrix, radial and tangential distortion (OpenCV's order), position without the offset, and rotation from ground to
camera, y down. It has no measurements.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from orip.errors import Complaint
from orip.exchange.format import Format
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.text import Faults, text_lines
from orip.files.text.shown import Parsed
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, PoseReading
from orip.structs import replace

READING = PoseReading("y_down", "to_camera", "matrix", "radian", "centre")

_CAMERAS = "calibrated_camera_parameters.txt"
_POSITIONS, _OFFSET, _CRS = "calibrated_images_position.txt", "offset.xyz", "wkt.prj"
"""Names behind the project's name and ``_``, or without them."""

_SAME_OFFSET = 0.01
"""Metres by which the differences of positions to their offset vary at most: they are rounded."""

_HEAD = "camera model m = K [R|-Rt] X"
_LINES_OF_PHOTO = 10
_COUNTS = (3, 3, 3, 3, 2, 3, 3, 3, 3)


def cameras_file(source: Path) -> Path | None:
    """Return the file of camera parameters: the source itself, or the one in a folder or its params; else None."""
    if source.is_file():
        return source if source.name.endswith(_CAMERAS) else None
    folders = (source, source / "params", source / "1_initial" / "params")
    return next((path for folder in folders for path in sorted(folder.glob(f"*{_CAMERAS}"))), None)


def is_pix4d(source: Path) -> bool:
    """Return whether a folder or file is, or has, Pix4D's camera parameters."""
    return cameras_file(source) is not None


def read_pix4d(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read the parameters of calibrated cameras, with the offset and the coordinate system beside them."""
    path = cameras_file(source)
    if path is None:
        message = f"there is no file *{_CAMERAS} here; name the folder 1_initial/params of the project"
        return Parsed(None, (Complaint(message, shown),))
    complaints: list[Complaint] = []
    folder = Path(shown) if source.is_dir() else Path(shown).parent

    def faults_of(file: Path) -> Faults:
        inside = file.relative_to(source) if source.is_dir() else Path(file.name)
        return Faults(str(folder / inside), complaints)

    prefix = path.name.removesuffix(_CAMERAS)
    lines = text_lines(path, faults_of(path))
    head = next((n for n, line in enumerate(lines) if line.strip() == _HEAD), None)
    if head is None:
        faults_of(path).complain(f"the head does not end with '{_HEAD}'; export the parameters again", 1)
        return Parsed(None, tuple(complaints))
    photos, cameras = _photos(lines, head + 1, faults_of(path))
    offset, said = _offset(path, prefix, photos, faults_of)
    photos = [replace(photo, position=_moved(photo.position, offset)) for photo in photos]
    if not photos and not complaints:
        complaints.append(Complaint("the file has no photo", shown))
    prj = path.with_name(f"{prefix}{_CRS}")
    crs = "\n".join(text_lines(prj, faults_of(prj))).strip() if prj.is_file() else ""
    if complaints:
        return Parsed(None, tuple(complaints))
    notes = ("The folder has no measurements: only cameras and orientations are imported.", *said)
    return Parsed(
        ExchangedProject(
            prefix.rstrip("_-"), tuple(cameras), tuple(photos), CollectedPoints().points(), CollectedRays().rays(),
            (READING,), crs=crs or None, ground_unit="m", notes=notes,
        )
    )  # fmt: skip


def _offset(
    path: Path, prefix: str, photos: list[ExchangedPhoto], faults_of: Callable[[Path], Faults]
) -> tuple[tuple[float, ...], list[str]]:
    """Return what positions are short of, and a note where it is not that of a file of its own."""
    own = path.with_name(f"{prefix}{_OFFSET}")
    if own.is_file():
        faults = faults_of(own)
        return faults.decimals(" ".join(text_lines(own, faults)), 3, "offset", 1) or _NOTHING, []
    table = path.with_name(f"{prefix}{_POSITIONS}")
    places = _places(table, faults_of(table)) if table.is_file() else {}
    shifts = np.array(
        [np.subtract(places[photo.name], photo.position) for photo in photos if photo.name in places]
    ).reshape(-1, 3)
    if not len(shifts):
        said = f"There is no {own.name}, and no positions in {table.name}: coordinates are local, as Pix4D wrote them."
        return _NOTHING, [said]
    shift = np.median(shifts, axis=0)
    if np.abs(shifts - shift).max() > _SAME_OFFSET:
        said = (
            f"The positions in {table.name} are not those of the cameras: coordinates are local, as Pix4D wrote them."
        )
        return _NOTHING, [said]
    shown = ", ".join(f"{value:.3f}" for value in shift.tolist())
    return tuple(np.round(shift, 3).tolist()), [
        f"There is no {own.name}: the offset of the coordinates ({shown}) is that of the positions in {table.name}."
    ]


_NOTHING = (0.0, 0.0, 0.0)


def _moved(position: tuple[float, ...], offset: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(value + shift for value, shift in zip(position, offset, strict=True))


def _places(path: Path, faults: Faults) -> dict[str, tuple[float, ...]]:
    """Return positions by photo of a table ``photo,X,Y,Z``."""
    found = {}
    for number, line in enumerate(text_lines(path, faults), start=1):
        words = line.rsplit(",", 3)
        if len(words) == 4:
            values = faults.decimals(" ".join(words[1:]), 3, "position", number)
            if values is not None:
                found[words[0].strip()] = values
    return found


def _photos(lines: list[str], first: int, faults: Faults) -> tuple[list[ExchangedPhoto], list[ExchangedCamera]]:
    """Return photos and their different cameras."""
    filled = [(number, line) for number, line in enumerate(lines, start=1) if number > first and line.strip()]
    photos: list[ExchangedPhoto] = []
    cameras: dict[tuple[int | float, ...], int] = {}
    for start in range(0, len(filled), _LINES_OF_PHOTO):
        part = filled[start : start + _LINES_OF_PHOTO]
        if len(part) < _LINES_OF_PHOTO:
            faults.complain("the last photo is incomplete: a photo has ten lines", part[0][0])
            break
        number, head = part[0]
        words = head.rsplit(maxsplit=2)
        size = [faults.whole(word, "columns and rows", number, 1) for word in words[1:]]
        rows = [faults.decimals(line, count, "camera", at) for (at, line), count in zip(part[1:], _COUNTS, strict=True)]
        if len(size) < 2 or None in size or None in rows:
            if len(size) < 2:
                faults.complain("the line should be: name of the photo, columns, rows", number)
            continue
        k, radial, tangential, position = rows[0:3], rows[3] or (), rows[4] or (), rows[5] or ()
        plane = ((k[0] or ())[0], (k[1] or ())[1], (k[0] or ())[2], (k[1] or ())[2])
        camera = cameras.setdefault((size[0] or 0, size[1] or 0, *plane, *radial, *tangential), len(cameras))
        rotation = tuple(value for row in rows[6:9] for value in row or ())
        photos.append(ExchangedPhoto(words[0], camera, rotation, tuple(position), key=len(photos)))
    return photos, [_camera(number, values) for number, values in enumerate(cameras, start=1)]


def _camera(number: int, values: tuple[int | float, ...]) -> ExchangedCamera:
    columns, rows, *numbers = values
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
    return ExchangedCamera(
        f"camera{number}",
        int(columns),
        int(rows),
        "opencv",
        dict(zip(names, numbers, strict=True)),
        "Pix4D",
        free=names,
    )


PIX4D_FORMAT = Format("pix4d", "Pix4D: folder 1_initial/params (orientations only)", read_pix4d, is_pix4d)
