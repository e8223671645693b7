"""Pix4D's Open Photogrammetry Format (OPF 1.x): a project file (``.opf``) and the JSON documents that it names.

The specification is https://pix4d.github.io/opf-spec (repository Pix4D/opf-spec). Its control_points.md gives the
accuracy of a mark, "of the click", no unit, and its examples 1, 10 and 20; pixels are orip's reading. Pixels count
from the outer corner of the upper left one. Angles are those of Rx(omega) Ry(phi) Rz(kappa) from the camera (x right,
y up, z back) to the processing system, which is right-handed, has one unit, and is shifted: processing = swap(scale *
base) + shift. orip takes the shift away, keeps the axes of the processing system, and counts in the unit of the base
system's horizontal axes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from msgspec import Struct

from orip.errors import Complaint
from orip.exchange.format import Format
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.json_tree import JsonValue
from orip.exchange.vision.opf_documents import Documents, Ground, Vector, by_id, identity, path_of, read_ground, vector
from orip.exchange.vision.opf_rigs import read_rigs
from orip.exchange.vision.opf_tracks import add_tracks
from orip.files.text.shown import Parsed, shown_token
from orip.records.control import (
    ANGLE_ERRORS,
    GROUND_ERRORS,
    PIXEL_ERRORS,
    ControlDistance,
    ControlPoint,
    ErrorLimits,
    Station,
)
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, Lens, PoseReading
from orip.units import RADIANS_PER_DEGREE
from orip.wording import counted

READING = PoseReading("y_up", "to_ground", "omega_phi_kappa", "degree", "centre")

_PERSPECTIVE = ("f", "cx", "cy", "k1", "k2", "k3", "p2", "p1")
"""Terms in the order of OPF; T1 and T2 are OpenCV's, Agisoft's in reverse order."""

_PER_RADIAN = 2.0 / math.pi
"""Angles of Pix4D's fisheye formula are 1 at 90 degrees."""

_MOST_TERMS = 7
_COMPARED = -1.0
"""Error of what has no standard deviation: negative, so that it is only compared."""


class _Sensor(Struct, frozen=True):
    """A sensor of the input cameras."""

    name: str
    columns: int
    rows: int
    sensor_mm: tuple[float, float] | None
    internals: JsonValue


def project_file(source: Path) -> Path | None:
    """Return the project's file: the source itself, or the only one in a folder; None if there is none."""
    if source.suffix.lower() == ".opf" and source.is_file():
        return source
    found = sorted(source.glob("*.opf")) if source.is_dir() else []
    return found[0] if len(found) == 1 else None


def is_opf(source: Path) -> bool:
    """Return whether a file has the ending of a project, or a folder one such file."""
    return project_file(source) is not None


def read_opf(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a calibrated project."""
    path = project_file(source)
    if path is None:
        return Parsed(None, (Complaint("there is no project here, or several; name the file .opf itself", shown),))
    documents = Documents(path, Path(shown) / path.name if source.is_dir() else Path(shown))
    project = None if documents.root is None or documents.complaints else _project(documents, documents.root)
    complaints = tuple(documents.complaints)
    return Parsed(None if complaints else project, complaints)


def _project(documents: Documents, root: JsonValue) -> ExchangedProject:
    ground = read_ground(documents)
    images = _images(documents)
    inputs = dict(by_id(documents.parts("input-cameras", "sensors", is_needed=True)))
    sensors = {key: _sensor(value) for key, value in inputs.items()}
    captures = dict(by_id(documents.parts("input-cameras", "captures")))
    cameras, photos, place_of_id, place_of_sensor = _oriented(documents, images, sensors, ground)
    if not photos and not documents.complaints:
        root.complain("no photo is calibrated; there is nothing to import")
    points, rays = CollectedPoints(), CollectedRays()
    add_tracks(documents, ground, place_of_id, points, rays)
    control = list(_control(documents, ground, place_of_id, points, rays))
    stations = list(_stations(documents, captures, ground, {key: photos[n].name for key, n in place_of_id.items()}))
    distances = list(_distances(documents, ground, points))
    of_camera = {place: inputs[key] for key, place in place_of_sensor.items() if key in inputs}
    rigs, exposures = read_rigs(list(captures.values()), of_camera, place_of_id, photos, ground.unit)
    taken = [seen for capture in captures.values() if (seen := capture.required("cameras")) is not None]
    lost = sum(identity(camera, "id") not in place_of_id for seen in taken for camera in seen.items())
    if lost:
        documents.notes.append(f"{counted(lost, 'photo')} not calibrated, left out.")
    return ExchangedProject(
        name=str(root.value["name"]) if isinstance(root.value.get("name"), str) else "",
        cameras=tuple(cameras),
        photos=tuple(photos),
        points=points.points(),
        rays=rays.rays(),
        readings=(READING,),
        control=tuple(point for point, _ in control),
        checks=frozenset(point.name for point, is_check in control if is_check),
        stations=tuple(stations),
        distances=tuple(distances),
        crs=ground.crs,
        ground_unit=ground.unit,
        rigs=rigs,
        exposures=exposures,
        notes=tuple(documents.notes),
    )


def _error(deviation: float, limits: ErrorLimits = GROUND_ERRORS) -> float | None:
    """Return a standard deviation; None where it is none that makes sense."""
    return deviation if deviation > 0.0 and limits.fault(deviation) is None else None


def _images(documents: Documents) -> dict[int, str]:
    """Return the names of images by the identifiers of cameras; the same camera may be there twice."""
    found: dict[int, str] = {}
    for value in documents.parts("camera-list", "cameras", is_needed=True, has_many=True):
        key, uri = identity(value, "id"), value.text("uri")
        if (
            key is not None
            and uri is not None
            and found.setdefault(key, path_of(uri) or f"camera{key}") != path_of(uri)
        ):
            value.complain(f"camera {key} has two images; export the project again")
    return found


def _sensor(value: JsonValue) -> _Sensor | None:
    size, internals, pixel = (
        value.numbers("image_size_px", 2),
        value.required("internals"),
        value.number("pixel_size_um"),
    )
    name = value.text("name")
    if size is None or internals is None or pixel is None or name is None:
        return None
    if min(size) < 1:
        value.complain("width and height have to be above 0; correct them")
        return None
    columns, rows = int(size[0]), int(size[1])
    sensor_mm = (columns * pixel / 1000.0, rows * pixel / 1000.0) if pixel > 0 else None
    return _Sensor(name or "sensor", columns, rows, sensor_mm, internals)


def _oriented(
    documents: Documents, images: Mapping[int, str], sensors: Mapping[int, _Sensor | None], ground: Ground
) -> tuple[list[ExchangedCamera], list[ExchangedPhoto], dict[int, int], dict[int, int]]:
    """Return calibrated cameras and photos, and the places of photos and cameras by OPF's identifiers."""
    cameras: list[ExchangedCamera] = []
    photos: list[ExchangedPhoto] = []
    place_of_sensor: dict[int, int] = {}
    place_of_id: dict[int, int] = {}
    taken_names: set[str] = set()
    for document in documents.of("calibrated-cameras", is_needed=True):
        found, taken = document.required("sensors"), document.required("cameras")
        for key, value in by_id(found.items()) if found is not None else ():
            sensor, internals = sensors.get(key), value.required("internals")
            if key not in sensors:
                value.complain(f"there is no sensor {key} in input_cameras; export the project again")
            camera = None if sensor is None or internals is None else _camera(sensor, internals)
            place_of_sensor[key] = len(cameras)
            cameras += [] if camera is None else [camera]
        rolling: list[float] = []
        for key, value in by_id(taken.items()) if taken is not None else ():
            sensor_id, position, angles = (
                identity(value, "sensor_id"),
                vector(value, "position"),
                vector(value, "orientation_deg"),
            )
            moved = None if value.get("rolling_shutter") is None else vector(value, "rolling_shutter")
            rolling += [] if moved is None else [ground.length(math.hypot(*moved))]
            if sensor_id is None or position is None or angles is None:
                continue
            if sensor_id not in place_of_sensor or key not in images:
                what = f"camera {key} in camera_list" if key not in images else f"calibrated sensor {sensor_id}"
                value.complain(f"there is no {what}; export the project again")
                continue
            if images[key] in taken_names:
                value.complain(f"image {shown_token(images[key])} is that of another camera, too; correct camera_list")
            taken_names.add(images[key])
            place_of_id[key] = len(photos)
            place = ground.place(position)
            photos.append(ExchangedPhoto(images[key], place_of_sensor[sensor_id], angles, place, key=len(photos)))
        if rolling:
            documents.notes.append(
                f"The rolling shutter of {counted(len(rolling), 'photo')} is left out, which moved by up to "
                f"{max(rolling):.3g} {ground.unit} while being read: give stations times, and the camera a readout."
            )
    return cameras, photos, place_of_id, place_of_sensor


def _camera(sensor: _Sensor, internals: JsonValue) -> ExchangedCamera | None:
    """Return a camera, of which those terms are free that Pix4D has changed."""
    kind = internals.text("type")
    if kind is None:
        return None
    read = {"perspective": _perspective, "fisheye": _fisheye}.get(kind)
    parameters = {} if read is None else read(internals)
    if parameters is None:
        return None
    size = (sensor.name, sensor.columns, sensor.rows)
    if not parameters:
        return ExchangedCamera(*size, "unsupported", {}, f"{kind} of Pix4D")
    before = (read(sensor.internals) if read is not None and sensor.internals.text("type") == kind else {}) or {}
    free = tuple(name for name, value in parameters.items() if before.get(name) != value)
    lens: Lens = "agisoft" if kind == "perspective" else "angle_polynomial"
    return ExchangedCamera(*size, lens, parameters, kind, sensor_mm=sensor.sensor_mm, free=free)


def _perspective(internals: JsonValue) -> dict[str, float] | None:
    focal, point = internals.number("focal_length_px"), internals.numbers("principal_point_px", 2)
    radial, tangential = internals.numbers("radial_distortion", 3), internals.numbers("tangential_distortion", 2)
    if focal is None or point is None or radial is None or tangential is None:
        return None
    if focal <= 0:
        internals.complain("the focal length has to be above 0; correct it")
        return None
    return dict(zip(_PERSPECTIVE, (focal, *point, *radial, *tangential), strict=True))


def _fisheye(internals: JsonValue) -> dict[str, float] | None:
    """Return the camera of Pix4D by powers of the angle; empty where p0, C D E F or too many terms forbid it.

    Pix4D: c + [C D; E F] (p0 + p1 t + p2 t^2 ...) for t = 2 / pi times the angle, p1 = 1, so that the focal length is
    2 C / pi. orip's camera is odd in the angle: a term p2, which the specification's own examples have, is fitted, and
    what remains is said or corrected as for other lenses. Sources: Pix4D, "Camera Internals for
    fisheye lens", equations 1 to 5; sensor_internals.schema.json of opf-spec, whose ``polynomial`` begins with p0.
    """
    affine, point, polynomial = (
        internals.numbers("affine", 4),
        internals.numbers("principal_point_px", 2),
        internals.required("polynomial"),
    )
    count = len(polynomial.value) if polynomial is not None and isinstance(polynomial.value, list) else 0
    terms = internals.numbers("polynomial", max(count, 2))
    if affine is None or point is None or terms is None:
        return None
    zeroth, first, *higher = terms
    if zeroth or any(affine[1:3]) or min(affine[0], affine[3]) * first <= 0.0 or len(higher) > _MOST_TERMS:
        return {}
    fx, fy = (value * first * _PER_RADIAN for value in (affine[0], affine[3]))
    ratios = {f"q{n}": value / first * _PER_RADIAN**n for n, value in enumerate(higher, start=1)}
    return {"fx": fx, "fy": fy, "cx": point[0], "cy": point[1], **ratios}


def _control(
    documents: Documents,
    ground: Ground,
    place_of_id: Mapping[int, int],
    points: CollectedPoints,
    rays: CollectedRays,
) -> Iterator[tuple[ControlPoint, bool]]:
    """Add control and manual tie points with their marks; iterate over control, and whether it is only compared."""
    projected = _by_name(documents.parts("projected-control-points", "projected_gcps"))
    adjusted = _by_name(documents.parts("calibrated-control-points", "points"))
    places = {name: vector(value, "coordinates") for name, value in adjusted.items()}
    left_out = lost = elsewhere = 0
    ties = len(rays)
    for key in ("gcps", "mtps"):
        for name, value in _by_name(documents.parts("input-control-points", key)).items():
            if points.place(name) is not None:
                value.complain("a control point of this name is there already; export the project again")
            check = value.get("is_checkpoint")
            is_check = check is not None and check.value is True
            if is_check and key == "mtps":  # all its rays would be disregarded, and the point could not be determined
                left_out += 1
                continue
            place = places.get(name)
            point = points.add(name, None if place is None else ground.place(place))
            lost += _add_marks(value, point, place_of_id, rays)
            if key == "gcps":
                given = _given(projected.get(name), value, ground, "coordinates")
                elsewhere += given is None
                if given is not None:
                    x, y, z = (None if error is None else -error if is_check else error for error in given[1])
                    yield ControlPoint(name, given[0], (x, y, z)), is_check
    marked = len(rays) - ties
    notes = {
        f"The format gives the accuracy of a mark no unit: pixels are read for {counted(marked, 'mark')}.": marked,
        f"{counted(left_out, 'manual tie point')} for checks alone, left out.": left_out,
        f"{counted(lost, 'mark')} in photos not calibrated, left out.": lost,
        f"{counted(elsewhere, 'control point')} in another system than the scene, left out.": elsewhere,
    }
    documents.notes.extend(note for note, count in notes.items() if count)


def _by_name(values: Iterator[JsonValue]) -> dict[str, JsonValue]:
    """Return parts by their names; a complaint is kept of one that is there twice."""
    found: dict[str, JsonValue] = {}
    for value in values:
        name = value.text("id")
        if name is not None and found.setdefault(name, value) is not value:
            value.complain("a control point of this name is there already; export the project again")
    return found


def _add_marks(value: JsonValue, point: int, place_of_id: Mapping[int, int], rays: CollectedRays) -> int:
    """Add the marks of a point, their accuracies as pixels; return how many are in photos that are not calibrated."""
    marks = value.required("marks")
    lost = 0
    for mark in marks.items() if marks is not None else ():
        camera, image, accuracy = identity(mark, "camera_id"), mark.numbers("position_px", 2), mark.number("accuracy")
        if camera is not None and camera in place_of_id and image is not None and accuracy is not None:
            deviation = _error(accuracy, PIXEL_ERRORS)
            deviation = math.nan if deviation is None else deviation
            rays.add(place_of_id[camera], point, image, deviation)
        else:
            lost += 1
    return lost


def _given(
    projected: JsonValue | None, value: JsonValue, ground: Ground, key: str
) -> tuple[Vector, tuple[float | None, float | None, float | None]] | None:
    """Return a place with its standard deviations: as projected, or as given in the base system; None elsewhere."""
    if projected is not None:
        place, deviations = vector(projected, key), vector(projected, "sigmas")
        if place is None or deviations is None:
            return None
        place, deviations = ground.place(place), ground.lengths(deviations)
    else:
        given = value.required("geolocation")
        system = None if given is None else given.required("crs")
        if given is None or system is None or system.text("definition") != ground.definition:
            return None
        place, deviations = vector(given, "coordinates"), vector(given, "sigmas")
        if place is None or deviations is None:
            return None
        place, deviations = ground.of_base(place), ground.of_base(deviations)
    x, y, z = map(_error, deviations)
    return place, (x, y, z)


def _stations(
    documents: Documents, captures: Mapping[int, JsonValue], ground: Ground, names: Mapping[int, str]
) -> Iterator[Station]:
    """Iterate over observed positions and attitudes of the reference cameras of captures."""
    projected = dict(by_id(documents.parts("projected-input-cameras", "captures")))
    elsewhere = 0
    for key, capture in captures.items():
        camera = identity(capture, "reference_camera_id")
        if camera is None or camera not in names or capture.get("geolocation") is None:
            continue
        moved = projected.get(key)
        given = _given(None if moved is None else moved.get("geolocation"), capture, ground, "position")
        elsewhere += given is None
        if given is None:
            continue
        x, y, z = (_COMPARED if error is None else error for error in given[1])
        turned = None if moved is None else moved.get("orientation")
        angles, turns = (None, None) if turned is None else (vector(turned, "angles_deg"), vector(turned, "sigmas_deg"))
        if angles is None or turns is None:
            yield Station(names[camera], given[0], (x, y, z))
            continue
        omega, phi, kappa = (angle * RADIANS_PER_DEGREE for angle in angles)
        deviations = (_error(deviation, ANGLE_ERRORS) for deviation in turns)
        first, second, third = (_COMPARED if error is None else error * RADIANS_PER_DEGREE for error in deviations)
        yield Station(names[camera], given[0], (x, y, z), (omega, phi, kappa), (first, second, third))
    if elsewhere:
        documents.notes.append(
            f"{counted(elsewhere, 'position')} of photos in another system than the scene, left out: the project has "
            "no projected_input_cameras of them."
        )


def _distances(documents: Documents, ground: Ground, points: CollectedPoints) -> Iterator[ControlDistance]:
    lost = sum(1 for _ in documents.parts("constraints", "orientation_constraints"))
    for value in documents.parts("constraints", "scale_constraints"):
        name, start, end = value.text("id"), value.text("id_from"), value.text("id_to")
        length, deviation = value.number("distance"), value.number("sigma")
        if name is None or start is None or end is None or length is None or deviation is None:
            continue
        if points.place(start) is None or points.place(end) is None or start == end or length <= 0.0:
            lost += 1
            continue
        error = _error(ground.length(deviation))
        yield ControlDistance(name, start, end, "XYZ", ground.length(length), _COMPARED if error is None else error)
    if lost:
        documents.notes.append(f"{counted(lost, 'constraint')} of directions, or without its points, left out.")


OPF_FORMAT = Format("opf", "OPF (Open Photogrammetry Format), Pix4D: project.opf or its folder", read_opf, is_opf)
