"""Bundler's ``bundle.out`` (v0.3) and its relative BAL, read and written: a camera for each photo, with f, k1, k2."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from orip.errors import Complaint, InputError
from orip.exchange.format import WITHOUT_GROUND, Conventions, Format, never
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, places_in_photos, tracks
from orip.exchange.sources.text import Faults, sound_rows, text_lines
from orip.files.text.lines import read_bytes
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, ImageAxes, PoseReading
from orip.wording import counted

# Camera axes are x right, y up, z backward; image coordinates count from the centre, y up. No file says the size of the
# photos. A camera of bundle.out whose f is 0 was not oriented.

BUNDLER = PoseReading("y_up", "to_camera", "matrix", "radian", "translation")
BAL = PoseReading("y_up", "to_camera", "rotation_vector", "radian", "translation")

AXES = ImageAxes("pixel", "frame_centre", "up")

_HEAD = "# Bundle file"
_NAME = re.compile(r"(.*?)(?:\s+[0-9]\s+[0-9.eE+-]+)?$", re.DOTALL)
"""Name of a photo in list.txt, which may be followed by 0 and a focal length."""

_BEGINNING = 200
_NUMBERS_OF_CAMERA, _NUMBERS_OF_POINT, _NUMBERS_OF_RAY = 9, 3, 4
_LINES_OF_CAMERA, _LINES_OF_POINT = 5, 3


def is_bundler(source: Path) -> bool:
    """Return whether a file begins as a bundle.out does."""
    return beginning(source, _BEGINNING).startswith(_HEAD)


def is_bal(source: Path) -> bool:
    """Return whether a file begins as a BAL problem does: three counts, then a measurement of camera 0."""
    lines = [line.split() for line in beginning(source, _BEGINNING).splitlines()[:2]]
    return len(lines) == 2 and len(lines[0]) == 3 and len(lines[1]) == 4 and all(map(str.isdigit, lines[0]))


def read_bal(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a BAL problem."""
    faults = Faults(shown)
    lines = text_lines(source, faults)
    head = lines[0].split() if lines else []
    counts = [faults.whole(word, "count", 1) for word in head[:3]]
    if len(counts) < 3 or None in counts:
        faults.complain("the first line should have the numbers of cameras, points and measurements", 1)
        return Parsed(None, tuple(faults.complaints))
    cameras, points, measurements = (count or 0 for count in counts)
    found = sum(1 for line in lines if line.strip())
    wanted = 1 + measurements + _NUMBERS_OF_CAMERA * cameras + _NUMBERS_OF_POINT * points
    if found != wanted:
        faults.complain(f"{found} lines, and {wanted} would follow from the counts; the file is incomplete", 1)
        return Parsed(None, tuple(faults.complaints))
    filled = [number for number, line in enumerate(lines) if line.strip()]
    numbers = _numbers(lines, filled[1 + measurements :], faults)
    rays, collected = CollectedRays(), CollectedPoints()
    places = iter(numbers[_NUMBERS_OF_CAMERA * cameras :])
    collected.add_tracks({str(n): place for n, place in enumerate(zip(places, places, places, strict=True))})
    _add_rays(lines, filled[1 : 1 + measurements], (cameras, points), rays, faults)
    cameras_found = [numbers[_NUMBERS_OF_CAMERA * n : _NUMBERS_OF_CAMERA * (n + 1)] for n in range(cameras)]
    photos = [
        ExchangedPhoto(f"photo{n}", n, tuple(values[:3]), tuple(values[3:6]), key=n)
        for n, values in enumerate(cameras_found)
    ]
    lenses = [_camera(f"camera{n}", values[6:9], 0, faults) for n, values in enumerate(cameras_found)]
    return _parsed(lenses, photos, collected, rays, BAL, (), faults)


def _numbers(lines: Sequence[str], places: Sequence[int], faults: Faults) -> list[float]:
    """Return the numbers of lines that have one each: parameters of cameras, and coordinates."""
    sound = sound_rows([lines[place] for place in places], 1)
    if sound is not None:
        return list(map(float, sound[:, 0]))
    what = "a parameter of a camera or a coordinate"
    return [(faults.decimals(lines[place], 1, what, place + 1) or (math.nan,))[0] for place in places]


def _add_rays(
    lines: Sequence[str], places: Sequence[int], counts: tuple[int, int], rays: CollectedRays, faults: Faults
) -> None:
    sound = sound_rows([lines[place] for place in places], _NUMBERS_OF_RAY, 2)
    if sound is not None and (sound[:, :2] < counts).all():
        rays.extend(sound[:, 0].astype(np.int64), sound[:, 1].astype(np.int64), sound[:, 2:])
        return
    for place in places:
        _add_ray(lines[place], place + 1, counts, rays, faults)


def _add_ray(line: str, number: int, counts: tuple[int, int], rays: CollectedRays, faults: Faults) -> None:
    words = line.split()
    if len(words) != _NUMBERS_OF_RAY:
        faults.complain(f"{len(words)} fields, and 4 should be here: camera, point, x, y", number)
        return
    camera, point = faults.whole(words[0], "camera", number), faults.whole(words[1], "point", number)
    x, y = (faults.decimal(word, "x and y", number) for word in words[2:])
    if camera is None or point is None:
        return
    if camera >= counts[0] or point >= counts[1]:
        faults.complain(f"camera {camera}, point {point}: there are {counts[0]} and {counts[1]} of them", number)
        return
    rays.add(camera, point, (x, y))


def _camera(name: str, values: Sequence[float], line: int, faults: Faults) -> ExchangedCamera:
    focal, k1, k2 = values
    if focal <= 0:
        faults.complain(f"{name}: the focal length has to be above 0", line or None)
    parameters = {"fx": focal, "fy": focal, "cx": 0.0, "cy": 0.0, "k1": k1, "k2": k2}
    return ExchangedCamera(name, 0, 0, "opencv", parameters, "Bundler", AXES, AXES, free=("fx", "fy", "k1", "k2"))


def read_bundler(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a bundle.out; names of photos are those of ``list.txt`` beside it."""
    faults = Faults(shown)
    lines = text_lines(source, faults)
    if not lines or not lines[0].startswith(_HEAD):
        faults.complain(f"the file does not begin with '{_HEAD} v0.3'; name the bundle.out", 1)
        return Parsed(None, tuple(faults.complaints))
    counts = faults.decimals(lines[1], 2, "numbers of cameras and points", 2) if len(lines) > 1 else None
    if counts is None:
        faults.complain("the second line should have the numbers of cameras and points", 2)
        return Parsed(None, tuple(faults.complaints))
    cameras, points = (int(count) for count in counts)
    wanted = 2 + _LINES_OF_CAMERA * cameras + _LINES_OF_POINT * points
    if min(cameras, points) < 0 or len(lines) < wanted:
        faults.complain(f"{len(lines)} lines, and {wanted} would follow from the counts; the file is incomplete", 2)
        return Parsed(None, tuple(faults.complaints))
    if any(line.strip() for line in lines[wanted:]):
        faults.complain(f"there are lines after the {wanted} that follow from the counts; write the file again", 2)
    names = _names(source, cameras, Faults(str(Path(shown).parent / "list.txt"), faults.complaints))
    photos: list[ExchangedPhoto] = []
    lenses: list[ExchangedCamera] = []
    place: dict[int, int] = {}
    for camera in range(cameras):
        first = 2 + _LINES_OF_CAMERA * camera
        rows = [
            faults.decimals(lines[first + n], 3, "camera", first + n + 1) or (0.0, 0.0, 0.0)
            for n in range(_LINES_OF_CAMERA)
        ]
        if rows[0][0] != 0.0:
            place[camera] = len(photos)
            rotation = tuple(value for row in rows[1:4] for value in row)
            photos.append(ExchangedPhoto(names[camera], len(lenses), rotation, rows[4], key=camera))
            lenses.append(_camera(f"camera{camera}", rows[0], first + 1, faults))
    collected, rays = CollectedPoints(), CollectedRays()
    for point in range(points):
        first = 2 + _LINES_OF_CAMERA * cameras + _LINES_OF_POINT * point
        _add_point(lines, first, point, cameras, place, collected, rays, faults)
    lost = cameras - len(photos)
    notes = (f"{counted(lost, 'photo')} not oriented, left out.",) if lost else ()
    return _parsed(lenses, photos, collected, rays, BUNDLER, notes, faults)


def _add_point(
    lines: list[str],
    first: int,
    point: int,
    cameras: int,
    place: dict[int, int],
    points: CollectedPoints,
    rays: CollectedRays,
    faults: Faults,
) -> None:
    """Add the point of three lines: coordinates, colour, and its rays."""
    coordinates = faults.decimals(lines[first], 3, "coordinates", first + 1)
    words, line = lines[first + 2].split(), first + 3
    count = faults.whole(words[0], "number of rays", line) if words else None
    if count is None or len(words) != 1 + _NUMBERS_OF_RAY * count:
        faults.complain("the line should have the number of rays, and 4 numbers for each of them", line)
        return
    number = points.add(str(point), coordinates, is_track=True)
    for ray in range(count):
        start = 1 + _NUMBERS_OF_RAY * ray
        camera = faults.whole(words[start], "camera", line)
        x, y = (faults.decimal(word, "x and y", line) for word in words[start + 2 : start + 4])
        if camera is not None and camera >= cameras:
            faults.complain(f"camera {camera}: there are {cameras} of them, counted from 0", line)
        elif camera is not None and camera in place:
            rays.add(place[camera], number, (x, y))


def _names(source: Path, count: int, faults: Faults) -> list[str]:
    path = source.parent / "list.txt"
    if not path.is_file():
        return [f"photo{n}" for n in range(count)]
    found = [_NAME.match(line.strip())[1] for line in text_lines(path, faults) if line.strip()]  # type: ignore[index]
    if len(found) != count:
        faults.complain(
            f"{counted(len(found), 'photo')}, and {source.name} has {counted(count, 'camera')}: they are not of one "
            "project; put its own list here, or remove this one"
        )
        return [f"photo{n}" for n in range(count)]
    return found


def _parsed(
    cameras: Sequence[ExchangedCamera],
    photos: Sequence[ExchangedPhoto],
    points: CollectedPoints,
    rays: CollectedRays,
    reading: PoseReading,
    notes: tuple[str, ...],
    faults: Faults,
) -> Parsed[ExchangedProject | None]:
    if not photos:
        faults.complaints.append(Complaint("no photo is oriented; there is nothing to import", faults.shown))
    if faults.complaints:
        return Parsed(None, tuple(faults.complaints))
    project = ExchangedProject("", tuple(cameras), tuple(photos), points.points(), rays.rays(), (reading,), notes=notes)
    return Parsed(project)


BUNDLER_TERMS = ("f", "cx", "cy", "k1", "k2")

_SAME = 1e-12
"""Of a number, at least of 1: it was converted there and back, and is written as it was."""


def write_bundler(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:  # noqa: ARG001  # new
    """Return bundle.out, and list.txt with the names of its photos."""
    names = "".join(f"{photo.name}\n" for photo in project.photos)
    return {"bundle.out": "".join(_bundler_lines(project)).encode(), "list.txt": names.encode()}


def _bundler_lines(project: ExchangedProject) -> Iterator[str]:
    found = [(place, rows.tolist()) for place, rows in tracks(project)]
    yield f"# Bundle file v0.3\n{len(project.photos)} {len(found)}\n"
    for photo in project.photos:
        if photo.rotation and photo.position:
            turn = photo.rotation
            yield f"{_row(_lens(project, photo))}\n{_row(turn[:3])}\n{_row(turn[3:6])}\n{_row(turn[6:])}\n"
            yield f"{_row(photo.position)}\n"
        else:
            yield "0 0 0\n" * 5
    keys = places_in_photos(project)
    for place, rows in found:
        rays = " ".join(
            f"{project.rays.photo[row]} {keys[row]} {_row(project.rays.image[row].tolist())}" for row in rows
        )
        yield f"{_row(project.points.coordinates[place].tolist())}\n255 255 255\n{len(rows)} {rays}".rstrip() + "\n"


def write_bal(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:
    """Return one file: a new problem, or the original with the parameters and coordinates of the project.

    Raises
    ------
    InputError
        If the original is damaged or gone.
    """
    text = "".join(_bal_lines(project)) if original is None else _updated_bal(project, original)
    return {"problem.txt": text.encode()}


def _bal_lines(project: ExchangedProject) -> Iterator[str]:
    photos = [n for n, photo in enumerate(project.photos) if photo.rotation and photo.position]
    number = {photo: n for n, photo in enumerate(photos)}
    found = [(place, [row for row in rows.tolist() if project.rays.photo[row] in number]) for place, rows in
             tracks(project)]  # fmt: skip
    yield f"{len(photos)} {len(found)} {sum(len(rows) for _, rows in found)}\n"
    for point, (_, rows) in enumerate(found):
        for row in rows:
            yield f"{number[int(project.rays.photo[row])]} {point} {_row(project.rays.image[row].tolist())}\n"
    for photo in photos:
        yield "".join(f"{value!r}\n" for value in _bal_camera(project, project.photos[photo]))
    for place, _ in found:
        yield "".join(f"{value!r}\n" for value in project.points.coordinates[place].tolist())


def _updated_bal(project: ExchangedProject, original: Path) -> str:
    """Return the text of an original with other cameras and points; what the project has not stays as it was."""
    parsed = read_bal(original, str(original))
    before = parsed.value
    if before is None:
        raise InputError(parsed.complaints)
    data, complaints = read_bytes(original, str(original))
    if complaints:
        raise InputError(complaints)
    lines = (data or b"").decode("utf-8").splitlines()
    filled = [n for n, line in enumerate(lines) if line.strip()][1 + len(before.rays.photo) :]
    values: dict[int, float] = {}
    photos = {photo.name: photo for photo in project.photos}
    for photo in before.photos:
        now = photos.get(photo.name)
        if now is not None and now.rotation and now.position:
            first = _NUMBERS_OF_CAMERA * photo.key
            values |= {first + n: value for n, value in enumerate(_bal_camera(project, now))}
    points = project.points.tracks
    for number, name in enumerate(before.points.names):
        if name in points:
            first = _NUMBERS_OF_CAMERA * len(before.photos) + 3 * number
            values |= {first + n: v for n, v in enumerate(project.points.coordinates[points[name]].tolist())}
    for place, value in values.items():
        old = float(lines[filled[place]])
        if abs(value - old) > _SAME * max(1.0, abs(old)):
            lines[filled[place]] = repr(value)
    return "\n".join(lines) + "\n"


def _bal_camera(project: ExchangedProject, photo: ExchangedPhoto) -> list[float]:
    return [float(value) for value in (*photo.rotation, *photo.position, *_lens(project, photo))]


def _lens(project: ExchangedProject, photo: ExchangedPhoto) -> tuple[float, ...]:
    parameters = project.cameras[photo.camera].parameters
    return tuple(float(parameters.get(name, 0.0)) for name in ("f", "k1", "k2"))


def _row(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


BUNDLER_FORMAT = Format(
    "bundler", "Bundler: bundle.out, with list.txt beside it", read_bundler, is_bundler, write_bundler,
    Conventions(
        "agisoft", BUNDLER, AXES, AXES, terms=BUNDLER_TERMS, counts_from_principal_point=True,
        is_copied=never, lacks=WITHOUT_GROUND,
    ),
)  # fmt: skip


BAL_FORMAT = Format(
    "bal", "Bundle Adjustment in the Large: problem file", read_bal, is_bal, write_bal,
    Conventions(
        "agisoft", BAL, AXES, AXES, terms=BUNDLER_TERMS, counts_from_principal_point=True,
        lacks=WITHOUT_GROUND,
    ),
    is_file=True,
)  # fmt: skip
