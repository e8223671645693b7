"""A project as cameras XML of Metashape, a new document or a copy with new numbers, and as reference tables (CSV)."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.exchange.format import Conventions, Format
from orip.exchange.metashape.chunk import ChunkReader, ChunkTransform, chunk_of
from orip.exchange.metashape.project_files import is_project
from orip.exchange.metashape.references import with_references
from orip.exchange.metashape.rigs import masters_of_photos, mount, mounted_on, require_rigs
from orip.exchange.metashape.sensors import PARAMETERS
from orip.exchange.metashape.source import READING, is_metashape, read_metashape
from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import SAME, PlacedElement, XmlEdit, XmlFields, xml_of
from orip.files.text.lines import read_bytes
from orip.files.text.shown import shown_token
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject

_CAMERAS = "cameras.xml"

_SAME_POSE = 1e-9
"""Relative: a geocentric coordinate has 1e-9 m, and is divided by the scale of the chunk."""


def document_file(original: Path) -> Path | None:
    """Return the document of cameras in a folder, or the file itself; None of a project, which is not written."""
    path = original / _CAMERAS if original.is_dir() else original
    return path if path.is_file() and not is_project(path) else None


def is_copied(original: Path) -> bool:
    """Return whether a result is put into a copy of an original: a document, and no project."""
    return document_file(original) is not None


def copied_document(project: ExchangedProject, path: Path) -> bytes:
    """Return a document with the poses and cameras of a project; what has not changed is the same to the byte.

    Raises
    ------
    InputError
        If the document is damaged, of a version before 1.3, or has several cameras or sensors of one label.
    """
    data, complaints = read_bytes(path, str(path))
    faults = Faults(str(path), list(complaints))
    fields = XmlFields(faults)
    root = None if data is None else xml_of(data, faults)
    chunk = None if root is None else chunk_of(root, fields)
    if data is None or chunk is None:
        raise InputError(faults.complaints)
    reader, edit = ChunkReader(chunk, fields), XmlEdit(data)
    if faults.complaints:
        raise InputError(faults.complaints)
    placed = next(edit.root.within("chunk"))
    cameras, sensors = _wanted(project)
    found = list(_labelled(placed, "cameras", "camera", cameras, path))
    require_rigs(project, found, path)
    for label, element in found:
        _move(edit, element, cameras[label], reader.transform(element.attributes.get("component_id")))
    scale = reader.transform(None).scale
    place_of_id: dict[str, int] = {}
    place = {camera.name: n for n, camera in enumerate(project.cameras)}
    found = list(_labelled(placed, "sensors", "sensor", sensors, path))
    for label, element in found:
        place_of_id[element.attributes.get("id", "")] = place[label]
        _calibrate(edit, element, sensors[label], path)
    for label, element in found:
        master = place_of_id.get(element.attributes.get("master_id", ""))
        matrix = None if master is None else mounted_on(project, place[label], master)
        if matrix is not None:
            mount(edit, element, matrix, scale)
    return edit.result()


def require_labels(project: ExchangedProject, original: Path) -> None:
    """Refuse an original that a result could not be put into, as labels do not tell its cameras from one another.

    Parameters
    ----------
    project : ExchangedProject
        As it was read.

    Raises
    ------
    InputError
    """
    path = document_file(original)
    data = None if path is None else read_bytes(path, str(path))[0]
    if path is None or data is None:
        return
    placed = next(XmlEdit(data, str(path)).root.within("chunk"), None)
    if placed is None:
        return
    cameras, sensors = _wanted(project)
    for _ in (
        *_labelled(placed, "cameras", "camera", cameras, path),
        *_labelled(placed, "sensors", "sensor", sensors, path),
    ):
        pass


def _wanted(project: ExchangedProject) -> tuple[dict[str, ExchangedPhoto], dict[str, ExchangedCamera]]:
    photos = {photo.name: photo for photo in project.photos if photo.rotation}
    return photos, {camera.name: camera for camera in project.cameras}


def _labelled(
    chunk: PlacedElement, group: str, tag: str, wanted: object, path: Path
) -> Iterator[tuple[str, PlacedElement]]:
    """Yield the elements whose labels are wanted; an error if one of these labels occurs twice."""
    labels: set[str] = set()
    for element in (found for part in chunk.all(group) for found in part.within(tag)):
        label = element.attributes.get("label") or f"{tag} {element.attributes.get('id', '')}"
        if label not in wanted:  # type: ignore[operator]
            continue
        if label in labels:
            message = (
                f"the label '{shown_token(label)}' is that of several elements <{tag}>, so that the result cannot be "
                "put in its place; give them labels of their own, or adjust it by 'orip import' and 'orip run' and "
                "export another format"
            )
            raise InputError.single(message, str(path))
        labels.add(label)
        yield label, element


def _move(edit: XmlEdit, element: PlacedElement, photo: ExchangedPhoto, transform: ChunkTransform) -> None:
    matrix = next(element.all("transform"), None)
    if matrix is None:
        return
    to_chunk = np.linalg.pinv(transform.rotation)  # that of a damaged document has no inverse
    rotation = to_chunk @ np.array(photo.rotation).reshape(3, 3)
    centre = to_chunk @ (np.array(photo.position) - transform.translation) / transform.scale
    rows = np.vstack([np.column_stack([rotation, centre]), [0.0, 0.0, 0.0, 1.0]])
    if _is_same(edit.numbers(matrix), rows):
        return
    edit.replace(matrix, rows.ravel().tolist())
    if photo.position_covariance is None:
        return
    ground = np.array(photo.position_covariance).reshape(3, 3)
    covariance = (transform.rotation.T @ ground @ transform.rotation / transform.scale**2).ravel().tolist()
    known = next(element.all("location_covariance"), None)
    if known is not None:
        edit.replace(known, covariance)
    else:
        edit.insert(element, f"<location_covariance>{' '.join(map(repr, covariance))}</location_covariance>")


def _is_same(numbers: tuple[float, ...], rows: FloatArray) -> bool:
    """Return whether a matrix in the document is a pose; printed with eight decimals, its rotation is not quite one."""
    if len(numbers) != rows.size or not np.isfinite(numbers).all():
        return False
    old = np.array(numbers).reshape(rows.shape)
    left, _, right = np.linalg.svd(old[:3, :3])
    largest = max(1.0, float(np.abs(old[:3, 3]).max()))
    is_turned = np.abs(left @ right - rows[:3, :3]).max() > _SAME_POSE
    return not is_turned and bool(np.abs(old[:3, 3] - rows[:3, 3]).max() <= _SAME_POSE * largest)


def _calibrate(edit: XmlEdit, element: PlacedElement, camera: ExchangedCamera, path: Path) -> None:
    found = list(element.all("calibration"))
    adjusted = [item for item in found if item.attributes.get("class", "adjusted") == "adjusted"]
    calibration = next(iter(adjusted or found), None)
    if calibration is None:
        return
    if not any(calibration.all("f")):
        message = f"sensor '{camera.name}' is of PhotoScan before 1.3, which is not written; export another format"
        raise InputError.single(message, str(path))
    focal = camera.parameters["f"]
    middle = {"cx": camera.columns / 2.0, "cy": camera.rows / 2.0}
    for name in PARAMETERS:
        value = camera.parameters.get(name, 0.0) - middle.get(name, 0.0)
        # k and p are multiplied by the focal length to become pixels, the others are such
        size = 1.0 if name[0] in "kp" else focal
        known = next(calibration.all(name), None)
        if known is not None:
            edit.replace(known, (value,), size=size)
        elif abs(value) > SAME * size:
            edit.insert(calibration, f"<{name}>{value!r}</{name}>")


# The given coordinates are those that *Import Reference* reads; the estimates, as Metashape's own export has them, may
# be chosen there instead, with their standard deviations as accuracies.

CAMERAS, MARKERS = "reference_cameras.csv", "reference_markers.csv"

_HEADING: Final[tuple[str, ...]] = (
    "#Label", "X/East", "Y/North", "Z/Altitude", "Accuracy_X_(m)", "Accuracy_Y_(m)", "Accuracy_Z_(m)", "Enable",
    "X_est", "Y_est", "Z_est", "SD_X_(m)", "SD_Y_(m)", "SD_Z_(m)",
)  # fmt: skip

_ANGLES: Final[tuple[str, ...]] = (
    "Yaw", "Pitch", "Roll", "Accuracy_Yaw_(deg)", "Accuracy_Pitch_(deg)", "Accuracy_Roll_(deg)"
)  # fmt: skip

_Given = tuple[Sequence[float | None], Sequence[float | None]]
"""Coordinates, and their errors, negative where they are not used."""


def reference_files(project: ExchangedProject) -> Mapping[str, bytes]:
    """Return the tables of cameras and, where there are some, of markers."""
    stations: dict[str, _Given] = {one.photo: (one.position, one.position_error) for one in project.stations}
    oriented = [row for row, photo in enumerate(project.photos) if photo.position]
    photos = np.full((len(project.photos), 3), np.nan)
    photos[oriented] = [project.photos[row].position for row in oriented]
    nothing = (np.nan, np.nan, np.nan)
    deviations = np.array([photo.position_deviation or nothing for photo in project.photos]).reshape(-1, 3)
    places = photos if project.mapped is None else project.mapped.photos
    names = [photo.name for photo in project.photos]
    angles = _angles(project)
    table = [
        [*row, *angles.get(row[0], [""] * len(_ANGLES) * bool(angles))]
        for row in _rows(names, stations, places, deviations)
    ]
    files = {CAMERAS: _table(project.control_crs, table, _ANGLES if angles else ())}
    rows = np.flatnonzero(~project.points.is_track)
    if not rows.size:
        return files
    control: dict[str, _Given] = {one.name: (one.coordinates, one.errors) for one in project.control}
    covariance = project.points.covariance
    if covariance is None:
        covariance = np.full((len(project.points.names), 3, 3), np.nan)
    deviations = np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0.0))
    places = project.points.coordinates if project.mapped is None else project.mapped.points
    marked = [project.points.names[row] for row in rows.tolist()]
    return files | {MARKERS: _table(project.control_crs, _rows(marked, control, places[rows], deviations[rows]))}


def _angles(project: ExchangedProject) -> dict[str, list[str]]:
    """Return yaw, pitch and roll of photos with their accuracies, degrees; those that are only compared have none."""
    found = {}
    for station in project.stations if project.station_reference.navigation else ():
        if station.has_angles:
            given = np.degrees(station.angles[::-1]).tolist()
            errors = np.degrees(station.angle_error[::-1]).tolist()
            found[station.photo] = [*_words(given), *_words(error if error >= 0.0 else None for error in errors)]
    return found


def _rows(
    names: Sequence[str], given: Mapping[str, _Given], places: FloatArray, deviations: FloatArray
) -> Iterable[list[str]]:
    for name, place, deviation in zip(names, places.tolist(), deviations.tolist(), strict=True):
        coordinates, errors = given.get(name, ((None,) * 3, (None,) * 3))
        is_used = not all(error is None or error < 0.0 for error in errors)
        accuracies = [None if error is None else abs(error) for error in errors]
        enabled = "" if name not in given else "1" if is_used else "0"
        yield [name, *_words(coordinates), *_words(accuracies), enabled, *_words(place), *_words(deviation)]


def _words(values: Iterable[float | None]) -> list[str]:
    return ["" if value is None or not np.isfinite(value) else repr(float(value)) for value in values]


def _table(crs: str, rows: Iterable[list[str]], further: tuple[str, ...] = ()) -> bytes:
    text = io.StringIO()
    if crs:
        text.write(f"# CoordinateSystem: {' '.join(crs.split())}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*_HEADING, *further))
    writer.writerows(rows)
    return text.getvalue().encode()


# Tie points have no place in these documents. Metashape finds cameras and sensors by their labels.

_NAME = "cameras.xml"
_LOCAL = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]]]'
_IDENTITY = "1 0 0 0 1 0 0 0 1"


def write_metashape(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:
    """Return the document of cameras and markers, a copy of the original where that is one, and reference tables.

    Raises
    ------
    InputError
        If the original is damaged or gone, or if labels in it do not tell its cameras from one another.
    """
    path = None if original is None else document_file(original)
    if path is not None:
        return {path.name: copied_document(project, path), **reference_files(project)}
    return {_NAME: "\n".join([*_document(project), ""]).encode(), **reference_files(project)}


def _document(project: ExchangedProject) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>\n<document version="1.5.0">'
    yield f'<chunk label={quoteattr(project.name or "Chunk 1")} enabled="true">\n<sensors>'
    masters = {one.camera: rig.mountings[0].camera for rig in project.rigs for one in rig.mountings[1:]}
    for number, camera in enumerate(project.cameras):
        master = masters.get(number)
        yield from _sensor(number, camera, master, None if master is None else mounted_on(project, number, master))
    yield '</sensors>\n<components>\n<component id="0" label="Component 1"><transform>'
    yield f"<rotation>{_IDENTITY}</rotation><translation>0 0 0</translation><scale>1</scale>"
    yield "</transform></component>\n</components>\n<cameras>"
    of_photo = masters_of_photos(project)
    for number, photo in enumerate(project.photos):
        yield from _camera(number, photo, of_photo.get(number))
    yield "</cameras>\n<markers>"
    control = {point.name: point for point in project.control}
    marks = project.points.marks
    for number, name in enumerate(marks):
        yield f'<marker id="{number}" label={quoteattr(name)}>{_reference(control.get(name))}</marker>'
    yield '</markers>\n<frames>\n<frame id="0">\n<markers>'
    yield from _locations(project, list(marks.values()))
    yield f"</markers>\n</frame>\n</frames>\n<reference>{_LOCAL}</reference>\n</chunk>\n</document>"


def _sensor(number: int, camera: ExchangedCamera, master: int | None, matrix: FloatArray | None) -> Iterator[str]:
    kind = "fisheye" if camera.lens == "agisoft_fisheye" else "frame"
    size = f'width="{camera.columns}" height="{camera.rows}"'
    on_rig = "" if master is None or matrix is None else f' master_id="{master}"'
    yield f'<sensor id="{number}"{on_rig} label={quoteattr(camera.name)} type="{kind}">\n<resolution {size}/>'
    if camera.sensor_mm is not None:
        # of square pixels: b1 says how much wider they are
        pixel = camera.sensor_mm[1] / camera.rows
        yield "".join(f'<property name="pixel_{side}" value="{pixel!r}"/>' for side in ("width", "height"))
    yield f'<calibration type="{kind}" class="adjusted">\n<resolution {size}/>'
    values = sensor_parameters(camera)
    yield "".join(f"<{name}>{values[name]!r}</{name}>" for name in PARAMETERS if values[name] or name == "f")
    yield "</calibration>"
    if on_rig and matrix is not None:
        rotation, translation = (" ".join(map(repr, part.ravel().tolist())) for part in (matrix[:3, :3], matrix[:3, 3]))
        yield f"<rotation>{rotation}</rotation>\n<translation>{translation}</translation>"
    yield "</sensor>"


def sensor_parameters(camera: ExchangedCamera) -> dict[str, float]:
    """Return the parameters of a camera as they are in a document: the principal point from the middle of the frame."""
    values = {name: float(camera.parameters.get(name, 0.0)) for name in PARAMETERS}
    return {**values, "cx": values["cx"] - camera.columns / 2.0, "cy": values["cy"] - camera.rows / 2.0}


def _camera(number: int, photo: ExchangedPhoto, master: int | None) -> Iterator[str]:
    begin = f'<camera id="{number}" sensor_id="{photo.camera}" component_id="0" label={quoteattr(photo.name)}'
    if master is not None:
        yield f'{begin} master_id="{master}"/>'
        return
    if not photo.rotation:
        yield f"{begin}/>"
        return
    rows = [(*photo.rotation[3 * n : 3 * n + 3], photo.position[n]) for n in range(3)]
    matrix = " ".join(repr(float(value)) for row in rows for value in row)
    covariance = ""
    if photo.position_covariance is not None:
        words = " ".join(map(repr, photo.position_covariance))
        covariance = f"<location_covariance>{words}</location_covariance>"
    yield f"{begin}><transform>{matrix} 0 0 0 1</transform>{covariance}</camera>"


def _reference(point: ControlPoint | None) -> str:
    """Return what is known of a control point; a check point is not enabled."""
    if point is None:
        return ""
    words = [f'{axis}="{value!r}"' for axis, value in zip("xyz", point.coordinates, strict=True) if value is not None]
    errors = [error for error in point.errors if error is not None]
    if errors:
        words += [f's{axis}="{abs(error or errors[0])!r}"' for axis, error in zip("xyz", point.errors, strict=True)]
    is_check = any(math.copysign(1.0, error) < 0 for error in errors)
    return f'<reference {" ".join(words)} enabled="{"false" if is_check else "true"}"/>'


def _locations(project: ExchangedProject, marked: list[int]) -> Iterator[str]:
    number = {row: n for n, row in enumerate(marked)}
    places: dict[int, list[str]] = {}
    rays = project.rays
    for row, (photo, point) in enumerate(zip(rays.photo.tolist(), rays.point.tolist(), strict=True)):
        if point in number and rays.is_active[row]:
            x, y = rays.image[row].tolist()
            places.setdefault(point, []).append(f'<location camera_id="{photo}" pinned="true" x="{x!r}" y="{y!r}"/>')
    for point, found in places.items():
        yield f'<marker marker_id="{number[point]}">{"".join(found)}</marker>'


METASHAPE_FORMAT = Format(
    "metashape",
    "Agisoft Metashape: project (.psx, .psz), or cameras XML with markers and reference tables (CSV) beside it",
    read_metashape, is_metashape, write_metashape,
    Conventions(
        "agisoft", READING, fisheye_lens="agisoft_fisheye", is_copied=is_copied, has_terms_of_original=True,
        has_rigs=True, lacks=("distances", "tie points"),
    ),
    add_references=with_references, require_way_back=require_labels,
)  # fmt: skip
