"""Photos that are driven one by one: a drive table of models, each of one photo and an empty stage.

The plate processor knows models of two photos. A photo that has no partner is given one that does not exist: the same
camera beside it, on the other stage, where nothing lies. The mark then has a place in the object: movements keep its
height, or take it where they are told to, and the stage of the photo follows.
"""

from __future__ import annotations

from math import dist

import numpy as np

from orip.records.drive_table import DriveCamera, DriveModel, DrivePhoto, DriveTable, StageLimits, Triple
from orip.records.project.photo import Stage
from orip.structs import replace

EMPTY = "-EMPTY"
"""At the end of the name of what is not there."""

_BASE = 0.02
"""Of the distance to the object: the empty stage stays near the other, and the rays still meet under an angle."""


def with_empty_stages(table: DriveTable) -> DriveTable:
    """Return a table whose models have one photo, left and right, with an empty stage in the place of the right one.

    Parameters
    ----------
    table : DriveTable
        As `orip.multimodel.table.drive_table` makes it of such models.
    """
    cameras = {camera.name: camera for camera in table.cameras}
    distance = {photo.name: dist(photo.centre, table.start) for photo in table.photos}
    partners = tuple(_partner(photo, _BASE * distance[photo.name]) for photo in table.photos)
    used = tuple(dict.fromkeys(photo.camera for photo in table.photos))
    stage_of = {photo.name: photo.stage for photo in table.photos}
    return replace(
        table,
        upper=_limits(table.upper, table.lower, is_used="UPPER" in stage_of.values()),
        lower=_limits(table.lower, table.upper, is_used="LOWER" in stage_of.values()),
        cameras=(*table.cameras, *(_without_frame(cameras[name]) for name in used)),
        photos=(*table.photos, *partners),
        models=tuple(_model(model, stage_of[model.left]) for model in table.models),
    )


def _partner(photo: DrivePhoto, base: float) -> DrivePhoto:
    x_axis = np.array(photo.rotation).reshape(3, 3)[:, 0]
    x, y, z = (np.array(photo.centre) + base * x_axis).tolist()
    centre: Triple = (x, y, z)
    return replace(
        photo, name=f"{photo.name}{EMPTY}", camera=f"{photo.camera}{EMPTY}", template=None,
        stage=_other(photo.stage), centre=centre,
    )  # fmt: skip


def _without_frame(camera: DriveCamera) -> DriveCamera:
    """Return the camera of the partners: where the mark leaves the photo is for the photo to say."""
    return replace(camera, name=f"{camera.name}{EMPTY}", frame=(0.0, 0.0))


def _model(model: DriveModel, stage: Stage) -> DriveModel:
    return replace(model, right=f"{model.left}{EMPTY}", optics="NORMAL" if stage == "UPPER" else "SWAPPED")


def _limits(own: StageLimits, other: StageLimits, *, is_used: bool) -> StageLimits:
    """Return the limits of a stage, half as far again on each side: the empty one goes a little farther."""
    limits = own if is_used else other
    x, y = 0.5 * (limits.x_max - limits.x_min), 0.5 * (limits.y_max - limits.y_min)
    return StageLimits(limits.x_min - x, limits.x_max + x, limits.y_min - y, limits.y_max + y, limits.least_count)


def _other(stage: Stage) -> Stage:
    return "LOWER" if stage == "UPPER" else "UPPER"
