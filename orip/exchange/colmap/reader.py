"""A model of COLMAP as a project to be imported."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from orip.arrays import BoolArray, IntArray
from orip.exchange.colmap.database import pose_priors
from orip.exchange.colmap.folder import form_of, model_folder, read_folder
from orip.exchange.colmap.model import CAMERA_MODELS, ColmapCamera, ColmapImage, ColmapModel, ColmapPoints
from orip.files.text.shown import Parsed
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
    project = ExchangedProject("", cameras, photos, points, rays, (READING,), stated=stated)
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
    order = np.argsort(ids, kind="stable")
    photos, points, places = [], [], []
    unknown = 0
    for number, image in enumerate(images):
        seen = np.flatnonzero(image.points >= 0)
        found, is_known = _places(image.points[seen], ids, order)
        unknown += int((~is_known).sum())
        photos.append(np.full(is_known.sum(), number, dtype=np.int64))
        points.append(found[is_known])
        places.append(image.keypoints[seen[is_known]])
    count = sum(map(len, photos))
    rays = ExchangedRays(
        np.concatenate(photos) if photos else np.zeros(0, dtype=np.int64),
        np.concatenate(points) if points else np.zeros(0, dtype=np.int64),
        np.concatenate(places) if places else np.zeros((0, 2)),
        np.full(count, np.nan),
        np.ones(count, dtype=np.bool_),
    )
    return rays, unknown


def _places(wanted: IntArray, ids: IntArray, order: IntArray) -> tuple[IntArray, BoolArray]:
    """Return the places of wanted ids among ids, and which of them are there."""
    if not len(ids):
        return np.zeros(len(wanted), dtype=np.int64), np.zeros(len(wanted), dtype=np.bool_)
    found = order[np.minimum(np.searchsorted(ids[order], wanted), len(ids) - 1)]
    return found, ids[found] == wanted


def _notes(model: ColmapModel, unknown: int) -> list[str]:
    notes = ["Colours of points, and keypoints that belong to no point, stay in the original."]
    if unknown:
        notes.append(f"{counted(unknown, 'ray')} left out, as there is no such point in points3D.")
    if any(count > 1 for count in model.sensors_of_rigs):
        notes.append("Cameras of a rig are oriented independently: orip knows no rigs.")
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
