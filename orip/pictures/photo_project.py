"""`orip photos`: the texts of a project from a folder of photographs, with comments for who edits them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, InputError
from orip.files.control.stations_text import stations_text
from orip.files.control.text import elements_text, parse_points
from orip.files.image_cameras import ImageCamera, station_of, utm_zone
from orip.files.project.file_names import fit_file_name
from orip.files.project.toml_text import toml_table, toml_value
from orip.files.text.decimal_numbers import is_number
from orip.files.text.lines import read_lines
from orip.files.text.shown import Parsed
from orip.geometry.ground_crs import geodetic_of
from orip.pictures.folder_survey import Survey, SurveyedPhoto, sessions_of, survey_folder
from orip.records.control import ControlElement
from orip.records.names import name_fault, record_key
from orip.structs import replace
from orip.wording import counted
from orip.workflow.sample_projects import write_project_texts

_UNKNOWN_WIDTH_MM = 36.0
_ELEMENTS_HEAD = "! From EXIF, and what is usual of lenses: put a calibration certificate in its place.\n"
_NO_CRS = """\
# The coordinate reference system of all coordinates; without one they are plane coordinates with heights.
# crs = "EPSG:25832"
"""
_CONTROL_ENDINGS = (".csv", ".txt")

_OF_FOCAL_LENGTH, _UNKNOWN_FOCAL_LENGTH = 0.03, 0.3
"""Standard deviation over the focal length: cameras round it to whole millimetres, and focus changes it; and of one
that no tag says."""
_OF_PRINCIPAL_POINT = 0.015
"""Standard deviation over the width of the sensor."""
_OF_DISTORTION = 0.2
"""Standard deviation of OpenCV's k1 and k2."""


class CameraMade(Struct, frozen=True):
    """A camera record: its name, what it is of, and its photos."""

    name: str
    camera: ImageCamera
    photos: tuple[str, ...]


class PhotoProject(Struct, frozen=True):
    """A project that was made of photographs."""

    name: str
    folder: Path
    files: tuple[str, ...]
    cameras: tuple[CameraMade, ...]
    survey: Survey
    stations: int
    control: int


class PhotoSettings(Struct, frozen=True):
    """How a project is made.

    Parameters
    ----------
    sensor_width : float or None
        mm, of the longer side; None: from EXIF or the table of known sensors.
    control : Path or None
        Control points: a .PNT file, or a table of name X Y Z.
    control_error : float
        A-priori error of points of a table without errors, ground units.
    crs : str or None
        None: the zone of UTM where photos have positions and no control is given.
    """

    sensor_width: float | None = None
    control: Path | None = None
    control_error: float = 0.02
    crs: str | None = None


def make_photo_project(source: Path, folder: Path, settings: PhotoSettings) -> PhotoProject:
    """Write a project of the photographs of a folder into another folder, which has no project yet.

    Raises
    ------
    InputError
        If no image can be used, or the control file is wrong.
    UsageError
        If there is a project already.
    """
    if settings.crs is not None:
        geodetic_of(settings.crs)  # raises where it is not known, or no projected system
    name = fit_file_name(folder.resolve().name)
    control = None if settings.control is None else control_text(settings.control, settings.control_error)
    survey = survey_folder(source, settings.sensor_width)
    names = _names(survey.photos)
    cameras = _cameras(survey.photos, names)
    stations, crs = _stations(survey.photos, names, settings)
    if not stations and settings.control is not None:
        survey = replace(survey, notes=(*survey.notes, *_positions_left_out(survey.photos)))
    is_free = control is None and not stations
    texts = {"orip.toml": _project_text(name, folder, survey, names, cameras, crs, is_free=is_free)}
    texts[f"{name}.ELE"] = _ELEMENTS_HEAD + elements_text([one for made in cameras for one in _known_roughly(made)])
    if control is not None:
        texts[f"{name}.PNT"] = control
    if stations:
        texts[f"{name}.STA"] = stations
    write_project_texts(folder, texts, f"orip photos {source} DIR")
    count = sum(not line.startswith(("!", "CRS", "ANGLES")) for line in stations.splitlines())
    points = sum(1 for line in (control or "").splitlines() if line and not line.startswith("!"))
    return PhotoProject(name, folder, tuple(texts), cameras, survey, count, points)


_SEPARATORS = re.compile(r"[;,\t ]+")
_NORTHS = frozenset({"y", "n", "north", "northing", "lat", "latitude", "hochwert"})


def _north_first(lines: Sequence[str]) -> Iterator[str]:
    """Yield what is wrong with a heading that names the north before the east."""
    words = [_SEPARATORS.split(line.strip(" \t!#").lower()) for line in lines]
    if any(len(row) > 1 and row[1].strip("\"'") in _NORTHS for row in words):
        yield "the heading has north before east; a line has name X Y Z, X to the east: exchange the two columns"


def control_text(path: Path, error: float) -> str:
    """Return the text of a .PNT file from one, or from a table of name X Y Z with or without three errors.

    Raises
    ------
    InputError
        With all lines that are wrong.
    """
    shown = path.name
    lines = read_lines(path, shown)
    if lines.complaints:
        raise InputError(lines.complaints)
    kept = lines.value
    if path.suffix.lower() in _CONTROL_ENDINGS:
        kept = [f"! control points of {shown}"]
        complaints = [Complaint(text, shown, 1) for text in _north_first(lines.value[:1])]
        for number, line in enumerate(lines.value, 1):
            fields = [field for field in _SEPARATORS.split(line.strip()) if field]
            if not fields or fields[0].startswith(("!", "#")) or (number == 1 and not is_number(fields[-1])):
                continue
            if len(fields) not in {4, 7} or not all(map(is_number, fields[1:])):
                message = "a line has name X Y Z, or name X Y Z aX aY aZ, with decimal points"
                complaints.append(Complaint(f"{message}; found {len(fields)} fields", shown, number))
            kept.append(" ".join(fields if len(fields) == 7 else [*fields, *[f"{error:g}"] * 3]))
        if complaints:
            raise InputError(complaints)
    parsed = parse_points(Parsed(kept), shown)
    if parsed.complaints:
        raise InputError(parsed.complaints)
    if not parsed.value:
        message = "there is no control point in this file; a line has name X Y Z"
        raise InputError.single(message, shown)
    return "\n".join(kept) + "\n"


def _names(photos: Sequence[SurveyedPhoto]) -> dict[Path, str]:
    """Return a record name for each photo: that of its file, made fit and unlike the others."""
    names: dict[Path, str] = {}
    taken: set[str] = set()
    for photo in photos:
        fit = "_".join(photo.path.stem.split())
        stem = fit if name_fault(fit) is None else f"P_{len(names) + 1}"
        name, number = stem, 1
        while record_key(name) in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(record_key(name))
        names[photo.path] = name
    return names


def _cameras(photos: Sequence[SurveyedPhoto], names: Mapping[Path, str]) -> tuple[CameraMade, ...]:
    found: dict[ImageCamera, list[str]] = {}
    for photo in photos:
        found.setdefault(photo.camera, []).append(names[photo.path])
    made: list[CameraMade] = []
    for camera, of_camera in found.items():
        stem = re.sub(r"\W+", "_", camera.model or camera.lens or "CAMERA").strip("_").upper()[:24] or "CAMERA"
        twins = sum(other.name == stem or other.name.startswith(f"{stem}_CAM") for other in made)
        made.append(CameraMade(f"{stem}_CAM{twins + 1}" if twins else stem, camera, tuple(of_camera)))
    return tuple(made)


def _stations(
    photos: Sequence[SurveyedPhoto], names: Mapping[Path, str], settings: PhotoSettings
) -> tuple[str, str | None]:
    """Return the .STA text, empty without positions, and the crs of the project."""
    sessions = sessions_of(photos)
    found = [
        replace(station, strip=f"S{sessions[photo.path]}" if sessions.get(photo.path) else "")
        for photo in photos
        for station in station_of(names[photo.path], photo.exposure)
    ]
    crs = settings.crs
    if found and crs is None and settings.control is None:
        crs = utm_zone(np.array([station.position for station in found]))
    if not found or crs is None:
        return "", crs
    heading = (
        "! Positions and gimbal angles of the image files, as approximations: longitude, latitude, height.\n"
        "! Errors of receivers are those within one solution: 2 to 3 cm is rarely too pessimistic.\n"
        "CRS EPSG:4979\nANGLES ROLL PITCH HEADING\n"
    )
    return heading + stations_text(found, is_geographic=True), crs


def _positions_left_out(photos: Sequence[SurveyedPhoto]) -> Iterator[str]:
    """Say that positions cannot be used beside control points of a system that is not named."""
    count = sum(bool(station_of("a", photo.exposure)) for photo in photos)
    if count:
        yield (
            f"{counted(count, 'photo')} with a position in the image: left out, as the system of the control points is "
            "not named; --crs EPSG:25832, or whatever it is, uses them"
        )


def camera_words(camera: ImageCamera) -> str:
    """Say what a camera is and from which the size of its sensor is known."""
    focal = f"{camera.focal_mm:g} mm" if camera.focal_mm else "focal length not in EXIF"
    serial = f", serial number {camera.serial}" if camera.serial else ""
    lens = f", {camera.lens}" if camera.lens else ""
    if camera.source == "unknown":
        size = f"sensor not known: {_UNKNOWN_WIDTH_MM:g} mm assumed, which changes no coordinate; see --sensor-width"
    else:
        size = f"sensor {camera.width_mm:.4g} mm wide (from {camera.source})"
    return f"{camera.model or 'no camera in EXIF'}{serial}{lens}, {focal}, {camera.columns} x {camera.rows}, {size}"


def _known_roughly(made: CameraMade) -> list[ControlElement]:
    """Return what is known of a camera before any adjustment, as observed values of its unknowns."""
    pixel, c = _pixel_and_c(made.camera)
    middle = _OF_PRINCIPAL_POINT * made.camera.columns * pixel
    share = _OF_FOCAL_LENGTH if made.camera.focal_px else _UNKNOWN_FOCAL_LENGTH
    # orip's polynomial is in powers of mm, that of OpenCV in powers of the tangent
    errors = {"C": share * c, "DX": middle, "DY": middle, "A3": _OF_DISTORTION * c**-2, "A5": _OF_DISTORTION * c**-4}
    return [
        ControlElement(made.name, "CAMERA", kind, c if kind == "C" else 0.0, float(f"{error:.2g}"))
        for kind, error in errors.items()
    ]


def _pixel_and_c(camera: ImageCamera) -> tuple[float, float]:
    """Return the size of a pixel and the principal distance, mm."""
    longer = max(camera.columns, camera.rows)
    pixel = camera.width_mm / camera.columns if camera.width_mm else _UNKNOWN_WIDTH_MM / longer
    return pixel, round((camera.focal_px or longer) * pixel, 4)


def _camera_text(made: CameraMade) -> str:
    camera = made.camera
    pixel, c = _pixel_and_c(camera)
    sensor = {
        "columns": camera.columns, "rows": camera.rows,
        "width": round(camera.columns * pixel, 6), "height": round(camera.rows * pixel, 6),
    }  # fmt: skip
    guessed = "" if camera.focal_px else "# c is not in EXIF: the longer side of the sensor stands for it.\n"
    table = {
        "name": made.name,
        "c": c,
        "sensor": sensor,
        "unknown": ["C", "DX", "DY", "A3", "A5", "P1", "P2"],
    }
    comment = f"# {camera_words(camera)}.\n# 'unknown' are adjusted: remove what the block cannot determine.\n"
    return comment + guessed + toml_table("[[camera]]", table)


def _project_text(
    name: str,
    folder: Path,
    survey: Survey,
    names: Mapping[Path, str],
    cameras: Sequence[CameraMade],
    crs: str | None,
    *,
    is_free: bool,
) -> str:
    camera_of = {photo: made.name for made in cameras for photo in made.photos}
    parts = [
        "# Made of photographs by 'orip photos'. Lines with # are comments; the reference has all keys.\n",
        toml_table("[project]", {"name": name, **({"crs": crs} if crs else {})}) + ("" if crs else _NO_CRS),
        *map(_camera_text, cameras),
        "# The photos; image is the file from this folder, which orip never changes.\n",
    ]
    for photo in survey.photos:
        key = names[photo.path]
        image = _from(folder, photo.path)
        parts.append(toml_table("[[photo]]", {"name": key, "camera": camera_of[key], "image": image}))
    if survey.left_out:
        lines = [f"# image = {toml_value(_from(folder, path))}: {fault}\n" for path, fault in survey.left_out]
        parts.append("# Left out; to use one all the same, write a record of it.\n" + "".join(lines))
    datum = {"datum": "free"} if is_free else {}
    bundle = toml_table("[[bundle]]", {"name": "MAIN", "measurement_precision": "0.5px", **datum})
    free = "# There is no control: a free network, without scale and place.\n" if is_free else ""
    error = "# The adjustment: the a-priori error of a photo coordinate, where a measurement has none.\n"
    parts.append(f"{error}{free}{bundle}")
    return "\n".join(parts)


def _from(folder: Path, path: Path) -> str:
    """Return a path from the project folder, with slashes; the whole one where none leads there."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.resolve().as_posix()
