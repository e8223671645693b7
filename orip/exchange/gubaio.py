"""Files of the adjustment program GUBAIO: ``gubaio.img``, ``gubaio.gcp`` and ``gubaio.cam``.

Text of keywords; photos with their measurements in pixels from the outer corner, points by kind, cameras. Film (sensors
of type SCAN and FRAME) has the coordinates of its fiducial marks in the camera, and measured ones in each photo: an
affine transformation takes what was measured to millimetres from the fiducial centre. Distortion is that of measured
coordinates. Orientations are approximate, in a unit that no file says: orip finds its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct, field

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.exchange.format import Format, with_assumed_frame
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.text import Faults, numbered_words, text_lines
from orip.files.text.shown import Parsed, shown_token
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, ImageAxes, PoseReading
from orip.wording import counted

_FILES = ("gubaio.img", "gubaio.gcp", "gubaio.cam")
_AXES = ImageAxes("mm", "frame_centre", "up")
_CHECK_ERROR = -0.01
"""The files have no errors of check points; a negative one makes a point a check point."""

_NUMBERS = {
    "sensorelement": 2, "sensorpixels": 2, "cameraconstants": 3, "radialdistortion": 3, "decenteringdistortion": 2,
    "affinity": 2, "scanresolution": 1,
}  # fmt: skip


_KEYWORDS = {
    "gubaio.img": "[IMAGE] name sensor InitialPersCenter InitialRotation Points PointsEnd PointEnd ImageEnd",
    "gubaio.gcp": "FullControl FullControlEnd TiePoint TiePointEnd CheckPoint CheckPointEnd",
    "gubaio.cam": "[SENSOR] name type SensorElement SensorPixels ScanResolution CameraConstants RadialDistortion "
    "DecenteringDistortion Affinity END",
}
_PHOTO_KEYS, _PHOTO_END = ("name", "sensor"), "ImageEnd"
_FILM = ("SCAN", "FRAME")
_FEWEST_MARKS, _LARGEST_MISFIT = 3, 0.5
"""Fiducial marks of a photo, and millimetres that they may be off their places."""

_COMPARATOR_MM = 0.005
"""Of the pixels that stand for the millimetres of a comparator."""


class _Sensor(Struct):
    """A camera; of film with the places (mm) of its fiducial marks by number, and what stands for a pixel (mm)."""

    camera: ExchangedCamera
    fiducials: dict[str, tuple[float, float]]
    pixel_mm: float = 0.0


class _Measured(Struct):
    """What is measured in a photo: fiducial marks, and rows of points."""

    sensor: int
    line: int
    fiducials: dict[str, tuple[float, float]] = field(default_factory=dict)
    points: list[tuple[str, tuple[float, float]]] = field(default_factory=list)


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

    sensors = _sensors(*lines_of("gubaio.cam"))
    points, rays = CollectedPoints(), CollectedRays()
    lines, faults = lines_of("gubaio.img")
    photos, measured = _photos(lines, faults, {sensor.camera.name: n for n, sensor in enumerate(sensors)})
    misfits = _add_rays(photos, measured, sensors, points, rays, faults)
    control = _control(*lines_of("gubaio.gcp"))
    if not photos and not complaints:
        complaints.append(Complaint("the files have no photo", shown))
    if complaints:
        return Parsed(None, tuple(complaints))
    cameras, notes = _framed(sensors, photos, rays)
    if misfits:
        rms = float(np.sqrt(np.mean(np.square(misfits))))
        notes.append(f"Fiducial marks of {counted(len(misfits), 'photo')} fit by {1000.0 * rms:.1f} µm (RMS).")
    notes += ["Orientations of the files are approximate and were left out: orip computes them itself."]
    if any(point.errors[0] == _CHECK_ERROR for point in control):
        notes.append(f"Check points have no errors in the files: {-_CHECK_ERROR} is assumed.")
    return Parsed(
        ExchangedProject(
            "", tuple(cameras), tuple(photos), points.points(), rays.rays(), (PoseReading(),), tuple(control),
            ground_unit="m", notes=tuple(notes),
        )
    )  # fmt: skip


def _keyword_lines(path: Path, faults: Faults) -> Iterator[tuple[int, str, list[str]]]:
    """Iterate over the lines: number, keyword in small letters (empty for a row of values), words."""
    known = _KEYWORDS[path.name].split()
    for number, words in numbered_words(text_lines(path, faults)):
        line = " ".join(words)
        key, values = "", words
        if "=" in line:
            key, _, value = line.partition("=")
            key, values = key.strip(), value.split()
        elif len(words) == 1 and (words[0].startswith("[") or words[0][0].isalpha()):
            key, values = words[0], []
        if key and key.lower() not in [word.lower() for word in known]:
            faults.complain(
                f"'{shown_token(key)}' is no keyword of this file; its keywords are {', '.join(known)}", number
            )
        yield number, key.lower(), values


def _framed(
    sensors: Sequence[_Sensor], photos: Sequence[ExchangedPhoto], rays: CollectedRays
) -> tuple[list[ExchangedCamera], list[str]]:
    """Return the cameras, those of film with a frame, and notes on it."""
    found = rays.rays()
    of_ray = np.array([photo.camera for photo in photos], dtype=np.int64)[found.photo]
    cameras, notes = [], []
    for number, sensor in enumerate(sensors):
        camera = sensor.camera
        if sensor.fiducials:
            marks = np.array(list(sensor.fiducials.values())).reshape(-1, 2)
            camera, note = with_assumed_frame(
                camera, np.concatenate([marks, found.image[of_ray == number]]), sensor.pixel_mm
            )
            notes.append(note)
        cameras.append(camera)
    return cameras, notes


def _sensors(lines: list[tuple[int, str, list[str]]], faults: Faults) -> list[_Sensor]:
    found: list[_Sensor] = []
    texts: dict[str, str] = {}
    numbers: dict[str, tuple[float, ...]] = {}
    marks: dict[str, tuple[float, float]] = {}
    for number, key, words in lines:
        if key in ("name", "type"):
            texts[key] = " ".join(words)
        elif key in _NUMBERS:
            numbers[key] = faults.decimals(" ".join(words[: _NUMBERS[key]]), _NUMBERS[key], key, number) or ()
        elif key == "end":
            sensor = _sensor(texts, numbers, marks, number, faults)
            found += [sensor] if sensor is not None else []
            texts, numbers, marks = {}, {}, {}
        elif key == "" and len(words) == 3:
            x, y = (faults.decimal(word, "fiducial mark", number) for word in words[1:])
            marks[words[0]] = (x, y)
    return found


def _sensor(
    texts: dict[str, str],
    numbers: dict[str, tuple[float, ...]],
    marks: dict[str, tuple[float, float]],
    line: int,
    faults: Faults,
) -> _Sensor | None:
    kind = texts.get("type", "").upper()
    name = texts.get("name", "sensor")
    if kind not in ("DIGITAL", *_FILM):
        faults.complain(f"sensor {name} is of type '{kind}'; known are DIGITAL, SCAN and FRAME", line)
        return None
    needed = {"DIGITAL": ("sensorelement", "sensorpixels"), "SCAN": ("scanresolution",)}.get(kind, ())
    missing = [key for key in (*needed, "cameraconstants") if not numbers.get(key)]
    if missing:
        faults.complain(f"the sensor has no {', '.join(missing)}", line)
        return None
    if kind in _FILM and len(marks) < _FEWEST_MARKS:
        faults.complain(
            f"sensor {name} of type {kind} has {counted(len(marks), 'fiducial mark')}; {_FEWEST_MARKS} or more are "
            "needed, each as: number x y (mm)",
            line,
        )
        return None
    (height, width), (rows, columns) = (0.0, 0.0), (0.0, 0.0)
    if kind == "DIGITAL":
        (height, width), (rows, columns) = numbers["sensorelement"], numbers["sensorpixels"]
    x, y, c = numbers["cameraconstants"]
    k1, k2, k3 = numbers.get("radialdistortion") or (0.0, 0.0, 0.0)
    p1, p2 = numbers.get("decenteringdistortion") or (0.0, 0.0)
    shear, scale = numbers.get("affinity") or (0.0, 0.0)
    if scale:
        faults.complain("the second number of Affinity, a scale along y, has no counterpart; it should be 0", line)
    pixel_mm = {"SCAN": (numbers.get("scanresolution") or (0.0,))[0] / 1000.0, "FRAME": _COMPARATOR_MM}.get(kind, 0.0)
    if c <= 0 or (min(width, height, rows, columns) <= 0 if kind == "DIGITAL" else pixel_mm <= 0):
        faults.complain("sizes and the camera constant have to be above 0", line)
        return None
    # what is added to projected coordinates there is taken from measured ones here
    terms = {"k1": -k1, "k2": -k2, "k3": -k3, "p1": -p1, "p2": -p2, "b2": -shear}
    parameters = {"f": c, "cx": x, "cy": y} | {name: value + 0.0 for name, value in terms.items()}
    if kind in _FILM:
        camera = ExchangedCamera(name, 0, 0, "measured", parameters, "GUBAIO", _AXES, _AXES)
        return _Sensor(camera, marks, pixel_mm)
    size = (width, height)
    return _Sensor(
        ExchangedCamera(name, int(columns), int(rows), "measured", parameters, "GUBAIO", _AXES, sensor_mm=size), {}
    )


def _photos(
    lines: Sequence[tuple[int, str, list[str]]], faults: Faults, cameras: dict[str, int]
) -> tuple[list[ExchangedPhoto], list[_Measured]]:
    """Return the photos, and what is measured in them."""
    photos: list[ExchangedPhoto] = []
    measured: list[_Measured] = []
    known: dict[str, int] = {}
    begin = 0
    ends = [place for place, (_, key, _) in enumerate(lines) if key == _PHOTO_END.lower()]
    for end in ends if not lines or (ends and ends[-1] == len(lines) - 1) else [*ends, len(lines)]:
        rows, begin = lines[begin:end], end + 1
        given = {key: [(number, " ".join(words)) for number, of, words in rows if of == key] for key in _PHOTO_KEYS}
        wrong = [f"{len(found)} {key}" for key, found in given.items() if len(found) != 1]
        if wrong or end == len(lines):
            at = rows[-1][0] if rows else lines[end][0]
            which = "the last photo" if end == len(lines) else "a photo"
            said = f"{which} has {' and '.join([*wrong, *([f'no {_PHOTO_END}'] if end == len(lines) else [])])}"
            faults.complain(f"{said}: each has one name, one sensor, and ends with {_PHOTO_END}; complete it", at)
            continue
        ((line, name),), ((at, sensor),) = given.values()
        camera = cameras.get(sensor)
        if camera is None:
            faults.complain(f"there is no sensor '{shown_token(sensor)}' in gubaio.cam", at)
        faults.is_first(name, "photo", line, known)
        photos.append(ExchangedPhoto(name, camera or 0, key=len(photos)))
        measured.append(_measured(rows, _Measured(camera or 0, at), faults))
    return photos, measured


def _measured(rows: Sequence[tuple[int, str, list[str]]], found: _Measured, faults: Faults) -> _Measured:
    """Return what is measured in a photo: fiducial marks, and between Points and PointsEnd points."""
    is_point = False
    for number, key, words in rows:
        if key in ("points", "pointsend", "pointend"):
            is_point = key == "points"
        elif key == "" and len(words) == 3:
            x, y = (faults.decimal(word, "x and y", number) for word in words[1:])
            if is_point:
                found.points.append((words[0], (x, y)))
            else:
                found.fiducials[words[0]] = (x, y)
        elif key == "":
            faults.complain(f"{len(words)} fields, and 3 should be here: point x y", number)
    return found


def _add_rays(
    photos: Sequence[ExchangedPhoto],
    measured: Sequence[_Measured],
    sensors: Sequence[_Sensor],
    points: CollectedPoints,
    rays: CollectedRays,
    faults: Faults,
) -> list[float]:
    """Add the measurements of points, those on film in millimetres; return how well the marks of each photo fit."""
    misfits = []
    for place, (photo, found) in enumerate(zip(photos, measured, strict=True)):
        names = [name for name, _ in found.points]
        image = np.array([xy for _, xy in found.points], dtype=np.float64).reshape(-1, 2)
        if found.sensor < len(sensors) and sensors[found.sensor].fiducials:
            known = sensors[found.sensor].fiducials
            used = [name for name in found.fiducials if name in known]
            if len(used) < _FEWEST_MARKS:
                faults.complain(
                    f"photo {photo.name} has {counted(len(used), 'fiducial mark')} of its sensor before its points; "
                    f"measure {_FEWEST_MARKS} or more",
                    found.line,
                )
                continue
            image, misfit = _on_film(
                np.array([found.fiducials[name] for name in used]), np.array([known[name] for name in used]), image
            )
            misfits.append(misfit)
            if not misfit <= _LARGEST_MISFIT:
                faults.complain(
                    f"photo {photo.name}: the fiducial marks are {misfit:.3g} mm (RMS) off the places that the sensor "
                    f"gives them, {_LARGEST_MISFIT} are allowed; compare their numbers and coordinates",
                    found.line,
                )
        elif found.fiducials:
            number = min(found.fiducials, key=len)
            faults.complain(
                f"photo {photo.name}: measurements of a digital photo stand between Points and PointsEnd; point "
                f"{number} does not",
                found.line,
            )
        for name, (x, y) in zip(names, image.tolist(), strict=True):
            rays.add(place, points.add(name), (x, y))
    return misfits


def _on_film(measured: FloatArray, given: FloatArray, image: FloatArray) -> tuple[FloatArray, float]:
    """Return image coordinates by the affine transformation of measured to given marks, and its RMS residual."""
    middle = measured.mean(axis=0)

    def design(xy: FloatArray) -> FloatArray:
        return np.column_stack([xy - middle, np.ones(len(xy))])

    terms = np.linalg.lstsq(design(measured), given, rcond=None)[0]
    residuals = design(measured) @ terms - given
    return design(image) @ terms, float(np.sqrt(np.mean(np.square(residuals).sum(axis=1))))


def _control(lines: list[tuple[int, str, list[str]]], faults: Faults) -> list[ControlPoint]:
    """Return control and check points; the second line of a check point, and tie points, are approximate."""
    found: list[ControlPoint] = []
    known: dict[str, int] = {}
    section, is_second, number = "", False, 0
    for number, key, words in lines:
        if key:
            if section and key != f"{section}end":
                faults.complain_of_end(section, f"{section}end", number)
            section, is_second = "" if key.endswith("end") else key, False
            continue
        is_approximate = section == "checkpoint" and is_second
        is_second = section == "checkpoint" and not is_second
        values = faults.decimals(" ".join(words if is_approximate else words[1:]), 3, "X Y Z", number)
        if values is None or is_approximate or section not in ("fullcontrol", "checkpoint"):
            continue
        x, y, z = values
        if not faults.is_first(words[0], "point", number, known):
            continue
        errors = (None, None, None) if section == "fullcontrol" else (_CHECK_ERROR, _CHECK_ERROR, _CHECK_ERROR)
        found.append(ControlPoint(words[0], (x, y, z), errors, line=number))
    if section:
        faults.complain_of_end(section, f"{section}end", number)
    return found


GUBAIO_FORMAT = Format("gubaio", "GUBAIO: folder with gubaio.img, gubaio.gcp, gubaio.cam", read_gubaio, is_gubaio)
