"""A project as PAT-B's ``.ori``, ``.im`` and ``.con``; photos and points have numbers, told in ``names.csv``.

Decimals are those of the format's columns: five of a projection centre, twelve of a rotation matrix. Measurements are
micrometres from the principal point.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from orip.errors import InputError
from orip.exchange.sources.short_names import distinct_names, names_file, short_names
from orip.records.exchanged import ExchangedPhoto, ExchangedProject
from orip.records.observations.control import ControlPoint

PATB_TERMS = ("f", "cx", "cy")

_MOST_DIGITS = 9
_MICROMETRES = 1000.0


def write_patb(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:  # noqa: ARG001  # new
    """Return the files of a block, and camera.txt with its principal distance.

    Raises
    ------
    InputError
        If there are several cameras: the files have one.
    """
    if len(project.cameras) != 1:
        names = ", ".join(camera.name for camera in project.cameras)
        message = f"the files of PAT-B have one camera, and here are {len(project.cameras)} ({names}); write BINGO's"
        raise InputError.single(message)
    photos = short_names([photo.name for photo in project.photos], _is_number)
    given = distinct_names(project.points)
    marks = project.points.marks
    points = short_names(given, _is_number, first=list(marks.values()))
    control = {name: points[place] for name, place in marks.items()}
    groups = _groups(project.control)
    return {
        "camera.txt": f"c = {float(project.cameras[0].parameters['f'])!r}\n".encode(),
        "block.ori": "".join(_orientation(*item) for item in zip(photos, project.photos, strict=True)).encode(),
        "block.im": "".join(_image_lines(project, photos, points)).encode(),
        "block.con": "".join(_control_lines(project.control, control, groups)).encode(),
        "deviations.txt": "".join(
            f"group {n}: sX sY {abs(plan)!r}, sZ {abs(height)!r}\n" for (plan, height), n in groups.items()
        ).encode(),
        **names_file([("photo", photos, [photo.name for photo in project.photos]), ("point", points, given)]),
    }


def _is_number(name: str) -> bool:
    return name.isascii() and name.isdigit() and len(name) <= _MOST_DIGITS and name == str(int(name)) and name != "0"


def _orientation(name: str, photo: ExchangedPhoto) -> str:
    if not photo.rotation or not photo.position:
        return ""
    turn = [f"{value:16.12f}" for value in photo.rotation]
    centre = "".join(f"{value:16.5f}" for value in photo.position)
    return f"{name:>16}{'':16}{centre}\n{''.join(turn[:5])}\n{''.join(turn[5:])}\n"


def _image_lines(project: ExchangedProject, photos: Sequence[str], points: Sequence[str]) -> Iterator[str]:
    rays = project.rays
    for number in range(len(project.photos)):
        yield f"{photos[number]}\n"
        for row in np.flatnonzero((rays.photo == number) & rays.is_active).tolist():
            x, y = (rays.image[row] * _MICROMETRES).tolist()
            yield f"{points[rays.point[row]]:>16} {x:.6f} {y:.6f} 1\n"
        yield "-99\n"


def _groups(control: Sequence[ControlPoint]) -> dict[tuple[float, float], int]:
    """Return the numbers of groups, from 1 on, by the a-priori errors in plan and height that their points have."""
    found: dict[tuple[float, float], int] = {}
    for point in control:
        found.setdefault(_errors(point), len(found) + 1)
    return found


def _errors(point: ControlPoint) -> tuple[float, float]:
    return point.errors[0] or 0.0, point.errors[2] or 0.0


def _control_lines(
    control: Sequence[ControlPoint], names: Mapping[str, str], groups: Mapping[tuple[float, float], int]
) -> Iterator[str]:
    used = [point for point in control if point.kind == "control" and point.name in names]
    for point in used:
        x, y, _ = point.coordinates
        if x is not None and y is not None and not (point.errors[0] or 0.0) < 0.0:
            yield f"{names[point.name]:>16} {x!r} {y!r} {groups[_errors(point)]}\n"
    yield "-99\n"
    for point in used:
        z = point.coordinates[2]
        if z is not None and not (point.errors[2] or 0.0) < 0.0:
            yield f"{names[point.name]:>16} {z!r} {groups[_errors(point)]}\n"
    yield "-99\n"
