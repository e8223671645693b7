"""A project as a model of COLMAP: a new one, or the result in a copy of the model that it was imported from."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from orip.arrays import BoolArray, IntArray, rows_of_groups
from orip.errors import InputError
from orip.exchange.colmap.binary import bytes_of_points
from orip.exchange.colmap.model import (
    CAMERA_MODELS,
    NO_POINT,
    CameraModel,
    ColmapCamera,
    ColmapImage,
    ColmapModel,
    ColmapPoints,
)
from orip.exchange.colmap.reader import (
    PARTS,
    READING,
    Form,
    form_of,
    is_model,
    model_folder,
    places_of_ids,
    read_folder,
    read_model,
)
from orip.exchange.colmap.rig_files import rig_files
from orip.exchange.colmap.rigs import is_same_pose, with_rigs
from orip.exchange.format import WITHOUT_GROUND, Conventions, Format
from orip.exchange.sources.names import distinct_names
from orip.files.text.lines import read_bytes
from orip.number_text import shortest_texts
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject
from orip.structs import replace

_KEYPOINT = np.dtype([("at", "<f8", 2), ("point", "<i8")])

_CAMERAS_HEAD = """\
# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: {}
"""
_IMAGES_HEAD = """\
# Image list with two lines of data per image:
#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME
#   POINTS2D[] as (X, Y, POINT3D_ID)
# Number of images: {}, mean observations per image: {}
"""
_POINTS_HEAD = """\
# 3D point list with one line of data per point:
#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)
# Number of points: {}, mean track length: {}
"""


def model_files(model: ColmapModel, form: Form, before: Mapping[str, bytes] | None = None) -> dict[str, bytes]:
    """Return cameras, images, points3D and, where there are some, rigs and frames by the names of their files.

    Parameters
    ----------
    form : {"bin", "txt"}
    before : mapping of str to bytes, optional
        Files of the original: lines of a text that say the same stay as they are written there.
    """
    if form == "bin":
        return {
            "cameras.bin": b"".join(_binary_cameras(model)),
            "images.bin": b"".join(_binary_images(model)),
            "points3D.bin": bytes_of_points(model.points),
            **rig_files(model, is_binary=True),
        }
    texts = {
        "cameras.txt": _CAMERAS_HEAD.format(len(model.cameras)) + "".join(map(_camera_line, model.cameras)),
        "images.txt": _images_head(model) + "".join(map(_image_lines, model.images)),
        "points3D.txt": _points_head(model) + "".join(_point_lines(model.points)),
        **{name: data.decode() for name, data in rig_files(model, is_binary=False).items()},
    }
    original = before or {}
    return {name: _as_before(text, original.get(name)).encode("utf-8") for name, text in texts.items()}


def _as_before(text: str, original: bytes | None) -> str:
    """Return a text whose lines stand as in the original where they have the same fields and numbers."""
    if original is None:
        return text
    try:
        old = original.decode("utf-8").split("\n")
    except UnicodeDecodeError:
        return text
    new = text.split("\n")
    by_fields = {_key(line): line for line in old}
    head = [line for line in old if line.startswith("#")]
    body = [by_fields.get(_key(line), line) for line in new if not line.startswith("#")]
    return "\n".join([*head, *body])


def _key(line: str) -> tuple[float | str, ...] | str:
    """Return what a line says, whatever the form of its numbers."""
    return tuple(map(_value, line.split()))


def _value(field: str) -> float | str:
    try:
        return float(field)
    except ValueError:
        return field


def _camera_line(camera: ColmapCamera) -> str:
    parameters = " ".join(map(_number, camera.parameters))
    return f"{camera.id} {camera.model} {camera.columns} {camera.rows} {parameters}\n"


def _images_head(model: ColmapModel) -> str:
    seen = sum(int((image.points >= 0).sum()) for image in model.images)
    return _IMAGES_HEAD.format(len(model.images), seen / len(model.images) if model.images else 0)


def _image_lines(image: ColmapImage) -> str:
    pose = " ".join(map(_number, image.pose))
    columns, rows = (shortest_texts(values, "nan") for values in image.keypoints.T)
    points = map(str, image.points.tolist())
    keypoints = " ".join(f"{x} {y} {point}" for x, y, point in zip(columns, rows, points, strict=True))
    return f"{image.id} {pose} {image.camera} {image.name}\n{keypoints}\n"


def _points_head(model: ColmapModel) -> str:
    lengths = model.points.lengths
    return _POINTS_HEAD.format(len(lengths), float(lengths.mean()) if len(lengths) else 0)


def _point_lines(points: ColmapPoints) -> Iterator[str]:
    ends = np.cumsum(points.lengths).tolist()
    tracks = points.tracks.tolist()
    x, y, z = (shortest_texts(values, "nan") for values in points.coordinates.T)
    errors = shortest_texts(points.errors, "nan")
    start = 0
    for n, (identity, colour, end) in enumerate(zip(points.ids.tolist(), points.colours.tolist(), ends, strict=True)):
        track = " ".join(f"{image} {place}" for image, place in tracks[start:end])
        start = end
        yield f"{identity} {x[n]} {y[n]} {z[n]} {' '.join(map(str, colour))} {errors[n]} {track}\n"


def _number(value: float) -> str:
    return repr(float(value)).removesuffix(".0")


def _binary_cameras(model: ColmapModel) -> Iterator[bytes]:
    yield struct.pack("<Q", len(model.cameras))
    for camera in model.cameras:
        yield struct.pack("<IiQQ", camera.id, CAMERA_MODELS[camera.model].number, camera.columns, camera.rows)
        yield struct.pack(f"<{len(camera.parameters)}d", *camera.parameters)


def _binary_images(model: ColmapModel) -> Iterator[bytes]:
    yield struct.pack("<Q", len(model.images))
    for image in model.images:
        yield struct.pack("<I7dI", image.id, *image.pose, image.camera)
        yield image.name.encode("utf-8") + b"\0" + struct.pack("<Q", len(image.points))
        keypoints = np.empty(len(image.points), _KEYPOINT)
        keypoints["at"], keypoints["point"] = image.keypoints, image.points
        yield keypoints.tobytes()


_MODELS_WRITTEN = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE", "THIN_PRISM_FISHEYE",
)  # fmt: skip

COLMAP_FISHEYE_TERMS = CAMERA_MODELS["THIN_PRISM_FISHEYE"].parameters
_UNKNOWN_ERROR = -1.0


def write_model(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:
    """Return the files of a model: binary, unless the original is text.

    Raises
    ------
    InputError
        If the original is damaged or gone.
    """
    if original is None:
        return model_files(new_model(project), "bin")
    folder = model_folder(original)
    parsed = read_folder(folder, str(folder))
    if parsed.complaints:
        raise InputError(parsed.complaints)
    form = form_of(folder) or "bin"
    names = [f"{part}.{form}" for part in (*PARTS, "rigs", "frames")]
    before = {name: read_bytes(folder / name, "")[0] or b"" for name in names if (folder / name).is_file()}
    return model_files(updated_model(parsed.value, project), form, before)


def new_model(project: ExchangedProject) -> ColmapModel:
    """Return a model of the project's photos and points; keypoints are the rays.

    Ids are those that the project has, where these are numbers of their own, else they count from 1.
    """
    photo_ids = _ids([str(photo.key) for photo in project.photos])
    camera_ids = _ids([camera.name for camera in project.cameras])
    point_ids = np.array(_ids(distinct_names(project.points)), dtype=np.int64)
    images = []
    of_photo = rows_of_groups(np.where(project.rays.is_active, project.rays.photo, -1), len(project.photos))
    for number, (photo, rows) in enumerate(zip(project.photos, of_photo, strict=True)):
        images.append(
            ColmapImage(
                photo_ids[number],
                _pose(photo),
                camera_ids[photo.camera],
                photo.name,
                project.rays.image[rows],
                point_ids[project.rays.point[rows]],
            )
        )
    cameras = tuple(_camera(camera, identity) for camera, identity in zip(project.cameras, camera_ids, strict=True))
    residual = project.points.residual
    errors = np.full(len(point_ids), np.nan) if residual is None else residual
    points = ColmapPoints(
        point_ids,
        project.points.coordinates,
        np.zeros((len(point_ids), 3), dtype=np.uint8),
        np.where(np.isfinite(errors), errors, _UNKNOWN_ERROR),
        *_tracks(images, point_ids),
    )
    known = np.isfinite(points.coordinates).all(axis=1) & (points.lengths > 0)
    model = _without_points(ColmapModel(cameras, tuple(images), points), ~known)
    return with_rigs(model, project, None)


def updated_model(original: ColmapModel, project: ExchangedProject) -> ColmapModel:
    """Return a model with the poses, cameras, coordinates and errors of a project; the rest stays.

    Points that the project has not, and rays that it leaves out, become keypoints without a point.
    """
    photos = {photo.name: photo for photo in project.photos}
    cameras = {camera.name: camera for camera in project.cameras}
    images = tuple(_updated_image(image, photos.get(image.name)) for image in original.images)
    points, gone = _updated_points(original.points, project)
    model = ColmapModel(
        tuple(_updated_camera(camera, cameras.get(str(camera.id))) for camera in original.cameras), images, points
    )
    return with_rigs(_without_rays(_without_points(model, gone), project), project, original)


def _updated_image(image: ColmapImage, photo: ExchangedPhoto | None) -> ColmapImage:
    if photo is None:
        return image
    pose = _pose(photo)
    return image if is_same_pose(pose, image.pose) else replace(image, pose=pose)


def _updated_camera(old: ColmapCamera, new: ExchangedCamera | None) -> ColmapCamera:
    if new is None:
        return old
    camera = _camera(replace(new, model=old.model), old.id)
    if camera.model == old.model and np.allclose(camera.parameters, old.parameters, rtol=1e-12, atol=1e-13):
        return old
    return camera


def _updated_points(old: ColmapPoints, project: ExchangedProject) -> tuple[ColmapPoints, BoolArray]:
    """Return the points with the project's coordinates and errors, and which of them the project has not."""
    place = project.points.tracks
    found = np.array([place.get(str(identity), -1) for identity in old.ids.tolist()], dtype=np.int64)
    there = found >= 0
    coordinates, errors = old.coordinates.copy(), old.errors.copy()
    coordinates[there] = project.points.coordinates[found[there]]
    if project.points.residual is not None:
        residual = project.points.residual[found[there]]
        errors[there] = np.where(np.isfinite(residual), residual, errors[there])
    gone = ~there | ~np.isfinite(coordinates).all(axis=1)
    return replace(old, coordinates=coordinates, errors=errors), gone


def _without_points(model: ColmapModel, gone: BoolArray) -> ColmapModel:
    """Return a model without points flagged (m,): their keypoints stay."""
    if not gone.any():
        return model
    points, left = model.points, ~gone
    of_track = np.repeat(left, points.lengths)
    owner = np.concatenate([np.zeros(0, dtype=np.int64), *(image.points for image in model.images)])
    owner[np.isin(owner, points.ids[gone])] = NO_POINT
    ends = np.cumsum([len(image.points) for image in model.images])
    images = tuple(replace(image, points=own) for image, own in zip(model.images, np.split(owner, ends), strict=False))
    kept = ColmapPoints(
        points.ids[left],
        points.coordinates[left],
        points.colours[left],
        points.errors[left],
        points.lengths[left],
        points.tracks[of_track],
    )
    return replace(model, images=images, points=kept)


def _without_rays(model: ColmapModel, project: ExchangedProject) -> ColmapModel:
    """Return a model without the rays that a project leaves out; a point of which less than two are left goes too."""
    left_out = np.flatnonzero(~project.rays.is_active)
    if not left_out.size:
        return model
    pairs = {
        (project.photos[photo].name, project.points.names[point])
        for photo, point in zip(
            project.rays.photo[left_out].tolist(), project.rays.point[left_out].tolist(), strict=True
        )
        if project.points.is_track[point]
    }
    images = tuple(
        replace(
            image,
            points=np.array(
                [NO_POINT if (image.name, str(point)) in pairs else point for point in image.points.tolist()],
                dtype=np.int64,
            ),
        )
        for image in model.images
    )
    lengths, tracks = _tracks(images, model.points.ids)
    model = replace(model, images=images, points=replace(model.points, lengths=lengths, tracks=tracks))
    return _without_points(model, lengths < 2)


def _tracks(images: Sequence[ColmapImage], ids: IntArray) -> tuple[IntArray, IntArray]:
    """Return the numbers of rays of points, and image ids and places of keypoints of all points in their order."""
    rows = [np.zeros((0, 2), dtype=np.int64)]
    owners = [np.zeros(0, dtype=np.int64)]
    for image in images:
        seen = np.flatnonzero(image.points >= 0)
        owners.append(image.points[seen])
        rows.append(np.column_stack([np.full(len(seen), image.id, dtype=np.int64), seen]))
    point, is_known = places_of_ids(np.concatenate(owners), ids)
    point, all_rows = point[is_known], np.concatenate(rows)[is_known]
    lengths = np.bincount(point, minlength=len(ids)).astype(np.int64)
    return lengths, all_rows[np.argsort(point, kind="stable")]


def _camera(camera: ExchangedCamera, identity: int) -> ColmapCamera:
    """Return a camera in its own model where that holds its values, else in the smallest that does."""
    names = (camera.model, *_MODELS_WRITTEN) if camera.model in CAMERA_MODELS else _MODELS_WRITTEN
    name = next((name for name in names if _holds(CAMERA_MODELS[name], camera)), "FULL_OPENCV")
    values = [camera.parameters.get("fx" if key == "f" else key, 0.0) for key in CAMERA_MODELS[name].parameters]
    return ColmapCamera(identity, name, camera.columns, camera.rows, tuple(map(float, values)))


def _holds(model: CameraModel, camera: ExchangedCamera) -> bool:
    if model.lens != camera.lens:
        return False
    values = {name: value for name, value in camera.parameters.items() if value}
    if "f" in model.parameters and values.get("fx") != values.get("fy"):
        return False
    known = {*model.parameters, *(("fx", "fy") if "f" in model.parameters else ())}
    return set(values) <= known


def _pose(photo: ExchangedPhoto) -> tuple[float, ...]:
    return (*map(float, photo.rotation), *map(float, photo.position))


def _ids(names: Sequence[str]) -> list[int]:
    """Return names as whole numbers above 0, or numbers from 1 on where they are none, or not different."""
    numbers = [int(name) for name in names if name.isascii() and name.isdigit() and len(name) < 10 and int(name) > 0]
    return numbers if len(set(numbers)) == len(names) else list(range(1, len(names) + 1))


COLMAP_FORMAT = Format(
    "colmap", "COLMAP: folder of a sparse model, text or binary", read_model, is_model, write_model,
    Conventions(
        "opencv", READING, fisheye_lens="equidistant", fisheye_terms=COLMAP_FISHEYE_TERMS, has_rigs=True,
        lacks=WITHOUT_GROUND,
    ),
)  # fmt: skip
