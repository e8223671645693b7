"""A project as a folder of orientations of MicMac's first version: new, or a copy of the one that it began with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import escape

from orip.errors import InputError
from orip.exchange.format import WITHOUT_GROUND, Conventions, Format
from orip.exchange.micmac.source import READING, find_orientations, is_micmac, read_micmac
from orip.exchange.sources.xml_tree import PlacedElement, XmlEdit
from orip.files.text.atomic import exported_file_names
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


# It is a copy of the folder that the project was imported from, where that is of the first version, too.

_HEAD = '<?xml version="1.0" ?>\n<ExportAPERO>\n'


def write_micmac(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:
    """Return the files of a folder ``Ori-NAME``; distances of photos from the ground are not known and are left out.

    Raises
    ------
    InputError
        If a file of the original cannot be read.
    """
    copied = copied_files(project, find_orientations(original)[0]) if original and is_copied_folder(original) else {}
    cameras = [camera.name if copied else _calibration(camera.name) for camera in project.cameras]
    names = exported_file_names("{}.xml", cameras)
    files = {name: _camera_text(camera) for name, camera in zip(names, project.cameras, strict=True)}
    oriented = [photo for photo in project.photos if photo.rotation]
    photos = exported_file_names(ORIENTATION, _without_folders([photo.name for photo in oriented]), names)
    for name, photo in zip(photos, oriented, strict=True):
        files[name] = _orientation_text(photo, names[photo.camera])
    return {name: text.encode() for name, text in files.items()} | copied


def is_copied_folder(original: Path) -> bool:
    """Return whether a result is put into a copy: of the first version's orientations, of which there is one folder."""
    folders = find_orientations(original) if original.is_dir() else []
    return len(folders) == 1 and any(folders[0].glob(ORIENTATION.format("*")))


def _without_folders(names: Sequence[str]) -> list[str]:
    """Return names of photos without their folders, with them where they would be the same."""
    short = [name.replace("\\", "/").rsplit("/", 1)[-1] for name in names]
    number = Counter(map(str.casefold, short))
    return [one if number[one.casefold()] == 1 else name for one, name in zip(short, names, strict=True)]


def _calibration(name: str) -> str:
    fit = "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)
    return fit if fit.startswith("AutoCal") else f"AutoCal_{fit}"


def _camera_text(camera: ExchangedCamera) -> str:
    value = camera.parameters
    point = f"{value['cx']!r} {value['cy']!r}"
    centre = f"{value['cx'] + value.get('ex', 0.0)!r} {value['cy'] + value.get('ey', 0.0)!r}"
    radial = "".join(f"<CoeffDist>{value.get(name, 0.0)!r}</CoeffDist>" for name in _RADIAL)
    terms = "".join(
        f"<{tag}>{value.get(name, 0.0)!r}</{tag}>"
        for tag, name in (("P1", "p1"), ("P2", "p2"), ("b1", "b1"), ("b2", "b2"))
    )
    is_one = str(point == centre).lower()
    return (
        f"{_HEAD}<CalibrationInternConique>\n<KnownConv>eConvApero_DistM2C</KnownConv>\n<PP>{point}</PP>\n"
        f"<F>{value['f']!r}</F>\n<SzIm>{camera.columns} {camera.rows}</SzIm>\n<CalibDistortion><ModPhgrStd>\n"
        f"<RadialePart><CDist>{centre}</CDist>{radial}<PPaEqPPs>{is_one}</PPaEqPPs></RadialePart>\n{terms}\n"
        "</ModPhgrStd></CalibDistortion>\n</CalibrationInternConique>\n</ExportAPERO>\n"
    )


def _orientation_text(photo: ExchangedPhoto, calibration: str) -> str:
    rows = [photo.rotation[3 * n : 3 * n + 3] for n in range(3)]
    matrix = "".join(f"<L{n}>{_numbers(row)}</L{n}>\n" for n, row in enumerate(rows, start=1))
    deviation = photo.position_deviation or (1.0, 1.0, 1.0)
    return (
        f"{_HEAD}<OrientationConique>\n<OrIntImaM2C><I00>0 0</I00><V10>1 0</V10><V01>0 1</V01></OrIntImaM2C>\n"
        "<TypeProj>eProjStenope</TypeProj>\n<ZoneUtileInPixel>true</ZoneUtileInPixel>\n"
        f"<FileInterne>{escape(calibration)}</FileInterne>\n<RelativeNameFI>true</RelativeNameFI>\n<Externe>\n"
        f"<KnownConv>eConvApero_DistM2C</KnownConv>\n<Centre>{_numbers(photo.position)}</Centre>\n"
        f"<IncCentre>{_numbers(deviation)}</IncCentre>\n<ParamRotation><CodageMatr>\n{matrix}"
        "</CodageMatr></ParamRotation>\n</Externe>\n</OrientationConique>\n</ExportAPERO>\n"
    )


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)


MICMAC_FORMAT = Format(
    "micmac",
    "MicMac, MMVII: folder Ori-NAME or Ori/NAME, or the project's folder",
    read_micmac,
    is_micmac,
    write_micmac,
    Conventions("fraser", READING, is_copied=is_copied_folder, lacks=(*WITHOUT_GROUND, "measurements")),
)
