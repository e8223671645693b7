"""A model of COLMAP as a project to be imported: a folder with its files, checked against one another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from orip.arrays import BoolArray, IntArray
from orip.errors import MOST_COMPLAINTS, Complaint
from orip.exchange.colmap import binary, rig_files, text
from orip.exchange.colmap.model import (
    CAMERA_MODELS,
    LARGEST_FRAME,
    ColmapCamera,
    ColmapFrame,
    ColmapImage,
    ColmapModel,
    ColmapPoints,
    ColmapRig,
    is_pose,
    no_points,
    pose_priors,
)
from orip.exchange.colmap.rigs import exchanged_rigs, with_poses_of_frames
from orip.files.text.decimal_numbers import LARGEST_NUMBER
from orip.files.text.lines import read_bytes
from orip.files.text.shown import Parsed, printable
from orip.records.exchanged import (
    ExchangedCamera,
    ExchangedPhoto,
    ExchangedPoints,
    ExchangedProject,
    ExchangedRays,
    PoseReading,
    StatedError,
)
from orip.wording import counted

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
        names = [f"{part}.{ending}" for ending in ("bin", "txt") for part in PARTS]
        if here := [name for name in names if (folder / name).is_file()]:
            message = f"{message}; there is only {', '.join(here)}"
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
    rigs: Parsed[tuple[ColmapRig, ...]] = Parsed(())
    frames: Parsed[tuple[ColmapFrame, ...]] = Parsed(())
    if all((folder / f"{name}.{form}").is_file() for name in ("rigs", "frames")):
        rigs = part("rigs", (rig_files.rigs_from_bytes, rig_files.rigs_from_text))
        frames = part("frames", (rig_files.frames_from_bytes, rig_files.frames_from_text))
    model = ColmapModel(cameras.value, images.value, points.value, rigs.value, frames.value)
    read = (cameras, images, points, rigs, frames)
    complaints = tuple(complaint for one in read for complaint in one.complaints)
    complaints = complaints or tuple(_contradictions(model, form, shown))
    return Parsed(model if complaints else with_poses_of_frames(model), complaints)


def _contradictions(model: ColmapModel, form: Form, shown: str) -> Iterator[Complaint]:
    """Yield what is impossible in a model whose files are readable."""
    yield from _of_cameras(model.cameras, f"{shown}/cameras.{form}")
    yield from _of_images(model.images, {camera.id for camera in model.cameras}, f"{shown}/images.{form}")
    yield from _of_points(model.points, f"{shown}/points3D.{form}")
    yield from rig_files.rig_contradictions(model, shown, form)


def _of_cameras(cameras: Sequence[ColmapCamera], path: str) -> Iterator[Complaint]:
    yield from _repeated([camera.id for camera in cameras], "camera", path)
    for camera in cameras:
        if not (0 < camera.columns <= LARGEST_FRAME and 0 < camera.rows <= LARGEST_FRAME):
            message = f"camera {camera.id} has {camera.columns} by {camera.rows} pixels; the file is damaged"
            yield Complaint(message, path)
        if not _are_possible(camera.parameters).all():
            yield Complaint(f"camera {camera.id} has a parameter that is no possible number", path)


def _of_images(images: Sequence[ColmapImage], cameras: set[int], path: str) -> Iterator[Complaint]:
    yield from _repeated([image.id for image in images], "image", path)
    for image in images:
        named = f"image {image.id} ({printable(image.name)})"
        if image.camera not in cameras:
            yield Complaint(f"{named} has the camera {image.camera}, which is not among the cameras", path)
        if not is_pose(image.pose):
            yield Complaint(f"{named} has no rotation, or a pose with impossible numbers", path)
        if not _are_possible(image.keypoints).all():
            place = int(np.flatnonzero(~_are_possible(image.keypoints).all(axis=1))[0])
            yield Complaint(f"{named}: its keypoint {place} has impossible coordinates", path)


def _of_points(points: ColmapPoints, path: str) -> Iterator[Complaint]:
    yield from _repeated(points.ids.tolist(), "point", path)
    impossible = ~_are_possible(points.coordinates).all(axis=1)
    for row in np.flatnonzero(impossible)[:MOST_COMPLAINTS]:
        yield Complaint(f"point {points.ids[row]} has impossible coordinates", path)


def _are_possible(numbers: ArrayLike) -> BoolArray:
    """Return which numbers are finite, and not so large that their powers are not."""
    return np.asarray(np.abs(numbers) <= LARGEST_NUMBER)


def _repeated(ids: Sequence[int], what: str, path: str) -> Iterator[Complaint]:
    if len(set(ids)) == len(ids):
        return
    twice = [identity for identity, count in Counter(ids).items() if count > 1]
    yield from (Complaint(f"{what} {identity} is there twice", path) for identity in twice[:MOST_COMPLAINTS])


READING = PoseReading("y_down", "to_camera", "quaternion", position="translation")

_FOCAL = {"f": ("fx", "fy")}
_NOT_FREE = ("cx", "cy")
"""COLMAP holds principal points unless it is told otherwise."""

_MOST_DIGITS_LOST = 1e5
"""Coordinates of text models before COLMAP 3.8 have six digits."""


def is_model(path: Path) -> bool:
    """Tell whether a path leads to a model of COLMAP."""
    return form_of(model_folder(path)) is not None


def read_model(path: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a model, and the positions of photos in the database of its project, if there is one."""
    folder = model_folder(path)
    named = shown if folder == path else f"{shown}/{folder.relative_to(path).as_posix()}" if path.is_dir() else shown
    parsed = read_folder(folder, named)
    if parsed.complaints:
        return Parsed(None, parsed.complaints)
    priors = pose_priors(folder)
    if priors.complaints:
        return Parsed(None, priors.complaints)
    project, notes = project_of_model(parsed.value)
    names = {photo.name for photo in project.photos}
    stations = tuple(station for station in priors.value.stations if station.photo in names)
    return Parsed(
        ExchangedProject(
            "",
            project.cameras,
            project.photos,
            project.points,
            project.rays,
            (READING,),
            stations=stations,
            station_reference=priors.value.reference,
            stated=project.stated,
            rigs=project.rigs,
            exposures=project.exposures,
            notes=(*notes, *priors.value.notes),
        )
    )


def project_of_model(model: ColmapModel) -> tuple[ExchangedProject, tuple[str, ...]]:
    """Return what a model holds, and what of it is lost."""
    place = {camera.id: n for n, camera in enumerate(model.cameras)}
    photos = tuple(
        ExchangedPhoto(image.name, place[image.camera], image.pose[:4], image.pose[4:], key=image.id)
        for image in model.images
    )
    rays, unknown = _rays(model.images, model.points.ids)
    points = ExchangedPoints(
        tuple(map(str, model.points.ids.tolist())),
        model.points.coordinates,
        np.ones(len(model.points.ids), dtype=np.bool_),
    )
    known = model.points.errors[model.points.errors >= 0.0]
    stated = StatedError(float(known.mean()), "mean_of_points") if known.size else None
    cameras = tuple(map(_camera, model.cameras))
    rigs, exposures = exchanged_rigs(model)
    project = ExchangedProject(
        "", cameras, photos, points, rays, (READING,), stated=stated, rigs=rigs, exposures=exposures
    )
    return project, tuple(_notes(model, unknown))


def _camera(camera: ColmapCamera) -> ExchangedCamera:
    model = CAMERA_MODELS[camera.model]
    values = {
        name: value
        for parameter, value in zip(model.parameters, camera.parameters, strict=True)
        for name in _FOCAL.get(parameter, (parameter,))
    }
    free = tuple(name for name in values if name not in _NOT_FREE)
    return ExchangedCamera(str(camera.id), camera.columns, camera.rows, model.lens, values, camera.model, free=free)


def _rays(images: Sequence[ColmapImage], ids: IntArray) -> tuple[ExchangedRays, int]:
    """Return the rays, and how many are left out, as there is no such point."""
    photo = np.repeat(np.arange(len(images)), [len(image.points) for image in images])
    owner = np.concatenate([np.zeros(0, dtype=np.int64), *(image.points for image in images)])
    seen = np.flatnonzero(owner >= 0)
    point, is_known = places_of_ids(owner[seen], ids)
    kept = seen[is_known]
    image = np.concatenate([np.zeros((0, 2)), *(image.keypoints for image in images)])[kept]
    count = len(kept)
    rays = ExchangedRays(photo[kept], point[is_known], image, np.full(count, np.nan), np.ones(count, dtype=np.bool_))
    return rays, len(seen) - count


def places_of_ids(wanted: IntArray, ids: IntArray) -> tuple[IntArray, BoolArray]:
    """Return the places of wanted ids among ids, and which of them are there."""
    if not len(ids):
        return np.zeros(len(wanted), dtype=np.int64), np.zeros(len(wanted), dtype=np.bool_)
    order = np.argsort(ids, kind="stable")
    found = order[np.minimum(np.searchsorted(ids[order], wanted), len(ids) - 1)]
    return found, ids[found] == wanted


def _notes(model: ColmapModel, unknown: int) -> list[str]:
    notes = ["Colours of points, and keypoints that belong to no point, stay in the original."]
    if unknown:
        notes.append(f"{counted(unknown, 'ray')} left out, as there is no such point in points3D.")
    if _has_few_digits(model.points):
        notes.append(
            "Coordinates are large and have six digits, as COLMAP wrote them before version 3.8: export the model "
            "again, or use its binary files; what is imported has no more digits."
        )
    return notes


def _has_few_digits(points: ColmapPoints) -> bool:
    """Tell whether coordinates were rounded to six digits where that is too few."""
    large = points.coordinates[np.abs(points.coordinates) >= _MOST_DIGITS_LOST]
    if not large.size:
        return False
    step = 10.0 ** (np.floor(np.log10(np.abs(large))) - 5.0)
    return bool((np.abs(large / step - np.round(large / step)) < 1e-6).all())
