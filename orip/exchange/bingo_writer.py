"""A project as BINGO's ``image.dat``, ``geoin.dat`` and ``itera.dat``; names it cannot have are in ``names.csv``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from orip.exchange.sources.short_names import distinct_names, names_file, short_names
from orip.records.exchanged import ExchangedProject
from orip.records.observations.control import ControlPoint

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
