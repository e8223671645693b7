"""Which files make up a project of MicMac or MMVII, and the project that they give together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path, PurePosixPath

from msgspec import Struct, field

from orip.errors import Complaint
from orip.exchange.micmac import version1
from orip.exchange.micmac.ties import TrackJoiner, multiple_tie_files, pair_files, read_multiple_ties, read_pairs
from orip.exchange.micmac.version1 import Calibration, GroundPoint, Orientation, PhotoMark
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, PhotoNames
from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import XmlElement, XmlFields, read_xml
from orip.files.text.regular_file import beginning, is_there
from orip.files.text.shown import Parsed, shown_token
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, PoseReading
from orip.wording import counted

_RADIAL = ("K1", "K2", "K3", "K4")
_DECENTRING, _AFFINE = ("p1", "p2"), ("b1", "b2")
_DISTORTION = {"Radial": _RADIAL, "Decentric": _DECENTRING, "Polynomial": _AFFINE}


def read_calibration(path: Path, faults: Faults) -> Calibration | None:
    """Read a camera; None, and complaints kept, if it cannot be represented."""
    camera = _element(path, "InternalCalibration", faults)
    if camera is None:
        return None
    fields = XmlFields(faults)
    projection = fields.text(camera, "Projection")
    if projection is not None and projection != "Stenope":
        faults.complain(f"the projection '{shown_token(projection)}' cannot be converted; Stenope can", camera.line)
    focal, point = fields.decimal(camera, "PerfectProj/F"), fields.decimals(camera, "PerfectProj/PP", 2)
    size = fields.decimals(camera, "PixelFrame/NbPix", 2)
    terms = _terms(camera, fields)
    if focal is None or point is None or size is None:
        return None
    if focal <= 0 or min(size) < 1:
        faults.complain("the size of the photo and the focal length have to be above 0; correct them", camera.line)
        return None
    centre = (point[0], point[1])
    radial = tuple(terms.get(name, 0.0) for name in _RADIAL)
    p1, p2, b1, b2 = (terms.get(name, 0.0) for name in _DECENTRING + _AFFINE)
    return Calibration(centre, focal, (int(size[0]), int(size[1])), centre, radial, (p1, p2), (b1, b2), normalised=True)


def _terms(camera: XmlElement, fields: XmlFields) -> dict[str, float]:
    """Return the terms of the distortion by name; those that have no counterpart are complained of unless 0."""
    terms: dict[str, float] = {}
    distortion = camera.child("Distorsion")
    for part in distortion.children if distortion is not None else ():
        for term in part.children:
            value = fields.faults.decimals(term.text, 1, f"<{term.tag}>", term.line)
            if value is None or value[0] == 0.0:
                continue
            if term.tag in _DISTORTION.get(part.tag, ()):
                terms[term.tag] = value[0]
            else:
                message = f"the term {part.tag} {term.tag} of the distortion cannot be converted; calibrate without it"
                fields.faults.complain(message, term.line)
    return terms


def read_orientation(path: Path, faults: Faults) -> Orientation | None:
    """Read the orientation of a photo."""
    pose = _element(path, "CameraPose", faults)
    if pose is None:
        return None
    fields = XmlFields(faults)
    photo, calibration = fields.text(pose, "NameImage"), fields.text(pose, "NameInternalCalib")
    centre = fields.decimals(pose, "Center", 3)
    axes = [fields.decimals(pose, f"RotMatrix/{tag}", 3) for tag in ("AxeI", "AxeJ", "AxeK")]
    first, second, third = axes
    if photo is None or calibration is None or centre is None or first is None or second is None or third is None:
        return None
    rotation = tuple(axis[row] for row in range(3) for axis in (first, second, third))
    return Orientation(photo, calibration, centre, rotation)


def read_ground_points(path: Path, faults: Faults) -> tuple[GroundPoint, ...]:
    """Read points on the ground (``MesGCP-*.xml``); a unit matrix of covariances is MMVII's default."""
    points = _element(path, "SetGCP", faults)
    fields, found = XmlFields(faults), []
    for element in _measures(points):
        name, coordinates = fields.text(element, "Name"), fields.decimals(element, "Pt", 3)
        covariance = None
        if element.child("__Opt__Sigma2") is not None:
            covariance = fields.decimals(element, "__Opt__Sigma2", 6)
        if name is not None and coordinates is not None:
            given = None if covariance == (1.0, 0.0, 0.0, 1.0, 0.0, 1.0) else covariance
            found.append(GroundPoint(name, coordinates, given, element.line))
    return tuple(found)


def read_photo_marks(path: Path, faults: Faults) -> tuple[PhotoMark, ...]:
    """Read points measured in a photo (``MesIm-*.xml``); a unit matrix of covariances is MMVII's default."""
    marks = _element(path, "SetMesIm", faults)
    fields, found = XmlFields(faults), []
    photo = None if marks is None else fields.text(marks, "NameIm")
    for element in _measures(marks):
        name, pixel = fields.text(element, "Name"), fields.decimals(element, "Pt", 2)
        covariance = None if element.child("Sigma2") is None else fields.decimals(element, "Sigma2", 3)
        if photo is not None and name is not None and pixel is not None:
            found.append(PhotoMark(photo, name, pixel, _deviation(covariance), element.line))
    return tuple(found)


def _deviation(covariance: tuple[float, ...] | None) -> tuple[float, float] | None:
    if covariance is None or covariance == (1.0, 0.0, 1.0):
        return None
    x, _, y = covariance
    return (x**0.5, y**0.5) if x > 0 and y > 0 else None


def _measures(parent: XmlElement | None) -> list[XmlElement]:
    measures = None if parent is None else parent.child("Measures")
    return [] if measures is None else list(measures.all("el"))


def _element(path: Path, tag: str, faults: Faults) -> XmlElement | None:
    root = read_xml(path, faults)
    found = None if root is None else root.child(f"Data/{tag}")
    if root is not None and found is None:
        faults.complain(f"this is not a <{tag}> of MMVII; name another file", root.line)
    return found


READING = PoseReading("y_down", "to_ground", "matrix", "radian", "centre")

_ORIENTATION = "Orientation-*.xml"
_POSE = "Ori-PerspCentral-*.xml"
_PROJECT = "MMVII-PhgrProj"
_LISTS, _BEGINNING = ("DicoAppuisFlottant", "SetOfMesureAppuisFlottants"), 1000
"""Elements of ground points and marks, and characters of a file among which they are."""


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
        if document is None and any(tag in beginning(path, _BEGINNING) for tag in _LISTS):
            reading.of(path).complaints.extend(faults.complaints)
        elif document is None:
            reading.notes.append(f"{path.name} is not XML and was not read.")
        elif document.tag in _LISTS:
            ground += version1.ground_points(document, reading.of(path))
            marks += version1.photo_marks(document, reading.of(path))
    return _project(orientations, calibration, ground, marks, _homol(root), reading)


def _read_second(folder: Path, reading: _Reading) -> ExchangedProject:
    orientations = [read_orientation(path, reading.of(path)) for path in sorted(folder.glob(_POSE))]
    root = folder.parent.parent

    def calibration(name: str, of: str) -> Calibration | None:
        path = folder / f"{PurePosixPath(name.replace(chr(92), '/')).name}.xml"
        if not is_there(path):
            _missing(reading.of(folder / f"Ori-PerspCentral-{of}.xml"), name)
            return None
        return read_calibration(path, reading.of(path))

    points = root / "PointsMeasure"
    ground = [
        point for path in sorted(points.glob("*/MesGCP-*.xml")) for point in read_ground_points(path, reading.of(path))
    ]
    marks = [mark for path in sorted(points.glob("*/MesIm-*.xml")) for mark in read_photo_marks(path, reading.of(path))]
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
