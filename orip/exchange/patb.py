"""PAT-B: ``.ori`` orientations, ``.im`` measurements, ``.con`` control points of one name, read and written."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from orip.errors import Complaint, InputError
from orip.exchange.format import OBSERVED, PIXEL_MM, Conventions, Format, never, with_assumed_frame
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.names import distinct_names, names_file, short_names, with_original_names
from orip.exchange.sources.text import Faults, numbered_words, text_lines
from orip.files.text.shown import Parsed
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, ImageAxes, PoseReading
from orip.structs import replace

# An orientation has the projection centre and a rotation matrix in fixed columns, whose sense no description says: the
# measurements decide. Image coordinates are micrometres or millimetres, y up, from the principal point. Lists end with
# -99. The camera of a project is in its ``.pro``, which is not read: ``camera.txt`` beside it has the principal
# distance, ``c = 153.24``.

READINGS = (
    PoseReading("y_up", "to_ground", "matrix", "radian", "centre"),
    PoseReading("y_up", "to_camera", "matrix", "radian", "centre"),
)

AXES = ImageAxes("mm", "frame_centre", "up")
_SUFFIXES = (".ori", ".im", ".con")
_CAMERA = "camera.txt"
_SETTING = re.compile(r"^\s*c\s*=\s*(\S+)", re.IGNORECASE)
_END = "-99"
_LISTS = 2
"""Of control: X, Y, and Z."""

_COLUMN = 16
"""Characters of a number of the matrix."""

_PRECISION_PX = 0.005 / PIXEL_MM
"""A-priori error of a measurement: 5 micrometres."""

_MICROMETRES = 1000.0
"""No image coordinate in millimetres is as large."""


def files_of(source: Path) -> dict[str, Path]:
    """Return the files of a block by suffix: those of a folder, or those of a file's name."""
    folder = source if source.is_dir() else source.parent
    stem = None if source.is_dir() else source.stem
    found = sorted(path for path in folder.glob("*") if path.suffix.lower() in _SUFFIXES)
    return {path.suffix.lower(): path for path in found if stem is None or path.stem == stem}


def is_patb(source: Path) -> bool:
    """Return whether there are orientations and measurements of a block."""
    return source.exists() and {".ori", ".im"} <= set(files_of(source))


def read_patb(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a block: a folder, or one of its files."""
    files = files_of(source)
    folder = source if source.is_dir() else source.parent
    if not {".ori", ".im"} <= set(files) or not (folder / _CAMERA).is_file():
        message = (
            f"there should be a .ori, a .im, and {_CAMERA}: write the principal distance into it, in mm, as c = 153.24"
        )
        return Parsed(None, (Complaint(message, shown),))
    complaints: list[Complaint] = []
    named = Path(shown) if source.is_dir() else Path(shown).parent

    def faults_of(path: Path) -> Faults:
        return Faults(str(named / path.name), complaints)

    camera = _camera(folder / _CAMERA, faults_of(folder / _CAMERA))
    poses = _orientations(files[".ori"], faults_of(files[".ori"]))
    points, rays = CollectedPoints(), CollectedRays()
    photos = _measurements(files[".im"], poses, points, rays, faults_of(files[".im"]))
    control = list(_control(files[".con"], faults_of(files[".con"]))) if ".con" in files else []
    if not photos and not complaints:
        complaints.append(Complaint("the .im file has no photo", shown))
    if complaints or camera is None:
        return Parsed(None, tuple(complaints))
    found = rays.rays()
    is_micrometres = bool(len(found.image)) and float(np.abs(found.image).max()) > _MICROMETRES
    if is_micrometres:
        found = replace(found, image=found.image / _MICROMETRES)
    framed, note = with_assumed_frame(camera, found.image)
    said = f"Image coordinates count as {'micrometres' if is_micrometres else 'millimetres'}."
    project = ExchangedProject(
        "", (framed,), tuple(photos), points.points(), found, READINGS, tuple(control),
        ground_unit="m", precision=_PRECISION_PX, notes=(said, note),
    )  # fmt: skip
    return Parsed(with_original_names(project, folder))


def _camera(path: Path, faults: Faults) -> ExchangedCamera | None:
    for number, line in enumerate(text_lines(path, faults), start=1):
        match = _SETTING.match(line)
        if match:
            c = faults.decimal(match[1], "c", number)
            if c > 0:
                return ExchangedCamera("camera", 0, 0, "isp", {"f": c}, "PAT-B", AXES, AXES)
            faults.complain("the principal distance has to be above 0", number)
            return None
    faults.complain("there is no line with the principal distance, such as c = 153.24", 1)
    return None


def _orientations(path: Path, faults: Faults) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return projection centre and matrix by photo: three lines of 4, 5 and 4 fields, which may touch."""
    lines = [
        (number, line)
        for number, line in enumerate(text_lines(path, faults), start=1)
        if line.strip() and not line.lstrip().startswith(("%", "#", _END))
    ]
    poses: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {}
    known: dict[str, int] = {}
    for start in range(0, len(lines) - 2, 3):
        (number, first), (_, second), (_, third) = lines[start : start + 3]
        name, *rest = first.split()
        faults.is_first(name, "photo", number, known)
        centre = faults.decimals(" ".join(rest[-3:]), 3, "X0 Y0 Z0", number)
        words = " ".join([*_numbers(second, 5), *_numbers(third, 4)])
        matrix = faults.decimals(words, 9, "a11 ... a33 in two lines", number + 1)
        if centre is not None and matrix is not None:
            poses[name] = (centre, matrix)
    if len(lines) % 3:
        faults.complain("an orientation has three lines; the last one is incomplete", lines[-1][0])
    return poses


def _numbers(line: str, count: int) -> list[str]:
    """Return the numbers of a line; where they touch, they are in fixed columns."""
    words = line.split()
    return words if len(words) == count else [line[_COLUMN * n : _COLUMN * (n + 1)].strip() for n in range(count)]


def _measurements(
    path: Path,
    poses: dict[str, tuple[tuple[float, ...], tuple[float, ...]]],
    points: CollectedPoints,
    rays: CollectedRays,
    faults: Faults,
) -> list[ExchangedPhoto]:
    photos: list[ExchangedPhoto] = []
    known: dict[str, int] = {}
    is_open, lines = False, text_lines(path, faults)
    for number, words in numbered_words(lines):
        if words[0] == _END:
            is_open = False
        elif not is_open:
            is_open = True
            faults.is_first(words[0], "photo", number, known)
            centre, matrix = poses.get(words[0], ((), ()))
            photos.append(ExchangedPhoto(words[0], 0, matrix, centre, key=len(photos)))
        elif len(words) < 3:
            faults.complain("the line should be: point x y [group]; a photo ends with -99", number)
        else:
            x, y = (faults.decimal(word, "x and y", number) for word in words[1:3])
            rays.add(len(photos) - 1, points.add(words[0]), (x, y))
    if is_open:
        faults.complain_of_end(f"photo {photos[-1].name}", _END, len(lines))
    return photos


def _control(path: Path, faults: Faults) -> Iterator[ControlPoint]:
    """Return the points of the list of X, Y and of the list of Z, in this order; a full point is in both."""
    plan: dict[str, tuple[float, float, int]] = {}
    heights: dict[str, tuple[float, int]] = {}
    ended, lines = 0, text_lines(path, faults)
    for number, words in numbered_words(lines):
        is_plan = ended == 0
        if words[0] == _END:
            ended += 1
        elif ended >= _LISTS:
            faults.complain(f"the lists of X, Y and of Z end with {_END}, and here is more; remove it", number)
            break
        elif words[0] in (plan if is_plan else heights):
            faults.complain(f"point {words[0]} is here again; remove or rename one of the two", number)
        elif len(words) < (3 if is_plan else 2):
            faults.complain(f"the line should be: point {'X Y' if is_plan else 'Z'} [group]", number)
        elif is_plan:
            x, y = (faults.decimal(word, "X and Y", number) for word in words[1:3])
            plan[words[0]] = (x, y, number)
        else:
            heights[words[0]] = (faults.decimal(words[1], "Z", number), number)
    if ended < _LISTS:
        faults.complain_of_end(f"the list of {'Z' if ended else 'X, Y'}", _END, len(lines))
    for name in {**plan, **heights}:
        place, height = plan.get(name), heights.get(name)
        line = place[2] if place is not None else height[1] if height is not None else 0
        plane = (None, None) if place is None else (place[0], place[1])
        z = None if height is None else height[0]
        yield ControlPoint(name, (*plane, z), (None, None, None), line=line)


# Decimals are those of the format's columns: five of a projection centre, twelve of a rotation matrix. Measurements are
# micrometres from the principal point.

PATB_TERMS = ("f", "cx", "cy")

_MOST_DIGITS = 9


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


PATB_FORMAT = Format(
    "patb", "PAT-B: folder with .ori, .im, .con, and camera.txt", read_patb, is_patb, write_patb,
    Conventions(
        "isp", READINGS[0], AXES, AXES, is_cartesian=False, terms=PATB_TERMS, is_copied=never,
        counts_from_principal_point=True, lacks=("check points", *OBSERVED),
    ),
)  # fmt: skip
