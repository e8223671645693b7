"""A folder with a sparse model of COLMAP: its files, read and checked against one another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from orip.errors import MOST_COMPLAINTS, Complaint
from orip.exchange.colmap import binary, text
from orip.exchange.colmap.model import LARGEST_FRAME, ColmapCamera, ColmapImage, ColmapModel, ColmapPoints, no_points
from orip.files.text.lines import read_bytes
from orip.files.text.shown import Parsed, printable

T = TypeVar("T")
Form = Literal["bin", "txt"]

PARTS = ("cameras", "images", "points3D")


def form_of(folder: Path) -> Form | None:
    """Return how the model in a folder is written; None where there is none. Binary files come first, as in COLMAP."""
    forms: tuple[Form, ...] = ("bin", "txt")
    for form in forms:
        if all((folder / f"{part}.{form}").is_file() for part in PARTS):
            return form
    return None


def model_folder(path: Path) -> Path:
    """Return the folder that is meant by a path: itself, one of its files, or the first model of a project's folder."""
    if path.is_file():
        path = path.parent
    candidates = (path, path / "0", path / "sparse" / "0", path / "sparse")
    return next((folder for folder in candidates if form_of(folder) is not None), path)


def read_folder(folder: Path, shown: str) -> Parsed[ColmapModel]:
    """Read the model in a folder."""
    form = form_of(folder)
    if form is None:
        message = "there is no model of COLMAP here: a folder with cameras, images and points3D, all .bin or all .txt"
        return Parsed(ColmapModel((), (), no_points()), (Complaint(message, shown),))

    def part(
        name: str, reads: tuple[Callable[[bytes, str], Parsed[T]], Callable[[bytes, str], Parsed[T]]]
    ) -> Parsed[T]:
        path = folder / f"{name}.{form}"
        named = f"{shown}/{path.name}"
        data, complaints = read_bytes(path, named)
        parsed = reads[form == "txt"](data or b"", named)
        return parsed if data is not None else Parsed(parsed.value, complaints)

    cameras = part("cameras", (binary.cameras_from_bytes, text.cameras_from_text))
    images = part("images", (binary.images_from_bytes, text.images_from_text))
    points = part("points3D", (binary.points_from_bytes, text.points_from_text))
    rigs: Parsed[tuple[int, ...]] = Parsed(())
    if (folder / f"rigs.{form}").is_file():
        rigs = part("rigs", (binary.rigs_from_bytes, text.rigs_from_text))
    model = ColmapModel(cameras.value, images.value, points.value, rigs.value)
    complaints = (*cameras.complaints, *images.complaints, *points.complaints, *rigs.complaints)
    return Parsed(model, complaints or tuple(_contradictions(model, form, shown)))


def _contradictions(model: ColmapModel, form: Form, shown: str) -> Iterator[Complaint]:
    """Yield what is impossible in a model whose files are readable."""
    yield from _of_cameras(model.cameras, f"{shown}/cameras.{form}")
    yield from _of_images(model.images, {camera.id for camera in model.cameras}, f"{shown}/images.{form}")
    yield from _of_points(model.points, f"{shown}/points3D.{form}")


def _of_cameras(cameras: Sequence[ColmapCamera], path: str) -> Iterator[Complaint]:
    yield from _repeated([camera.id for camera in cameras], "camera", path)
    for camera in cameras:
        if not (0 < camera.columns <= LARGEST_FRAME and 0 < camera.rows <= LARGEST_FRAME):
            message = f"camera {camera.id} has {camera.columns} by {camera.rows} pixels; the file is damaged"
            yield Complaint(message, path)
        if not np.isfinite(camera.parameters).all():
            yield Complaint(f"camera {camera.id} has a parameter that is not finite", path)


def _of_images(images: Sequence[ColmapImage], cameras: set[int], path: str) -> Iterator[Complaint]:
    yield from _repeated([image.id for image in images], "image", path)
    for image in images:
        named = f"image {image.id} ({printable(image.name)})"
        if image.camera not in cameras:
            yield Complaint(f"{named} has the camera {image.camera}, which is not among the cameras", path)
        if not np.isfinite(image.pose).all() or not any(image.pose[:4]):
            yield Complaint(f"{named} has no rotation, or a pose that is not finite", path)
        if not np.isfinite(image.keypoints).all():
            place = int(np.flatnonzero(~np.isfinite(image.keypoints).all(axis=1))[0])
            yield Complaint(f"{named}: its keypoint {place} has coordinates that are not finite", path)


def _of_points(points: ColmapPoints, path: str) -> Iterator[Complaint]:
    yield from _repeated(points.ids.tolist(), "point", path)
    impossible = ~np.isfinite(points.coordinates).all(axis=1)
    for row in np.flatnonzero(impossible)[:MOST_COMPLAINTS]:
        yield Complaint(f"point {points.ids[row]} has coordinates that are not finite", path)


def _repeated(ids: Sequence[int], what: str, path: str) -> Iterator[Complaint]:
    if len(set(ids)) == len(ids):
        return
    twice = [identity for identity, count in Counter(ids).items() if count > 1]
    yield from (Complaint(f"{what} {identity} is there twice", path) for identity in twice[:MOST_COMPLAINTS])
