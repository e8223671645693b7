"""Texts of IGN (TopAero, Borea): ``.OPK`` orientations, cameras, ``.mes`` measurements and ``.app`` control points.

Angles are omega, phi, kappa in degrees, as orip's. Photos have been resampled: a camera has a principal point and a
focal length in pixels, and no distortion.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from orip.errors import Complaint
from orip.exchange.format import Format
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, PhotoNames
from orip.exchange.sources.text import Faults, numbered_words, quoted_words, text_lines
from orip.files.text.shown import Parsed
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, PoseReading
from orip.wording import counted

READING = PoseReading("y_up", "to_ground", "omega_phi_kappa", "degree", "centre")

_HEAD = ["NOM", "X", "Y", "Z", "O", "P", "K", "CAMERA"]
_SETTING = re.compile(r"^\s*(Name|PPAx|PPAy|focal|width|height)\s*=\s*(\S+)", re.IGNORECASE)
_KNOWN_CODE = "13"


def orientation_file(source: Path) -> Path | None:
    """Return the ``.OPK`` file: the source itself, or the only one of a folder; None if there is none."""
    if source.is_file():
        return source if source.suffix.lower() == ".opk" else None
    found = sorted(path for path in source.glob("*") if path.suffix.lower() == ".opk") if source.is_dir() else []
    return found[0] if len(found) == 1 else None


def is_ign(source: Path) -> bool:
    """Return whether a folder or file is, or has, an ``.OPK`` with the head of IGN."""
    path = orientation_file(source)
    if path is None:
        return False
    first = next(numbered_words(text_lines(path, Faults(""))), (0, []))
    return first[1] == _HEAD


def read_ign(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read an ``.OPK`` with the cameras, measurements and control points in its folder."""
    path = orientation_file(source)
    if path is None:
        message = "there is no .OPK here, or several; name the one to be read"
        return Parsed(None, (Complaint(message, shown),))
    complaints: list[Complaint] = []
    notes: list[str] = []
    folder = Path(shown) if source.is_dir() else Path(shown).parent

    def faults_of(file: Path) -> Faults:
        return Faults(str(folder / file.name), complaints)

    cameras = [
        camera for file in sorted(path.parent.glob("*.txt")) if (camera := _camera(file, faults_of(file))) is not None
    ]
    photos = _photos(path, cameras, faults_of(path))
    points, rays = CollectedPoints(), CollectedRays()
    for file in _with_suffix(path.parent, ".mes"):
        unmeasured = _add_measurements(file, photos, points, rays, notes, faults_of(file))
        if unmeasured:
            notes.append(f"{file.name}: {counted(unmeasured, 'measurement')} at 0, 0 left out.")
    control: list[ControlPoint] = []
    for file in _with_suffix(path.parent, ".app"):
        control += _control(file, notes, faults_of(file))
    if not photos and not complaints:
        complaints.append(Complaint("the .OPK file has no photo", shown))
    if complaints:
        return Parsed(None, tuple(complaints))
    used = tuple(dict.fromkeys(photo.camera for photo in photos.values()))
    kept = tuple(cameras[place] for place in used)
    placed = tuple(
        ExchangedPhoto(photo.name, used.index(photo.camera), photo.rotation, photo.position, key=photo.key)
        for photo in photos.values()
    )
    return Parsed(
        ExchangedProject(
            path.stem, kept, placed, points.points(), rays.rays(), (READING,), tuple(control),
            ground_unit="m", notes=tuple(notes),
        )
    )  # fmt: skip


def _with_suffix(folder: Path, suffix: str) -> list[Path]:
    return sorted(path for path in folder.glob("*") if path.suffix.lower() == suffix)


def _camera(path: Path, faults: Faults) -> ExchangedCamera | None:
    """Return the camera that a text describes; None if it is none."""
    settings = {
        match[1].lower(): (number, match[2])
        for number, line in enumerate(text_lines(path, faults), start=1)
        if (match := _SETTING.match(line))
    }
    if not {"name", "ppax", "ppay", "focal", "width", "height"} <= set(settings):
        return None
    value = {key: faults.decimal(word, key, number) for key, (number, word) in settings.items() if key != "name"}
    if not all(value[key] > 0 for key in ("focal", "width", "height")):
        faults.complain("focal, width and height have to be above 0", settings["focal"][0])
        return None
    parameters = {"fx": value["focal"], "fy": value["focal"], "cx": value["ppax"], "cy": value["ppay"]}
    return ExchangedCamera(
        settings["name"][1], int(value["width"]), int(value["height"]), "opencv", parameters, "without distortion"
    )


def _photos(path: Path, cameras: list[ExchangedCamera], faults: Faults) -> dict[str, ExchangedPhoto]:
    places = {camera.name: place for place, camera in enumerate(cameras)}
    photos: dict[str, ExchangedPhoto] = {}
    for number, words in numbered_words(text_lines(path, faults)):
        if words == _HEAD:
            continue
        if len(words) != len(_HEAD):
            faults.complain(f"{len(words)} fields, and 8 should be here: {' '.join(_HEAD)}", number)
            continue
        values = [faults.decimal(word, "X Y Z O P K", number) for word in words[1:7]]
        if words[7] not in places:
            faults.complain(f"camera {words[7]} is in no text beside the .OPK (Name= PPAx= PPAy= focal= ...)", number)
            continue
        x, y, z, *angles = values
        photos[words[0]] = ExchangedPhoto(words[0], places[words[7]], tuple(angles), (x, y, z), key=len(photos))
    return photos


def _rows(path: Path, count: int, fields: str, faults: Faults) -> Iterator[tuple[int, list[str]]]:
    """Yield the numbers of the lines that have so many fields, and these; complain of other lines."""
    for number, line in enumerate(text_lines(path, faults), start=1):
        words = quoted_words(line)
        if len(words) == count:
            yield number, words
        elif words:
            faults.complain(f"{len(words)} fields, and {count} should be here: {fields}", number)


def _add_measurements(
    path: Path,
    photos: dict[str, ExchangedPhoto],
    points: CollectedPoints,
    rays: CollectedRays,
    notes: list[str],
    faults: Faults,
) -> int:
    """Add the measurements of a file; return how many stand at 0, 0, which means: not measured."""
    names = PhotoNames(photos)
    unmeasured = 0
    for number, words in _rows(path, 4, "point photo column row", faults):
        column, row = (faults.decimal(word, "column and row", number) for word in words[2:])
        if column == 0.0 and row == 0.0:
            unmeasured += 1
        elif (photo := names.place(words[1])) is not None:
            rays.add(photo, points.add(words[0]), (column, row))
    notes += names.notes(path.name, "measurement")
    return unmeasured


def _control(path: Path, notes: list[str], faults: Faults) -> list[ControlPoint]:
    found, other = [], []
    for number, words in _rows(path, 5, '"point" code X Y Z', faults):
        x, y, z = (faults.decimal(word, "X Y Z", number) for word in words[2:])
        found.append(ControlPoint(words[0], (x, y, z), (None, None, None), line=number))
        if words[1] != _KNOWN_CODE:
            other.append(f"{words[0]} ({words[1]})")
    if other:
        notes.append(
            f"{path.name}: points with a code other than {_KNOWN_CODE} (full control): {', '.join(other[:10])}; "
            "write - for a coordinate that is not known."
        )
    return found


IGN_FORMAT = Format("ign", "IGN: folder with .OPK, camera text, .mes, .app", read_ign, is_ign)
