"""VisualSFM's ``.nvm`` (NVM_V3), read and written: a camera for each photo, with f and one coefficient."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from orip.errors import Complaint, InputError
from orip.exchange.format import WITHOUT_GROUND, Conventions, Format, never
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, places_in_photos, tracks
from orip.exchange.sources.text import Faults, quoted_words, text_lines
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed
from orip.records.exchanged import (
    PIXELS,
    ExchangedCamera,
    ExchangedPhoto,
    ExchangedProject,
    ExchangedRays,
    ImageAxes,
    PoseReading,
)

# A photo has a quaternion from ground to camera, y down, z forward, and its projection centre. Image coordinates count
# from the centre; some programs write columns and rows, which is seen by all of them being positive.

READING = PoseReading("y_down", "to_camera", "quaternion", "radian", "centre")

_HEAD, _FIXED = "NVM_V3", "FixedK"
CENTRE = ImageAxes("pixel", "frame_centre", "down")
_FIELDS_OF_CAMERA, _FIELDS_OF_RAY, _FIXED_OF_POINT = 11, 4, 7
_SHORTEST = 1.0
"""Pixels of a focal length; coefficients of the distortion are divided by its powers."""


def is_nvm(source: Path) -> bool:
    """Return whether a file begins as an .nvm does."""
    return beginning(source, len(_HEAD)) == _HEAD


class _Lines:
    """The lines of the file that have text, one after the other."""

    def __init__(self, lines: list[str], faults: Faults) -> None:
        self._filled = [(number, line) for number, line in enumerate(lines, start=1) if line.strip()]
        self._next = 0
        self.faults = faults

    def count(self, what: str) -> int:
        """Return a count, which is not more than the lines that follow; 0, and a complaint kept, if it is."""
        number, line = self.take() or (0, "0")
        found = self.faults.whole(line, what, number or None) or 0
        if found > len(self._filled) - self._next:
            self.faults.complain(f"{found} {what}, and {len(self._filled) - self._next} lines follow", number)
            return 0
        return found

    def take(self) -> tuple[int, str] | None:
        """Return the next line and its number; None at the end."""
        if self._next >= len(self._filled):
            return None
        self._next += 1
        return self._filled[self._next - 1]


def read_nvm(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read an .nvm; of several models the first."""
    faults = Faults(shown)
    lines = _Lines(text_lines(source, faults), faults)
    head = lines.take()
    if head is None or not head[1].startswith(_HEAD):
        faults.complain(f"the file does not begin with {_HEAD}; name the .nvm", 1)
        return Parsed(None, tuple(faults.complaints))
    free = () if _FIXED in head[1].split() else ("f", "k1")
    values = [_camera_values(lines, faults) for _ in range(lines.count("photos"))]
    points, rays = CollectedPoints(), CollectedRays()
    for number in range(lines.count("points")):
        _add_point(lines, number, len(values), points, rays)
    found = rays.rays()
    axes = PIXELS if _is_from_corner(found) else CENTRE
    photos, cameras = [], []
    for number, (name, numbers) in enumerate(item for item in values if item is not None):
        focal, *pose, k, _ = numbers
        parameters = {"f": focal, "cx": 0.0, "cy": 0.0, "k1": k / focal**2}
        cameras.append(
            ExchangedCamera(f"camera{number}", 0, 0, "measured", parameters, "VisualSFM", CENTRE, axes, free=free)
        )
        photos.append(ExchangedPhoto(name, number, tuple(pose[:4]), tuple(pose[4:7]), key=number))
    if not photos and not faults.complaints:
        faults.complaints.append(Complaint("the first model has no photo", shown))
    if faults.complaints:
        return Parsed(None, tuple(faults.complaints))
    return Parsed(ExchangedProject("", tuple(cameras), tuple(photos), points.points(), found, (READING,)))


def _camera_values(lines: _Lines, faults: Faults) -> tuple[str, list[float]] | None:
    taken = lines.take()
    if taken is None:
        return None
    number, line = taken
    words = quoted_words(line)
    if len(words) != _FIELDS_OF_CAMERA:
        faults.complain(f"{len(words)} fields, and 11 should be here: name f qw qx qy qz X Y Z k 0", number)
        return None
    values = [faults.decimal(word, "camera", number) for word in words[1:]]
    if not values[0] >= _SHORTEST:
        faults.complain(f"a focal length of {values[0]:g} pixels cannot be; it has to be 1 pixel or more", number)
        return None
    return words[0], values


def _add_point(lines: _Lines, point: int, photos: int, points: CollectedPoints, rays: CollectedRays) -> None:
    taken = lines.take()
    if taken is None:
        return
    number, line = taken
    words, faults = line.split(), lines.faults
    count = faults.whole(words[6], "number of rays", number) if len(words) >= _FIXED_OF_POINT else None
    if count is None or len(words) != _FIXED_OF_POINT + _FIELDS_OF_RAY * count:
        faults.complain("the line should be: X Y Z R G B n, and n times: photo feature x y", number)
        return
    place = points.add(str(point), [faults.decimal(word, "coordinates", number) for word in words[:3]], is_track=True)
    for ray in range(count):
        start = _FIXED_OF_POINT + _FIELDS_OF_RAY * ray
        photo = faults.whole(words[start], "photo", number)
        x, y = (faults.decimal(word, "x and y", number) for word in words[start + 2 : start + 4])
        if photo is not None and photo >= photos:
            faults.complain(f"photo {photo}: there are {photos}, counted from 0", number)
        elif photo is not None:
            rays.add(photo, place, (x, y))


def _is_from_corner(rays: ExchangedRays) -> bool:
    return len(rays.image) > 0 and bool(np.all(rays.image >= 0.0))


NVM_TERMS = ("f", "cx", "cy", "k1")


def write_nvm(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:  # noqa: ARG001  # new
    """Return one file.

    Raises
    ------
    InputError
        If the name of a photo has a quotation mark, which the format uses itself.
    """
    quoted = [photo.name for photo in project.photos if '"' in photo.name]
    if quoted:
        message = f"photo {quoted[0]}: NVM has quotation marks round names, so that none can be in them; rename it"
        raise InputError.single(message)
    return {"orip.nvm": "".join(_lines(project)).encode()}


def _lines(project: ExchangedProject) -> Iterator[str]:
    photos = [n for n, photo in enumerate(project.photos) if photo.rotation and photo.position]
    number = np.full(len(project.photos), -1)
    number[photos] = np.arange(len(photos))
    yield f"NVM_V3\n\n{len(photos)}\n"
    for photo in (project.photos[n] for n in photos):
        parameters = project.cameras[photo.camera].parameters
        focal = float(parameters["f"])
        name = f'"{photo.name}"' if photo.name.split() != [photo.name] else photo.name
        yield f"{name} {_row([focal, *photo.rotation, *photo.position, parameters.get('k1', 0.0) * focal**2])} 0\n"
    found = list(tracks(project))
    keys = places_in_photos(project)
    yield f"\n{len(found)}\n"
    for place, rows in found:
        seen = rows[number[project.rays.photo[rows]] >= 0].tolist()
        rays = "".join(
            f" {number[project.rays.photo[row]]} {keys[row]} {_row(project.rays.image[row].tolist())}" for row in seen
        )
        yield f"{_row(project.points.coordinates[place].tolist())} 255 255 255 {len(seen)}{rays}\n"
    yield "\n0\n"


def _row(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


NVM_FORMAT = Format(
    "nvm", "VisualSFM: .nvm", read_nvm, is_nvm, write_nvm,
    Conventions(
        "measured", READING, CENTRE, CENTRE, terms=NVM_TERMS, counts_from_principal_point=True,
        is_copied=never, lacks=WITHOUT_GROUND,
    ),
    is_file=True,
)  # fmt: skip
