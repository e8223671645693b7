"""Projects of AICON 3D Studio: ``.ior`` cameras, ``.eor`` photos, ``.obc`` points, ``.phc`` measurements, ``.scale``.

Fields are separated by blanks; lengths and their standard deviations are millimetres, angles radians. Image coordinates
count from the centre of the frame, y up; the principal distance has a minus. Distortion is that of ideal coordinates in
the form of the ISP regulations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from orip.errors import Complaint
from orip.exchange.format import Format
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, PhotoNames
from orip.exchange.sources.text import Faults, numbered_words, quoted_words, text_lines
from orip.files.text.shown import Parsed
from orip.records.control import ControlDistance
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, ImageAxes, PoseReading
from orip.wording import counted

READING = PoseReading("y_up", "to_ground", "omega_phi_kappa", "radian", "centre")

_AXES = ImageAxes("mm", "frame_centre", "up")
_SUFFIXES = (".ior", ".eor", ".obc", ".phc")
_CAMERA_FIELDS = (6, 1, 2, 2, 4)
_LINES_OF_CAMERA = 5
_CAMERA = ("f", "cx", "cy", "a1", "a2", "r0", "a3", "p1", "p2", "b1", "b2")
_PLANE = ("f", "cx", "cy")
_FIELDS = {".eor": 11, ".obc": 10, ".phc": 11, ".scale": 7}
_NOT_ORIENTED = 1


def files_of(source: Path) -> dict[str, Path]:
    """Return the files of a project by suffix: those of a folder, or those beside a file with its name."""
    if source.is_dir():
        found = sorted(path for path in source.iterdir() if path.suffix.lower() in (*_SUFFIXES, ".scale"))
    else:
        found = sorted(source.parent.glob(f"{_escaped(source.stem)}.*"))
    return {path.suffix.lower(): path for path in found}


def is_aicon(source: Path) -> bool:
    """Return whether a folder or file has cameras, photos and measurements of AICON beside it."""
    return {".ior", ".eor", ".phc"} <= set(files_of(source))


def read_aicon(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a project: its folder, or one of its files."""
    files = files_of(source)
    missing = [suffix for suffix in _SUFFIXES if suffix not in files]
    if missing:
        message = f"there is no file {' and no '.join(missing)}; copy the files of the project into one folder"
        return Parsed(None, (Complaint(message, shown),))
    complaints: list[Complaint] = []
    folder = Path(shown) if source.is_dir() else Path(shown).parent

    def faults_of(suffix: str) -> Faults:
        return Faults(str(folder / files[suffix].name), complaints)

    codes, cameras = _cameras(files[".ior"], faults_of(".ior"))
    photos = _photos(files[".eor"], codes, faults_of(".eor"))
    points, rays = CollectedPoints(), CollectedRays()
    datum = _add_points(files[".obc"], points, faults_of(".obc"))
    lost = _add_rays(files[".phc"], photos, points, rays, faults_of(".phc"))
    distances = tuple(_distances(files[".scale"], faults_of(".scale"))) if ".scale" in files else ()
    notes = list(lost)
    if datum:
        notes.insert(
            0, f"The datum of the file is that of {counted(len(datum), 'point')}; set datum_points in orip.toml."
        )
    if not photos and not complaints:
        complaints.append(Complaint("there is no oriented photo", shown))
    if complaints:
        return Parsed(None, tuple(complaints))
    return Parsed(
        ExchangedProject(
            "", cameras, tuple(photos.values()), points.points(), rays.rays(), (READING,),
            distances=distances, ground_unit="mm", precision=None, notes=tuple(notes),
        )
    )  # fmt: skip


def _rows(path: Path, suffix: str, faults: Faults) -> Iterable[tuple[int, list[str]]]:
    count = _FIELDS[suffix]
    lines = text_lines(path, faults)
    for number, line in enumerate(lines, start=1):
        words = quoted_words(line)
        if words and len(words) < count:
            faults.complain(f"{len(words)} fields, and {count} should be here", number)
        elif words:
            yield number, words


def _cameras(path: Path, faults: Faults) -> tuple[dict[str, int], tuple[ExchangedCamera, ...]]:
    """Return the cameras, and their places by number; after the number there may be a code."""
    lines = list(numbered_words(text_lines(path, faults)))
    codes: dict[str, int] = {}
    cameras: list[ExchangedCamera] = []
    for start in range(0, len(lines), _LINES_OF_CAMERA):
        part = lines[start : start + _LINES_OF_CAMERA]
        number = part[0][0]
        name, *first = part[0][1]
        counts = [len(first[-6:]), *(len(words) for _, words in part[1:])]
        if counts != list(_CAMERA_FIELDS) or len(first) > _CAMERA_FIELDS[0] + 1:
            faults.complain("a camera has five lines with 7 or 8, 1, 2, 2 and 4 fields", number)
            break
        words = [*first[-6:], *(word for _, row in part[1:] for word in row)]
        values = [faults.decimal(word, "camera", number) for word in words]
        parameters = dict(zip(_CAMERA, values, strict=False)) | {"f": -values[0]}
        width, height, columns, rows = values[-4:]
        if not all(value > 0 for value in (parameters["f"], width, height, columns, rows)):
            message = "the principal distance should be negative, and the frame have a size and columns and rows"
            faults.complain(message, number)
            continue
        codes[name] = len(cameras)
        size = (int(columns), int(rows))
        cameras.append(
            ExchangedCamera(
                name, *size, "isp", parameters, "AICON", _AXES, _AXES, (width, height), _estimated(parameters)
            )
        )
    return codes, tuple(cameras)


def _estimated(parameters: Mapping[str, float]) -> tuple[str, ...]:
    """Return what the network has estimated: all but the radius at which distortion is 0, and terms that are 0."""
    return tuple(name for name, value in parameters.items() if name in _PLANE or (value and name != "r0"))


def _photos(path: Path, codes: dict[str, int], faults: Faults) -> dict[str, ExchangedPhoto]:
    photos: dict[str, ExchangedPhoto] = {}
    for number, words in _rows(path, ".eor", faults):
        pose = [faults.decimal(word, "orientation", number) for word in words[2:8]]
        order, status, orientation = (faults.whole(word, "flag", number) for word in words[8:11])
        if words[1] not in codes:
            faults.complain(f"there is no camera {words[1]} in the .ior", number)
        elif order != 0:
            faults.complain("the order of the rotations is not 0 (omega, phi, kappa); no other is read", number)
        elif status and orientation is not None and orientation > _NOT_ORIENTED:
            x, y, z, *angles = pose
            photos[words[0]] = ExchangedPhoto(words[0], codes[words[1]], tuple(angles), (x, y, z), key=len(photos))
    return photos


def _add_points(path: Path, points: CollectedPoints, faults: Faults) -> list[str]:
    """Add the points; return the names of those that give the datum."""
    datum = []
    for number, words in _rows(path, ".obc", faults):
        points.add(words[0], [faults.decimal(word, "coordinates", number) for word in words[1:4]])
        if words[-1] != "0":
            datum.append(words[0])
    return datum


def _add_rays(
    path: Path, photos: dict[str, ExchangedPhoto], points: CollectedPoints, rays: CollectedRays, faults: Faults
) -> list[str]:
    """Add measurements; return what belongs to no photo."""
    names = PhotoNames(photos)
    for number, words in _rows(path, ".phc", faults):
        x, y, sx, sy = (faults.decimal(word, "x and y and their deviations", number) for word in words[2:6])
        photo = names.place(words[0])
        if photo is not None:
            deviation = max(sx, sy)
            active = words[9] != "0"
            rays.add(photo, points.add(words[1]), (x, y), deviation or float("nan"), is_active=active)
    return names.notes(path.name, "measurement")


def _distances(path: Path, faults: Faults) -> Iterable[ControlDistance]:
    for number, words in _rows(path, ".scale", faults):
        length, sigma = (faults.decimal(word, "length and deviation", number) for word in words[4:6])
        error = sigma if words[6] != "0" else -sigma
        yield ControlDistance(words[1].replace(" ", "_"), words[2], words[3], "XYZ", length, error, number)


def _escaped(stem: str) -> str:
    return "".join(f"[{character}]" if character in "*?[" else character for character in stem)


AICON_FORMAT = Format("aicon", "AICON 3D Studio: folder with .ior, .eor, .obc, .phc", read_aicon, is_aicon)
