"""Files of the adjustment program GUBAIO: ``gubaio.img``, ``gubaio.gcp`` and ``gubaio.cam``.

Text of keywords; photos with their measurements in pixels from the outer corner, points by kind, digital cameras.
Distortion is that of measured coordinates. Orientations are approximate, in a unit that no file says: orip finds its
own.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from orip.errors import Complaint
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.faults import Faults
from orip.exchange.sources.text import numbered_words, text_lines
from orip.files.text.parsed import Parsed
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, ImageAxes, PoseReading
from orip.records.observations.control import ControlPoint

_FILES = ("gubaio.img", "gubaio.gcp", "gubaio.cam")
_AXES = ImageAxes("mm", "frame_centre", "up")
_CHECK_ERROR = -0.01
"""The files have no errors of check points; a negative one makes a point a check point."""

_NUMBERS = {
    "sensorelement": 2, "sensorpixels": 2, "cameraconstants": 3, "radialdistortion": 3, "decenteringdistortion": 2,
    "affinity": 2,
}  # fmt: skip


def is_gubaio(source: Path) -> bool:
    """Return whether a folder has the three files."""
    return source.is_dir() and all((source / name).is_file() for name in _FILES)


def read_gubaio(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a folder with the three files."""
    if not is_gubaio(source):
        return Parsed(None, (Complaint(f"the folder should have {', '.join(_FILES)}", shown),))
    complaints: list[Complaint] = []

    def lines_of(name: str) -> tuple[list[tuple[int, str, list[str]]], Faults]:
        faults = Faults(f"{shown}/{name}", complaints)
        return list(_keyword_lines(source / name, faults)), faults

    cameras = _cameras(*lines_of("gubaio.cam"))
    points, rays = CollectedPoints(), CollectedRays()
    photos = _photos(*lines_of("gubaio.img"), {camera.name: n for n, camera in enumerate(cameras)}, points, rays)
    control = _control(*lines_of("gubaio.gcp"))
    if not photos and not complaints:
        complaints.append(Complaint("the files have no photo", shown))
    if complaints:
        return Parsed(None, tuple(complaints))
    notes = ["Orientations of the files are approximate and were left out: orip computes them itself."]
    if any(point.kind == "check" for point in control):
        notes.append(f"Check points have no errors in the files: {-_CHECK_ERROR} is assumed.")
    return Parsed(
        ExchangedProject(
            "", tuple(cameras), tuple(photos), points.points(), rays.rays(), (PoseReading(),), tuple(control),
            ground_unit="m", notes=tuple(notes),
        )
    )  # fmt: skip


def _keyword_lines(path: Path, faults: Faults) -> Iterator[tuple[int, str, list[str]]]:
    """Iterate over the lines: number, keyword in small letters (empty for a row of values), words."""
    for number, words in numbered_words(text_lines(path, faults)):
        line = " ".join(words)
        if "=" in line:
            key, _, value = line.partition("=")
            yield number, key.strip().lower(), value.split()
        elif len(words) == 1 and (words[0].startswith("[") or words[0][0].isalpha()):
            yield number, words[0].lower(), []
        else:
            yield number, "", words


def _cameras(lines: list[tuple[int, str, list[str]]], faults: Faults) -> list[ExchangedCamera]:
    found: list[ExchangedCamera] = []
    texts: dict[str, str] = {}
    numbers: dict[str, tuple[float, ...]] = {}
    for number, key, words in lines:
        if key in ("name", "type"):
            texts[key] = " ".join(words)
        elif key in _NUMBERS:
            numbers[key] = faults.decimals(" ".join(words[: _NUMBERS[key]]), _NUMBERS[key], key, number) or ()
        elif key == "end":
            camera = _camera(texts, numbers, number, faults)
            found += [camera] if camera is not None else []
            texts, numbers = {}, {}
    return found


def _camera(
    texts: dict[str, str], numbers: dict[str, tuple[float, ...]], line: int, faults: Faults
) -> ExchangedCamera | None:
    if texts.get("type", "").upper() != "DIGITAL":
        faults.complain("only sensors of type DIGITAL are read; those of film need the fiducial marks of photos", line)
        return None
    missing = [key for key in ("sensorelement", "sensorpixels", "cameraconstants") if not numbers.get(key)]
    if missing:
        faults.complain(f"the sensor has no {', '.join(missing)}", line)
        return None
    (height, width), (rows, columns) = numbers["sensorelement"], numbers["sensorpixels"]
    x, y, c = numbers["cameraconstants"]
    k1, k2, k3 = numbers.get("radialdistortion") or (0.0, 0.0, 0.0)
    p1, p2 = numbers.get("decenteringdistortion") or (0.0, 0.0)
    shear, scale = numbers.get("affinity") or (0.0, 0.0)
    if scale:
        faults.complain("the second number of Affinity, a scale along y, has no counterpart; it should be 0", line)
    if min(width, height, rows, columns, c) <= 0:
        faults.complain("sizes and the camera constant have to be above 0", line)
        return None
    # what is added to projected coordinates there is taken from measured ones here
    terms = {"k1": -k1, "k2": -k2, "k3": -k3, "p1": -p1, "p2": -p2, "b2": -shear}
    parameters = {"f": c, "cx": x, "cy": y} | {name: value + 0.0 for name, value in terms.items()}
    name = texts.get("name", "sensor")
    return ExchangedCamera(
        name, int(columns), int(rows), "measured", parameters, "GUBAIO", _AXES, sensor_mm=(width, height)
    )


def _photos(
    lines: list[tuple[int, str, list[str]]],
    faults: Faults,
    cameras: dict[str, int],
    points: CollectedPoints,
    rays: CollectedRays,
) -> list[ExchangedPhoto]:
    photos: list[ExchangedPhoto] = []
    name = ""
    for number, key, words in lines:
        if key == "name":
            name = " ".join(words)
        elif key == "sensor":
            camera = cameras.get(" ".join(words))
            if camera is None:
                faults.complain(f"there is no sensor '{' '.join(words)}' in gubaio.cam", number)
            photos.append(ExchangedPhoto(name, camera or 0, key=len(photos)))
        elif key == "" and len(words) == 3:
            x, y = (faults.decimal(word, "x and y", number) for word in words[1:])
            if photos:
                rays.add(len(photos) - 1, points.add(words[0]), (x, y))
        elif key == "":
            faults.complain(f"{len(words)} fields, and 3 should be here: point x y", number)
    return photos


def _control(lines: list[tuple[int, str, list[str]]], faults: Faults) -> list[ControlPoint]:
    """Return control and check points; the second line of a check point, and tie points, are approximate."""
    found: list[ControlPoint] = []
    section, is_second = "", False
    for number, key, words in lines:
        if key:
            section, is_second = key, False
            continue
        is_approximate = section == "checkpoint" and is_second
        is_second = section == "checkpoint" and not is_second
        values = faults.decimals(" ".join(words if is_approximate else words[1:4]), 3, "X Y Z", number)
        if values is None or is_approximate or section not in ("fullcontrol", "checkpoint"):
            continue
        x, y, z = values
        errors = (None, None, None) if section == "fullcontrol" else (_CHECK_ERROR, _CHECK_ERROR, _CHECK_ERROR)
        found.append(ControlPoint(words[0], (x, y, z), errors, line=number))
    return found
