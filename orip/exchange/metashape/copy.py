"""A result in a copy of a document of Metashape that has been read: new numbers in the place of those that differ."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.exchange.metashape.chunk import ChunkReader, ChunkTransform, chunk_of
from orip.exchange.metashape.project_files import is_project
from orip.exchange.metashape.sensors import PARAMETERS
from orip.exchange.sources.faults import Faults
from orip.exchange.sources.xml_edit import SAME, PlacedElement, XmlEdit
from orip.exchange.sources.xml_tree import XmlFields, xml_of
from orip.files.text.lines import read_bytes
from orip.files.text.shown import shown_token
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
    for label, element in _labelled(placed, "cameras", "camera", cameras, path):
        _move(edit, element, cameras[label], reader.transform(element.attributes.get("component_id")))
    for label, element in _labelled(placed, "sensors", "sensor", sensors, path):
        _calibrate(edit, element, sensors[label], path)
    return edit.result()


def require_labels(project: ExchangedProject, original: Path) -> None:
    """Refuse an original that a result could not be put into, as labels do not tell its cameras from one another.

    Parameters
    ----------
    project : ExchangedProject
        As it was read.
    original : Path

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
