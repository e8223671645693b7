"""openMVG's ``sfm_data.json``: views, intrinsics, extrinsics, structure and control points.

A pose takes ground to camera axes (x right, y down, z forward), x = R (X - C), R by rows. Lengths are pixels, and
measurements are those of the feature detectors, which count from the centre of the upper left pixel, as openMVG itself
does where it resamples images. Distortion is that of Brown at ideal coordinates; the two decentring terms of
``disto_t2`` are OpenCV's, Agisoft's in reverse order.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from msgspec import Struct

from orip.errors import InputError
from orip.exchange.format import WITHOUT_GROUND, Conventions, Format, never
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, places_in_photos, tracks
from orip.exchange.sources.json_tree import JsonValue, read_json
from orip.exchange.sources.names import short_names
from orip.exchange.sources.text import Faults
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, ImageAxes, Lens, PoseReading
from orip.wording import counted

READING = PoseReading("y_down", "to_camera", "matrix", "radian", "centre")
AXES = ImageAxes("pixel", "first_pixel", "down")

_PLANE = ("f", "cx", "cy")
_LENSES: Mapping[str, tuple[Lens, tuple[str, ...]]] = MappingProxyType(
    {
        "disto_k1": ("agisoft", ("k1",)),
        "disto_k3": ("agisoft", ("k1", "k2", "k3")),
        "disto_t2": ("agisoft", ("k1", "k2", "k3", "p2", "p1")),
        "fisheye": ("agisoft_fisheye", ("k1", "k2", "k3", "k4")),
    }
)
"""Formula of a camera by the key of its distortion, with the terms in their order."""

_NAMES = {"pinhole": "", "pinhole_radial_k1": "disto_k1", "pinhole_radial_k3": "disto_k3",
          "pinhole_brown_t2": "disto_t2", "fisheye": "fisheye"}  # fmt: skip
_BEGINNING, _HEAD = 400, '"sfm_data_version"'
_NEW = 1 << 31
"""Added to the number of a type or of an object where cereal meets it first."""

_PLAIN = 1 << 30
"""Number of the type of views that are nothing more."""

LARGEST_ID = (1 << 32) - 2
"""The next one stands for none."""


class View(Struct, frozen=True):
    """A photo with the numbers of its camera and pose, and its place in the file."""

    name: str
    camera: str
    pose: str
    value: JsonValue


class Landmark(Struct, frozen=True):
    """A point, and its image coordinates by the numbers of views."""

    number: str
    coordinates: tuple[float, float, float]
    observations: Sequence[tuple[str, tuple[float, ...]]]


Pose = tuple[tuple[float, ...], tuple[float, ...]]
"""Rotation and projection centre."""


def is_openmvg(source: Path) -> bool:
    """Return whether a file begins as a ``sfm_data.json`` does."""
    return _HEAD in beginning(source, _BEGINNING)


def read_openmvg(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a ``sfm_data.json``."""
    faults = Faults(shown)
    document = read_json(source, faults)
    if document is None or document.required("sfm_data_version") is None:
        return Parsed(None, tuple(faults.complaints))
    cameras = {number: _camera(number, value) for number, value in _entries(document, "intrinsics")}
    poses = {number: _pose(value) for number, value in _entries(document, "extrinsics")}
    views = {number: _view(number, value) for number, value in _entries(document, "views")}
    structure = (_landmark(number, value) for number, value in _entries(document, "structure"))
    control = [_landmark(number, value) for number, value in _entries(document, "control_points")]
    priors = sum(view is not None and view.value.value.get("use_pose_center_prior") is True for view in views.values())
    told = f"{counted(priors, 'position')} of photos (priors of views) left out: the file does not say their system."
    notes = [told] if priors else []
    return project_of(document, cameras, poses, views, structure, READING, control=control, notes=notes)


def project_of(
    document: JsonValue,
    cameras: Mapping[str, ExchangedCamera | None],
    poses: Mapping[str, Pose | None],
    views: Mapping[str, View | None],
    structure: Iterable[Landmark | None],
    reading: PoseReading,
    *,
    control: Iterable[Landmark | None] = (),
    notes: Sequence[str] = (),
) -> Parsed[ExchangedProject | None]:
    """Return the project of parts that refer to one another by numbers; parts with complaints are None."""
    sound = [camera for camera in cameras.values() if camera is not None]
    place_of_camera = {camera.name: n for n, camera in enumerate(sound)}
    oriented = {number: view for number, view in views.items() if view is not None and poses.get(view.pose) is not None}
    for view in oriented.values():
        if view.camera not in cameras:
            view.value.complain(f"there is no camera {view.camera} in the file; export it again")
    if not oriented:
        document.complain("no photo is oriented; there is nothing to import")
    points, rays = CollectedPoints(), CollectedRays()
    places = {number: n for n, number in enumerate(oriented)}
    marks = [mark for mark in control if mark is not None]
    without = sum(
        _add_landmark(one, points, rays, places, is_track=is_track)
        for landmarks, is_track in ((structure, True), (marks, False))
        for one in landmarks
        if one is not None
    )
    complaints = document.source.faults.complaints
    if complaints:
        return Parsed(None, tuple(complaints))
    lost = len(views) - len(oriented)
    told = [
        *notes,
        *([f"{counted(lost, 'photo')} not oriented, left out."] if lost else []),
        *([f"{counted(without, 'measurement')} in photos not oriented, left out."] if without else []),
    ]
    photos = tuple(
        ExchangedPhoto(view.name, place_of_camera[view.camera], *(poses[view.pose] or ((), ())), key=n)
        for n, view in enumerate(oriented.values())
    )
    return Parsed(
        ExchangedProject(
            name="",
            cameras=tuple(sound),
            photos=photos,
            points=points.points(),
            rays=rays.rays(),
            readings=(reading,),
            control=tuple(ControlPoint(one.number, one.coordinates, (None, None, None)) for one in marks),
            notes=tuple(told),
        )
    )


def _add_landmark(
    one: Landmark, points: CollectedPoints, rays: CollectedRays, places: Mapping[str, int], *, is_track: bool
) -> int:
    """Add a point and its rays; return how many of these are in photos that are not oriented."""
    point = points.add(one.number, one.coordinates if is_track else None, is_track=is_track)
    lost = 0
    for view, image in one.observations:
        if view in places:
            rays.add(places[view], point, image)
        else:
            lost += 1
    return lost


def number_of(value: JsonValue, key: str) -> str | None:
    """Return the number of a part, which may be written as a text; None, and a complaint kept, if there is none."""
    found = value.required(key)
    if found is None:
        return None
    text = str(found.value) if type(found.value) in (int, str) else ""
    if text.isascii() and text.isdigit() and len(text) <= len(str(_NEW)) and int(text) <= LARGEST_ID + 1:
        return str(int(text))
    found.complain(f"a whole number from 0 to {LARGEST_ID} should be here; correct it")
    return None


def numbered(values: Iterable[tuple[JsonValue, str | None]]) -> Iterator[tuple[str, JsonValue]]:
    """Iterate over parts with their numbers; a complaint is kept of a number that is there twice."""
    taken = set()
    for value, number in values:
        if number in taken:
            value.complain(f"number {number} is there twice; export the file again")
        elif number is not None:
            taken.add(number)
            yield number, value


def _entries(document: JsonValue, key: str) -> Iterator[tuple[str, JsonValue]]:
    part = document.get(key)
    pairs = ((item, number_of(item, "key")) for item in (part.items() if part is not None else ()))
    for number, item in numbered(pairs):
        value = item.required("value")
        if value is not None:
            yield number, value


def _data(value: JsonValue) -> JsonValue | None:
    """Return what a pointer of cereal points to."""
    wrapper = value.required("ptr_wrapper")
    return None if wrapper is None else wrapper.required("data")


def _camera(number: str, value: JsonValue) -> ExchangedCamera | None:
    data = _data(value)
    if data is None:
        return None
    base = data.get("value0") or data  # some writers keep the parts of the base class apart
    width, height = base.number("width"), base.number("height")
    if width is None or height is None:
        return None
    if min(width, height) < 1:
        base.complain("width and height have to be above 0; correct them")
        return None
    name = value.value.get("polymorphic_name")
    columns, rows = int(width), int(height)
    if (isinstance(name, str) and name not in _NAMES) or base.get("focal_length") is None:
        return ExchangedCamera(number, columns, rows, "unsupported", {}, name if isinstance(name, str) else "spherical")
    focal, principal_point = base.number("focal_length"), base.numbers("principal_point", 2)
    key = next((key for key in _LENSES if data.get(key) is not None), "")
    lens, terms = _LENSES.get(key, ("agisoft", ()))
    distortion = data.numbers(key, len(terms)) if key else ()
    if focal is None or principal_point is None or distortion is None:
        return None
    if focal <= 0:
        base.complain("the focal length has to be above 0; correct it")
        return None
    parameters = {
        "f": focal,
        "cx": principal_point[0],
        "cy": principal_point[1],
        **dict(zip(terms, distortion, strict=True)),
    }
    return ExchangedCamera(
        number, columns, rows, lens, parameters, key or "pinhole", AXES, AXES, free=(*_PLANE, *terms)
    )  # fmt: skip


def _pose(value: JsonValue) -> Pose | None:
    rows, centre = value.required("rotation"), value.numbers("center", 3)
    if rows is None or centre is None:
        return None
    if not isinstance(rows.value, list) or len(rows.value) != 3:
        rows.complain("3 rows of 3 numbers should be here; correct them")
        return None
    found = [JsonValue({"": row.value}, row.source, row.place).numbers("", 3) for row in rows.items()]
    rotation = tuple(number for row in found if row is not None for number in row)
    return (rotation, centre) if None not in found else None


def _view(number: str, value: JsonValue) -> View | None:
    data = _data(value)
    if data is None:
        return None
    base = data.get("value0") or data
    name, camera, pose = base.text("filename"), number_of(base, "id_intrinsic"), number_of(base, "id_pose")
    if name is None or camera is None or pose is None:
        return None
    folder = base.value.get("local_path")
    name = f"{folder.rstrip('/')}/{name}" if isinstance(folder, str) and folder.strip("/") else name
    return View(name or f"view{number}", camera, pose, base)


def _landmark(number: str, value: JsonValue) -> Landmark | None:
    return landmark(number, value.numbers("X", 3), _observations(value))


def _observations(value: JsonValue) -> Iterator[tuple[str | None, tuple[float, ...] | None]]:
    seen = value.get("observations")
    for item in seen.items() if seen is not None else ():
        view, found = number_of(item, "key"), item.required("value")
        yield view, None if found is None else found.numbers("x", 2)


def landmark(
    number: str,
    coordinates: tuple[float, ...] | None,
    observations: Iterable[tuple[str | None, tuple[float, ...] | None]],
) -> Landmark | None:
    """Return a point with what could be read of its observations; None without coordinates."""
    found = [(view, image) for view, image in observations if view is not None and image is not None]
    if coordinates is None:
        return None
    x, y, z = coordinates
    return Landmark(number, (x, y, z), found)


def _numbers_of_points(project: ExchangedProject) -> list[str]:
    """Return a number for each point: that of its track if there is one and no other point has it."""
    points = project.points

    def suits(name: str) -> bool:
        return name.isascii() and name.isdigit() and str(int(name[:20])) == name and int(name) <= LARGEST_ID

    return short_names(points.names, suits, list(points.tracks.values()))


def write_openmvg(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:  # noqa: ARG001  # new
    """Return ``sfm_data.json``: all cameras as ``pinhole_brown_t2`` or ``fisheye``, and all points as structure."""
    document = {
        "sfm_data_version": "0.3",
        "root_path": "",
        "views": [_written_view(project, n) for n in range(len(project.photos))],
        "intrinsics": _written_cameras(project),
        "extrinsics": [
            {
                "key": n,
                "value": {
                    "rotation": [list(photo.rotation[row : row + 3]) for row in (0, 3, 6)],
                    "center": list(photo.position),
                },
            }
            for n, photo in enumerate(project.photos)
            if photo.rotation and photo.position
        ],
        "structure": [_written_landmark(one) for one in written_landmarks(project)],
        "control_points": [],
    }
    return {"sfm_data.json": json.dumps(document, indent=1, ensure_ascii=False).encode()}


def _written_view(project: ExchangedProject, n: int) -> dict[str, Any]:
    photo = project.photos[n]
    camera = project.cameras[photo.camera]
    folder, _, name = photo.name.rpartition("/")
    data = {"local_path": folder, "filename": name, "width": camera.columns, "height": camera.rows,
            "id_view": n, "id_intrinsic": photo.camera, "id_pose": n}  # fmt: skip
    return {"key": n, "value": {"polymorphic_id": _PLAIN, "ptr_wrapper": {"id": _NEW + n + 1, "data": data}}}


def _written_cameras(project: ExchangedProject) -> list[dict[str, Any]]:
    found = []
    types: dict[str, int] = {}
    for n, camera in enumerate(project.cameras):
        require_plain(camera)
        value = camera.parameters
        name, key = ("fisheye", "fisheye") if camera.lens == "agisoft_fisheye" else ("pinhole_brown_t2", "disto_t2")
        is_first = name not in types
        kind = types.setdefault(name, len(types) + 1)
        data = {"width": camera.columns, "height": camera.rows, "focal_length": value["f"],
                "principal_point": [value["cx"], value["cy"]],
                key: [value.get(term, 0.0) for term in _LENSES[key][1]]}  # fmt: skip
        named = {"polymorphic_name": name} if is_first else {}
        wrapper = {"id": _NEW + len(project.photos) + n + 1, "data": data}
        found.append(
            {"key": n, "value": {"polymorphic_id": kind + _NEW * is_first, **named, "ptr_wrapper": wrapper}}
        )  # fmt: skip
    return found


def require_plain(camera: ExchangedCamera) -> None:
    """Check that a camera has a size, which the format needs.

    Raises
    ------
    InputError
        If it has none.
    """
    if not (camera.columns and camera.rows):
        message = (
            f"camera {camera.name}: the format needs the size of its photos, which is not known; give it in [camera]"
        )
        raise InputError.single(message)


def _written_landmark(one: WrittenLandmark) -> dict[str, Any]:
    rays = [{"key": view, "value": {"id_feat": feature, "x": image}} for view, feature, image in one.observations]
    return {"key": int(one.number), "value": {"X": one.coordinates, "observations": rays}}


class WrittenLandmark(NamedTuple):
    """A point, and numbers of photos, places among the measurements of the photo, and x, y of its measurements."""

    number: str
    coordinates: list[float]
    observations: Iterable[tuple[int, int, list[float]]]


def written_landmarks(project: ExchangedProject) -> Iterator[WrittenLandmark]:
    """Iterate over all points with coordinates, with the measurements that are in use."""
    numbers, keys, rays = _numbers_of_points(project), places_in_photos(project), project.rays
    for place, rows in tracks(project):
        found = zip(rays.photo[rows].tolist(), keys[rows].tolist(), rays.image[rows].tolist(), strict=True)
        yield WrittenLandmark(numbers[place], project.points.coordinates[place].tolist(), found)


OPENMVG_FORMAT = Format(
    "openmvg", "openMVG: sfm_data.json", read_openmvg, is_openmvg, write_openmvg,
    Conventions(
        "agisoft", READING, AXES, AXES, fisheye_lens="agisoft_fisheye", is_copied=never, lacks=WITHOUT_GROUND,
        terms=(*_PLANE, "k1", "k2", "k3", "p1", "p2"), fisheye_terms=(*_PLANE, "k1", "k2", "k3", "k4"),
    ),
    is_file=True,
)  # fmt: skip
