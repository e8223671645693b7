"""Which files make up a project of MicMac or MMVII, and the project that they give together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path, PurePosixPath

from msgspec import Struct, field

from orip.errors import Complaint
from orip.exchange.micmac import mmvii, version1
from orip.exchange.micmac.ties import TrackJoiner, multiple_tie_files, pair_files, read_multiple_ties, read_pairs
from orip.exchange.micmac.version1 import Calibration, GroundPoint, Orientation, PhotoMark
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, PhotoNames
from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import read_xml
from orip.files.text.regular_file import is_there
from orip.files.text.shown import Parsed
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, PoseReading
from orip.wording import counted

READING = PoseReading("y_down", "to_ground", "matrix", "radian", "centre")

_ORIENTATION = "Orientation-*.xml"
_POSE = "Ori-PerspCentral-*.xml"
_PROJECT = "MMVII-PhgrProj"


class _Reading(Struct):
    """Names files as the user would, and keeps what is wrong with them."""

    root: Path
    shown: str
    complaints: list[Complaint] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def of(self, path: Path) -> Faults:
        """Return the faults of a file; they are those of the project."""
        inside = path.relative_to(self.root) if path.is_relative_to(self.root) else path
        return Faults(str(PurePosixPath(self.shown) / inside.as_posix()), self.complaints)


def find_orientations(source: Path) -> list[Path]:
    """Return the folders with orientations in a project's folder: the folder itself, or those below it."""
    if any(source.glob(_ORIENTATION)) or any(source.glob(_POSE)):
        return [source]
    below = [*source.glob("Ori-*"), *source.glob("Ori/*"), *source.glob(f"{_PROJECT}/Ori/*")]
    return sorted(path for path in below if any(path.glob(_ORIENTATION)) or any(path.glob(_POSE)))


def is_micmac(source: Path) -> bool:
    """Return whether a folder has orientations of MicMac or MMVII."""
    return source.is_dir() and bool(find_orientations(source))


def read_micmac(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a project: a folder ``Ori-NAME`` or ``Ori/NAME``, or a project's folder that has only one.

    Points on the ground and in photos are those of the project's folder, tie points those of its folder ``Homol``.
    """
    reading = _Reading(source, shown)
    folders = find_orientations(source)
    if len(folders) != 1:
        names = ", ".join(path.name for path in folders)
        found = f"there are several folders of orientations ({names})" if folders else "there are no orientations here"
        return Parsed(None, (Complaint(f"{found}; name the one to be read, such as Ori-Compense", shown),))
    is_second = any(folders[0].glob(_POSE))
    project = _read_second(folders[0], reading) if is_second else _read_first(folders[0], reading)
    if not reading.complaints and not project.photos:
        reading.complaints.append(Complaint("no orientation could be read; name another folder", shown))
    return Parsed(None if reading.complaints else project, tuple(reading.complaints))


def _read_first(folder: Path, reading: _Reading) -> ExchangedProject:
    orientations = [version1.read_orientation(path, reading.of(path)) for path in sorted(folder.glob(_ORIENTATION))]
    root = folder.parent

    def calibration(name: str, of: str) -> Calibration | None:
        path = folder / PurePosixPath(name.replace("\\", "/")).name
        if not is_there(path):
            _missing(reading.of(folder / f"Orientation-{of}.xml"), name)
            return None
        return version1.read_calibration(path, reading.of(path))

    ground: list[GroundPoint] = []
    marks: list[PhotoMark] = []
    for path in sorted(root.glob("*.xml")):
        faults = Faults(reading.of(path).shown)
        document = read_xml(path, faults)
        if document is None:
            reading.notes.append(f"{path.name} is not XML and was not read.")
        elif document.tag in ("DicoAppuisFlottant", "SetOfMesureAppuisFlottants"):
            ground += version1.ground_points(document, reading.of(path))
            marks += version1.photo_marks(document, reading.of(path))
    return _project(orientations, calibration, ground, marks, _homol(root), reading)


def _read_second(folder: Path, reading: _Reading) -> ExchangedProject:
    orientations = [mmvii.read_orientation(path, reading.of(path)) for path in sorted(folder.glob(_POSE))]
    root = folder.parent.parent

    def calibration(name: str, of: str) -> Calibration | None:
        path = folder / f"{PurePosixPath(name.replace(chr(92), '/')).name}.xml"
        if not is_there(path):
            _missing(reading.of(folder / f"Ori-PerspCentral-{of}.xml"), name)
            return None
        return mmvii.read_calibration(path, reading.of(path))

    points = root / "PointsMeasure"
    ground = [
        point
        for path in sorted(points.glob("*/MesGCP-*.xml"))
        for point in mmvii.read_ground_points(path, reading.of(path))
    ]
    marks = [
        mark for path in sorted(points.glob("*/MesIm-*.xml")) for mark in mmvii.read_photo_marks(path, reading.of(path))
    ]
    return _project(orientations, calibration, ground, marks, _homol(root), reading)


def _missing(faults: Faults, name: str) -> None:
    faults.complain(f"its camera {name} is not in the folder of the orientations; copy it there")


def _homol(root: Path) -> Path | None:
    folder = root / "Homol"
    return folder if folder.is_dir() else None


def _project(
    orientations: Iterable[Orientation | None],
    calibration: Callable[[str, str], Calibration | None],
    ground: Sequence[GroundPoint],
    marks: Sequence[PhotoMark],
    homol: Path | None,
    reading: _Reading,
) -> ExchangedProject:
    oriented = [orientation for orientation in orientations if orientation is not None]
    files: dict[str, str] = {}
    for orientation in oriented:
        files.setdefault(orientation.calibration, orientation.photo)
    read = {name: calibration(name, photo) for name, photo in files.items()}
    known = {name: camera for name, camera in read.items() if camera is not None}
    places = {name: place for place, name in enumerate(known)}
    used = [orientation for orientation in oriented if orientation.calibration in places]
    photos = tuple(
        ExchangedPhoto(item.photo, places[item.calibration], item.rotation, item.centre, key=number)
        for number, item in enumerate(used)
    )
    points, rays = CollectedPoints(), CollectedRays()
    reading.notes += _add_marks(ground, marks, used, points, rays)
    if homol is not None:
        _add_ties(homol, used, points, rays, reading)
    return ExchangedProject(
        name="",
        cameras=tuple(_camera(name, camera) for name, camera in known.items()),
        photos=photos,
        points=points.points(),
        rays=rays.rays(),
        readings=(READING,),
        control=tuple(_control(point) for point in ground),
        ground_unit="m",
        notes=tuple(reading.notes),
    )


def _camera(name: str, camera: Calibration) -> ExchangedCamera:
    # coefficients of normalised coordinates are those of lengths in pixels times powers of the focal length
    unit = camera.focal if camera.normalised else 1.0
    radial = {f"c{n}": value / unit ** (2 * n) for n, value in enumerate(camera.radial, start=1)}
    (cx, cy), (p1, p2), (b1, b2) = camera.principal_point, camera.decentring, camera.affine
    shift = {"ex": camera.centre[0] - cx, "ey": camera.centre[1] - cy}
    terms = {"p1": p1 / unit, "p2": p2 / unit, "b1": b1, "b2": b2}
    parameters = {"f": camera.focal, "cx": cx, "cy": cy, **shift, **radial, **terms}
    stem = PurePosixPath(name.replace("\\", "/")).name.removesuffix(".xml")
    model = "Fraser" if any((p1, p2, b1, b2)) else "radial"
    free = ("f", "cx", "cy", *(name for name, value in (radial | terms).items() if value))
    return ExchangedCamera(stem, *camera.size, "fraser", parameters, model, free=free)


def _control(point: GroundPoint) -> ControlPoint:
    x, y, z = point.coordinates
    errors: tuple[float | None, float | None, float | None] = (None, None, None)
    if point.covariance is not None:
        xx, _, _, yy, _, zz = point.covariance
        errors = (xx**0.5, yy**0.5, zz**0.5) if min(xx, yy, zz) > 0 else errors
    return ControlPoint(point.name, (x, y, z), errors, line=point.line)


def _add_marks(
    ground: Sequence[GroundPoint],
    marks: Sequence[PhotoMark],
    orientations: Sequence[Orientation],
    points: CollectedPoints,
    rays: CollectedRays,
) -> list[str]:
    """Add measurements, once for each photo and point, as several files may have them; return what was left out."""
    for point in ground:
        points.add(point.name, point.coordinates)
    names = PhotoNames(item.photo for item in orientations)
    seen: set[tuple[int, str]] = set()
    for mark in marks:
        photo = names.place(mark.photo)
        if photo is None or (photo, mark.point) in seen:
            continue
        seen.add((photo, mark.point))
        deviation = float("nan") if mark.deviation is None else max(mark.deviation)
        image = pixel_of_camera(mark.pixel, orientations[photo].to_camera)
        rays.add(photo, points.add(mark.point), image, deviation)
    return names.notes("the lists of measured points", "measurement")


def pixel_of_camera(pixel: Sequence[float], to_camera: tuple[float, ...] | None) -> tuple[float, float]:
    """Return a pixel of a photo in the coordinates of its camera; they differ for scanned photos."""
    x, y = pixel
    if to_camera is None:
        return x, y
    x0, y0, xx, yx, xy, yy = to_camera
    return x0 + xx * x + xy * y, y0 + yx * x + yy * y


def _add_ties(
    homol: Path, orientations: Sequence[Orientation], points: CollectedPoints, rays: CollectedRays, reading: _Reading
) -> None:
    photos = {item.photo: place for place, item in enumerate(orientations)}
    joiner = TrackJoiner()
    pairs, multiple = pair_files(homol), multiple_tie_files(homol)
    for first, second, path in pairs:
        if first in photos and second in photos:
            read_pairs(path, (photos[first], photos[second]), joiner, reading.of(path))
    if pairs and multiple:
        reading.notes.append(f"{counted(len(multiple), 'file')} PMul not read: the pairs in Homol have the tie points.")
    for path in () if pairs else multiple:
        read_multiple_ties(path, photos, joiner, reading.of(path))
    left_out = 0
    for number, track in enumerate(joiner.tracks(), start=1):
        if len({photo for photo, _, _ in track}) < len(track):
            left_out += 1
            continue
        point = points.add(str(number), is_track=True)
        for photo, column, row in track:
            rays.add(photo, point, pixel_of_camera((column, row), orientations[photo].to_camera))
    if left_out:
        reading.notes.append(f"{counted(left_out, 'track')} meeting a photo twice, left out.")
