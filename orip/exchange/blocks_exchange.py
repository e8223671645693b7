"""Blocks Exchange XML of Bentley ContextCapture and iTwin Capture (versions 2.1 and 3): read and written."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal
from xml.sax.saxutils import escape

import numpy as np
from msgspec import Struct, field

from orip.errors import Complaint
from orip.exchange.format import OBSERVED, Conventions, Format, never, require_without
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import XmlElement, XmlFields, is_true, read_xml
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed, shown_token
from orip.records.control import ControlDistance, ControlPoint
from orip.records.exchanged import (
    ExchangedCamera,
    ExchangedPhoto,
    ExchangedProject,
    GroundFrame,
    ImageAxes,
    PoseReading,
)
from orip.structs import replace
from orip.wording import counted

# Pixels count from the centre of the upper left one. A rotation takes the ground to the camera, whose axes are those of
# ``CameraOrientation``; angles are those of its transpose. Distortion is that of coordinates divided by the focal
# length.

AXES = ImageAxes("pixel", "first_pixel", "down")

_MATRIX = tuple(f"M_{row}{column}" for row in range(3) for column in range(3))
_ANGLES = ("Omega", "Phi", "Kappa")
_ORIENTATIONS = {"XRightYDown": "y_down", "XRightYUp": "y_up"}
_DISTORTION = ("K1", "K2", "K3", "P1", "P2")
_SCALE_ERROR = 0.001
"""Of a distance, ground units; the format has none."""

_BEGINNING = 2000


class _Measured(Struct):
    """Measurements by the photo's id, which is known when the whole file is read."""

    ids: dict[str, int] = field(default_factory=dict)
    rows: array[int] = field(default_factory=lambda: array("q"))
    image: array[float] = field(default_factory=lambda: array("d"))

    def add(self, point: int, photo: str, x: float, y: float) -> None:
        """Add a measurement of a point."""
        self.rows.extend((self.ids.setdefault(photo, len(self.ids)), point))
        self.image.extend((x, y))


class _Stream:
    """Takes points as they come."""

    def __init__(self, fields: XmlFields) -> None:
        self._fields = fields
        self.points = CollectedPoints()
        self.measured = _Measured()
        self.control: list[tuple[ControlPoint, str]] = []
        self.checks: set[str] = set()
        self._ties = 0

    def control_point(self, element: XmlElement) -> None:
        """Take a control point with its measurements."""
        name = self._fields.text(element, "Name")
        place = self._position(element)
        if name is None or place is None:
            return
        category = element.child("Category")
        kind = "Full" if category is None else category.text.strip()
        horizontal = self._accuracy(element, "HorizontalAccuracy")
        vertical = self._accuracy(element, "VerticalAccuracy")
        is_check = (check := element.child("CheckPoint")) is not None and is_true(check.text, missing=False)
        self.checks.update([name] if is_check else [])
        sign = -1.0 if is_check else 1.0
        errors = [None if error is None else sign * error for error in (horizontal, horizontal, vertical)]
        known = {"Full": (0, 1, 2), "Horizontal": (0, 1), "Vertical": (2,)}.get(kind, (0, 1, 2))
        x, y, z = (value if n in known else None for n, value in enumerate(place))
        of_x, of_y, of_z = (error if n in known else None for n, error in enumerate(errors))
        control = ControlPoint(name, (x, y, z), (of_x, of_y, of_z), line=element.line)
        srs = element.child("SRSId")
        self.control.append((control, "" if srs is None else srs.text.strip()))
        self._measurements(element, self.points.add(name))

    def tie_point(self, element: XmlElement) -> None:
        """Take a tie point with its measurements."""
        place = self._position(element) if element.child("Position") is not None else None
        self._ties += 1
        self._measurements(element, self.points.add(str(self._ties), place, is_track=True))

    def _position(self, element: XmlElement) -> tuple[float, float, float] | None:
        position = self._fields.required(element, "Position")
        if position is None:
            return None
        x, y, z = (self._fields.decimal(position, tag) for tag in "xyz")
        return None if x is None or y is None or z is None else (x, y, z)

    def _accuracy(self, element: XmlElement, tag: str) -> float | None:
        value = self._fields.optional(element, tag)
        return value if value > 0 else None

    def _measurements(self, element: XmlElement, point: int) -> None:
        for measurement in element.all("Measurement"):
            photo = self._fields.text(measurement, "PhotoId")
            x, y = self._fields.decimal(measurement, "x"), self._fields.decimal(measurement, "y")
            if photo is not None and x is not None and y is not None:
                self.measured.add(point, photo, x, y)


def is_blocks_exchange(source: Path) -> bool:
    """Return whether a file begins as Blocks Exchange XML does."""
    return source.suffix.lower() == ".xml" and "<BlocksExchange" in beginning(source, _BEGINNING)


def read_blocks_exchange(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read the first block of a file."""
    faults = Faults(shown)
    fields = XmlFields(faults)
    stream = _Stream(fields)
    root = read_xml(source, faults, {"ControlPoint": stream.control_point, "TiePoint": stream.tie_point})
    block = None if root is None else root.child("Block")
    if root is None or block is None or root.tag != "BlocksExchange":
        if not faults.complaints:
            faults.complain("there is no <BlocksExchange> with a <Block>; export the block again", 1)
        return Parsed(None, tuple(faults.complaints))
    project = _project(root, block, stream, fields)
    return Parsed(None if faults.complaints else project, tuple(faults.complaints))


def _project(root: XmlElement, block: XmlElement, stream: _Stream, fields: XmlFields) -> ExchangedProject:
    systems = {_text(item, "Id"): item for item in root.within("SRS")}
    own = _text(block, "SRSId")
    crs, frame = _system(systems.get(own), fields)
    cameras: list[ExchangedCamera] = []
    photos: list[ExchangedPhoto] = []
    ids: dict[str, int] = {}
    readings: dict[PoseReading, int] = {}
    for group in block.within("Photogroup"):
        camera, axes = _camera(group, len(cameras), fields)
        if camera is None:
            continue
        for element in group.all("Photo"):
            key = fields.text(element, "Id")
            photo = _photo(element, len(cameras), axes, readings, fields)
            if key is not None and photo is not None:
                ids[key] = len(photos)
                photos.append(replace(photo, key=len(photos)))
        cameras.append(camera)
    if len(readings) > 1:
        fields.faults.complain(
            "photos have rotations of different kinds; export matrices of one camera orientation", block.line
        )
    if not photos and not fields.faults.complaints:
        fields.faults.complaints.append(Complaint("no photo has a rotation and a centre", fields.faults.shown))
    notes: list[str] = []
    rays = _rays(stream.measured, ids, notes)
    others = {system for _, system in stream.control} - {own, ""}
    control_crs = _text(systems[min(others)], "Definition") if others and min(others) in systems else ""
    if len(others) > 1:
        fields.faults.complain("control points are in several systems; export them in one", block.line)
    return ExchangedProject(
        name=_text(block, "Name"),
        cameras=tuple(cameras),
        photos=tuple(photos),
        points=stream.points.points(),
        rays=rays.rays(),
        readings=tuple(readings) or (PoseReading(),),
        control=tuple(point for point, _ in stream.control),
        checks=frozenset(stream.checks),
        control_crs=control_crs,
        distances=tuple(_distances(block, fields, notes)),
        crs=crs,
        ground_unit="m" if own in systems else "unit",
        frame=frame,
        notes=tuple(notes),
    )


def _system(system: XmlElement | None, fields: XmlFields) -> tuple[str | None, GroundFrame]:
    """Return the system of a block: a name or WKT, or a frame that touches the earth."""
    definition = "" if system is None else _text(system, "Definition")
    if system is None or not definition or definition.upper().startswith("LOCAL"):
        return None, GroundFrame()
    if definition.upper().startswith("ENU:"):
        values = fields.faults.decimals(definition[4:].replace(",", " "), 2, "<Definition>", system.line)
        return None, GroundFrame("topocentric", (values[1], values[0], 0.0)) if values else GroundFrame()
    if definition.upper() in ("EPSG:4326", "EPSG:4979", "WGS84") or definition.startswith(("GEOGCS", "GEOGCRS")):
        message = (
            f"the block is in '{shown_token(definition)}', longitude and latitude; export it in a projected system"
        )
        fields.faults.complain(message, system.line)
    return definition, GroundFrame()


def _camera(group: XmlElement, number: int, fields: XmlFields) -> tuple[ExchangedCamera | None, str]:
    name = _text(group, "Name") or f"camera{number + 1}"
    orientation = _text(group, "CameraOrientation") or "XRightYDown"
    axes = _ORIENTATIONS.get(orientation)
    if axes is None:
        known = " and ".join(_ORIENTATIONS)
        fields.faults.complain(f"camera orientation {shown_token(orientation)} is not read, {known} are", group.line)
        return None, "y_down"
    sizes = [fields.decimal(group, f"ImageDimensions/{tag}") for tag in ("Width", "Height")]
    if sizes[0] is None or sizes[1] is None or min(sizes[0], sizes[1]) < 1:
        fields.faults.complain("<ImageDimensions> should have a width and a height", group.line)
        return None, axes
    width, height = sizes[0], sizes[1]
    pixel = fields.optional(group, "PixelSize") or fields.optional(group, "SensorSize") / max(width, height)
    focal = fields.optional(group, "FocalLengthPixels")
    if not focal and pixel > 0:
        focal = fields.optional(group, "FocalLength") / pixel
    kind = _text(group, "CameraModelType") or "Perspective"
    is_plain = fields.optional(group, "AspectRatio", 1.0) == 1.0 and fields.optional(group, "Skew") == 0.0
    if not focal > 0:
        fields.faults.complain(
            "the camera has no focal length (FocalLengthPixels, or FocalLength and SensorSize)", group.line
        )
        return None, axes
    if kind != "Perspective" or not is_plain:
        model = kind if kind != "Perspective" else "AspectRatio, Skew"
        return ExchangedCamera(name, int(width), int(height), "unsupported", {}, model), axes
    x, y = _principal_point(group, (width, height), pixel, axes, fields)
    distortion = {tag.lower(): fields.optional(group, f"Distortion/{tag}") for tag in _DISTORTION}
    size = (pixel * width, pixel * height) if pixel > 0 else None
    parameters = {"f": focal, "cx": x, "cy": y} | distortion
    free = ("f", "cx", "cy", *(term for term, value in distortion.items() if value))
    return ExchangedCamera(name, int(width), int(height), "agisoft", parameters, kind, AXES, AXES, size, free), axes


def _principal_point(
    group: XmlElement, size: tuple[float, float], pixel: float, axes: str, fields: XmlFields
) -> tuple[float, float]:
    """Return the principal point in pixels from the centre of the first one; the middle where there is none."""
    middle = ((size[0] - 1.0) / 2.0, (size[1] - 1.0) / 2.0)
    if group.child("PrincipalPoint/xmm") is not None and pixel > 0:
        x, y = (fields.optional(group, f"PrincipalPoint/{tag}") / pixel for tag in ("xmm", "ymm"))
        return middle[0] + x, middle[1] + (y if axes == "y_down" else -y)
    return fields.optional(group, "PrincipalPoint/x", middle[0]), fields.optional(group, "PrincipalPoint/y", middle[1])


def _photo(
    element: XmlElement, camera: int, axes: str, readings: dict[PoseReading, int], fields: XmlFields
) -> ExchangedPhoto | None:
    """Return a photo; None, without a complaint, if it is not oriented."""
    name, rotation = fields.text(element, "ImagePath"), element.child("Pose/Rotation")
    centre = element.child("Pose/Center")
    if name is None or rotation is None or centre is None or not rotation.children:
        return None
    camera_axes: Literal["y_down", "y_up"] = "y_up" if axes == "y_up" else "y_down"
    tags, reading = _MATRIX, PoseReading(camera_axes, "to_camera", "matrix", "radian", "centre")
    if rotation.child("M_00") is None:
        tags, reading = _ANGLES, PoseReading(camera_axes, "to_ground", "omega_phi_kappa", "degree", "centre")
    if rotation.child(tags[0]) is None:
        fields.faults.complain("a rotation should be M_00 ... M_22, or Omega, Phi, Kappa", rotation.line)
        return None
    numbers = [fields.decimal(rotation, tag) for tag in tags]
    place = [fields.decimal(centre, tag) for tag in "xyz"]
    if None in numbers or None in place:
        return None
    readings.setdefault(reading, len(readings))
    return ExchangedPhoto(name, camera, tuple(n or 0.0 for n in numbers), tuple(n or 0.0 for n in place))


def _rays(measured: _Measured, ids: dict[str, int], notes: list[str]) -> CollectedRays:
    names = list(measured.ids)
    places = [ids.get(name, -1) for name in names]
    rays = CollectedRays()
    lost = 0
    for row in range(len(measured.rows) // 2):
        photo = places[measured.rows[2 * row]]
        if photo < 0:
            lost += 1
        else:
            rays.add(photo, measured.rows[2 * row + 1], measured.image[2 * row : 2 * row + 2], math.nan)
    if lost:
        notes.append(f"{counted(lost, 'measurement')} in photos that are not oriented, left out.")
    return rays


def _distances(block: XmlElement, fields: XmlFields, notes: list[str]) -> Iterable[ControlDistance]:
    for number, element in enumerate(block.within("Scale"), start=1):
        start, end = _text(element, "A"), _text(element, "B")
        length = fields.decimal(element, "DistanceAB")
        if start and end and length is not None:
            if number == 1:
                notes.append(f"The distances of the block have no errors: {_SCALE_ERROR} is assumed.")
            yield ControlDistance(f"S{number}", start, end, "XYZ", length, _SCALE_ERROR, element.line)


def _text(parent: XmlElement, path: str) -> str:
    found = parent.child(path)
    return "" if found is None else found.text.strip()


READING = PoseReading("y_down", "to_camera", "matrix", "radian", "centre")

_CATEGORIES = {(True, True): "Full", (True, False): "Horizontal", (False, True): "Vertical"}


def write_blocks_exchange(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:  # noqa: ARG001  # new
    """Return the file; coordinates are in the project's crs, or a local system."""
    return {"block.xml": "".join(_pieces(project)).encode()}


def _pieces(project: ExchangedProject) -> Iterator[str]:
    definition = project.crs or 'LOCAL_CS["Local",UNIT["metre",1]]'
    yield (
        '<?xml version="1.0" encoding="utf-8"?>\n<BlocksExchange version="2.1">\n<SpatialReferenceSystems><SRS>'
        f"<Id>0</Id><Name>{escape(definition[:60])}</Name><Definition>{escape(definition)}</Definition></SRS>"
        f"</SpatialReferenceSystems>\n<Block>\n<Name>{escape(project.name or 'orip')}</Name><SRSId>0</SRSId>\n"
        "<Photogroups>\n"
    )
    for number, camera in enumerate(project.cameras):
        yield f"<Photogroup>\n{_written_camera(camera)}"
        for key, photo in enumerate(project.photos):
            if photo.camera == number:
                yield _written_photo(key, photo)
        yield "</Photogroup>\n"
    yield "</Photogroups>\n<ControlPoints>\n"
    marks = _marks(project)
    control = {point.name for point in project.control}
    places = project.points.marks
    for point in project.control:
        yield _control(point, marks.get(places.get(point.name, -1), []))
    yield "</ControlPoints>\n<TiePoints>\n"
    for place, rows in marks.items():
        xyz = project.points.coordinates[place].tolist()
        if project.points.is_track[place] or project.points.names[place] not in control:
            position = f"<Position>{_place(xyz)}</Position>" if all(map(math.isfinite, xyz)) else ""
            yield f"<TiePoint>{position}{''.join(rows)}</TiePoint>\n"
    yield "</TiePoints>\n</Block>\n</BlocksExchange>\n"


def _written_camera(camera: ExchangedCamera) -> str:
    value = camera.parameters
    require_without(camera, ("k4", "p3", "p4", "b1", "b2"), "Blocks Exchange XML")
    sensor = "" if camera.sensor_mm is None else f"<SensorSize>{max(camera.sensor_mm)!r}</SensorSize>"
    distortion = "".join(f"<{tag}>{value.get(tag.lower(), 0.0)!r}</{tag}>" for tag in _DISTORTION)
    return (
        f"<Name>{escape(camera.name)}</Name>\n<ImageDimensions><Width>{camera.columns}</Width><Height>{camera.rows}"
        f"</Height></ImageDimensions>\n<CameraModelType>Perspective</CameraModelType>{sensor}<FocalLengthPixels>"
        f"{value['f']!r}</FocalLengthPixels>\n<CameraOrientation>XRightYDown</CameraOrientation>\n<PrincipalPoint><x>"
        f"{value['cx']!r}</x><y>{value['cy']!r}</y></PrincipalPoint>\n<Distortion>{distortion}</Distortion>\n"
    )


def _written_photo(key: int, photo: ExchangedPhoto) -> str:
    head = f"<Photo><Id>{key}</Id><ImagePath>{escape(photo.name)}</ImagePath>"
    if not photo.rotation or not photo.position:
        return f"{head}</Photo>\n"
    matrix = "".join(f"<M_{n // 3}{n % 3}>{float(v)!r}</M_{n // 3}{n % 3}>" for n, v in enumerate(photo.rotation))
    return f"{head}<Pose><Rotation>{matrix}</Rotation><Center>{_place(photo.position)}</Center></Pose></Photo>\n"


def _control(point: ControlPoint, marks: Sequence[str]) -> str:
    x, y, z = point.coordinates
    category = _CATEGORIES.get((x is not None and y is not None, z is not None), "Full")
    check = "true" if point.kind == "check" else "false"
    across, up = point.errors[0], point.errors[2]
    horizontal = "" if not across else f"<HorizontalAccuracy>{abs(across)!r}</HorizontalAccuracy>"
    vertical = "" if not up else f"<VerticalAccuracy>{abs(up)!r}</VerticalAccuracy>"
    position = _place([value or 0.0 for value in point.coordinates])
    return (
        f"<ControlPoint><SRSId>0</SRSId><Name>{escape(point.name)}</Name><Position>{position}</Position><Category>"
        f"{category}</Category><CheckPoint>{check}</CheckPoint>{horizontal}{vertical}{''.join(marks)}</ControlPoint>\n"
    )


def _marks(project: ExchangedProject) -> dict[int, list[str]]:
    """Return the measurements of points by their places."""
    rays = project.rays
    found: dict[int, list[str]] = {}
    for row in np.flatnonzero(rays.is_active).tolist():
        x, y = rays.image[row].tolist()
        mark = f"<Measurement><PhotoId>{rays.photo[row]}</PhotoId><x>{x!r}</x><y>{y!r}</y></Measurement>"
        found.setdefault(int(rays.point[row]), []).append(mark)
    return found


def _place(xyz: Sequence[float]) -> str:
    return "".join(f"<{tag}>{float(value)!r}</{tag}>" for tag, value in zip("xyz", xyz, strict=True))


BLOCKS_FORMAT = Format(
    "blocks", "Blocks Exchange XML: ContextCapture, iTwin Capture",
    read_blocks_exchange, is_blocks_exchange, write_blocks_exchange, is_file=True,
    conventions=Conventions("agisoft", READING, AXES, AXES, is_cartesian=False, is_copied=never, lacks=OBSERVED),
)  # fmt: skip
