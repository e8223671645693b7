"""A result of MicMac's first version in a copy of the orientations and cameras that it began with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from orip.errors import InputError
from orip.exchange.sources.xml_edit import PlacedElement, XmlEdit
from orip.files.text.lines import read_bytes
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject

ORIENTATION = "Orientation-{}.xml"

_RADIAL = ("c1", "c2", "c3", "c4")
_FRASER = (("P1", "p1"), ("P2", "p2"), ("b1", "b1"), ("b2", "b2"))


def copied_files(project: ExchangedProject, folder: Path) -> dict[str, bytes]:
    """Return the files of a folder ``Ori-NAME`` with the poses and cameras of a project; the rest stays.

    Pairs that a camera has to reproduce (``Verif``) are taken out where pose or camera are others. Cameras that the
    model of their file has no place for are not among them; no file at all is for a folder of MMVII.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    if not any(folder.glob(ORIENTATION.format("*"))):
        return {}
    files = {path.name: _bytes(path) for path in sorted(folder.glob("*.xml"))}
    changed: set[str] = set()
    for camera in project.cameras:
        name = f"{camera.name}.xml"
        before = files.pop(name, None)
        after = None if before is None else _camera(before, str(folder / name), camera)
        if after is not None:
            files[name] = after
        if after != before:
            changed.add(camera.name)
    for photo in project.photos:
        name = ORIENTATION.format(photo.name)
        if photo.rotation and name in files:
            of_photo = project.cameras[photo.camera].name
            files[name] = _orientation(files[name], str(folder / name), photo, is_camera_same=of_photo not in changed)
    return files


def _bytes(path: Path) -> bytes:
    data, complaints = read_bytes(path, str(path))
    if data is None:
        raise InputError(complaints)
    return data


def _camera(data: bytes, shown: str, camera: ExchangedCamera) -> bytes | None:
    """Return a camera's file with new values; None if its model has no place for them."""
    edit = XmlEdit(data, shown)
    value: Mapping[str, float] = camera.parameters
    root = next(edit.root.within("CalibrationInternConique"), None)
    radial = None if root is None else _radial_part(root)
    if root is None or radial is None:
        return None
    point = (value["cx"], value["cy"])
    centre = (value["cx"] + value.get("ex", 0.0), value["cy"] + value.get("ey", 0.0))
    _replace(edit, root, "PP", point)
    _replace(edit, root, "F", (value["f"],))
    _replace(edit, radial, "CDist", centre)
    terms = list(radial.all("CoeffDist"))
    wanted = [value.get(name, 0.0) for name in _RADIAL]
    model = next(iter(root.all("CalibDistortion/ModPhgrStd")), None)
    others = {tag: value.get(name, 0.0) for tag, name in _FRASER}
    has_place = model is not None and all(any(model.all(tag)) for tag, number in others.items() if number)
    if any(wanted[len(terms) :]) or (any(others.values()) and not has_place):
        return None
    for element, number in zip(terms, [*wanted, *[0.0] * len(terms)], strict=False):
        edit.replace(element, (number,))
    for tag, number in others.items() if model is not None else ():
        _replace(edit, model, tag, (number,))
    return edit.result()


def _radial_part(root: PlacedElement) -> PlacedElement | None:
    models = list(root.all("CalibDistortion"))
    if len(models) != 1:
        return None
    return next(iter([*models[0].all("ModRad"), *models[0].all("ModPhgrStd/RadialePart")]), None)


def _replace(edit: XmlEdit, parent: PlacedElement | None, path: str, values: tuple[float, ...]) -> bool:
    elements = () if parent is None else parent.all(path)
    changes = [edit.replace(element, values) for element in elements]
    return any(changes)


def _orientation(data: bytes, shown: str, photo: ExchangedPhoto, *, is_camera_same: bool) -> bytes:
    edit = XmlEdit(data, shown)
    root = next(edit.root.within("OrientationConique"), None)
    if root is None:
        return data
    rows = [photo.rotation[3 * n : 3 * n + 3] for n in range(3)]
    is_moved = [_replace(edit, root, "Externe/Centre", photo.position)]
    is_moved += [
        _replace(edit, root, f"Externe/ParamRotation/CodageMatr/L{n}", row) for n, row in enumerate(rows, start=1)
    ]
    if any(is_moved) and photo.position_deviation is not None:
        _replace(edit, root, "Externe/IncCentre", photo.position_deviation)
    if any(is_moved) or not is_camera_same:
        for pairs in root.all("Verif"):
            edit.remove(pairs)
    return edit.result()
