"""A project as Bundler's ``bundle.out`` with its ``list.txt``, and as a problem of BAL: f, k1, k2 for each photo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from orip.errors import InputError
from orip.exchange.sources.tracks import places_in_photos, tracks
from orip.exchange.vision.bundler import read_bal
from orip.files.text.lines import read_bytes
from orip.records.exchanged import ExchangedPhoto, ExchangedProject

BUNDLER_TERMS = ("f", "cx", "cy", "k1", "k2")

_NUMBERS_OF_CAMERA = 9
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
