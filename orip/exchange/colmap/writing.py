"""Models of COLMAP as files: three of them, as every version reads; text and binary."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping

import numpy as np

from orip.exchange.colmap.folder import Form
from orip.exchange.colmap.model import CAMERA_MODELS, ColmapCamera, ColmapImage, ColmapModel, ColmapPoints
from orip.number_text import shortest_texts

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
    """Return cameras, images and points3D by the names of their files.

    Parameters
    ----------
    model : ColmapModel
    form : {"bin", "txt"}
    before : mapping of str to bytes, optional
        Files of the original: lines of a text that say the same stay as they are written there.
    """
    if form == "bin":
        return {
            "cameras.bin": b"".join(_binary_cameras(model)),
            "images.bin": b"".join(_binary_images(model)),
            "points3D.bin": b"".join(_binary_points(model.points)),
        }
    texts = {
        "cameras.txt": _CAMERAS_HEAD.format(len(model.cameras)) + "".join(map(_camera_line, model.cameras)),
        "images.txt": _images_head(model) + "".join(map(_image_lines, model.images)),
        "points3D.txt": _points_head(model) + "".join(_point_lines(model.points)),
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


def _binary_points(points: ColmapPoints) -> Iterator[bytes]:
    yield struct.pack("<Q", len(points.ids))
    tracks = points.tracks.astype("<u4")
    ends = np.cumsum(points.lengths).tolist()
    start = 0
    rows = zip(
        points.ids.tolist(), points.coordinates.tolist(), points.colours.tolist(), points.errors.tolist(), ends,
        strict=True,
    )  # fmt: skip
    for identity, place, colour, error, end in rows:
        yield struct.pack("<q3d3BdQ", identity, *place, *colour, error, end - start)
        yield tracks[start:end].tobytes()
        start = end
