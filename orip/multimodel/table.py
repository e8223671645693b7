"""The drive table of a solution: orientations, cameras and models, or photos that are driven one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import dist

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.local_frame import ground_system
from orip.geometry.plane import PlaneTransformation
from orip.geometry.rotation import rotation_from_angles
from orip.interior.additional_parameters import PARAMETER_SETS, base_of_camera
from orip.records.camera import READOUT, Camera
from orip.records.definition import StereoModel
from orip.records.drive_table import (
    STAGES,
    DriveCamera,
    DriveModel,
    DriveParameterSet,
    DrivePhoto,
    DriveTable,
    DriveTemplate,
    Optics,
    StageLimits,
    Triple,
)
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.records.photo import Photo, Stage
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

# With a coordinate reference system the project's coordinates are curved, and collinearity does not hold in them. The
# table's object system is then a local topocentric frame: x east, y north, z up, in the ground unit, at the median of
# the adjusted points; `object_ground` reproduces it from the same solution, to transform coordinates to it and back.
#
# Stage limits of films are 240 mm, the usual travel of a stage, around everything that is shown or was measured on that
# stage, and more if necessary; those of digital frames are the frame.

STAGE_TRAVEL_MM = 240.0
LEAST_COUNT = 0.001
"""Millimetres on film, pixels on a digital frame."""


class TableIngredients(Struct, frozen=True):
    """What a drive table is made from; mappings are by `record_key`.

    Parameters
    ----------
    solution : Solution
        Its photos are in the project's coordinates.
    models : tuple of StereoModel
        Those to be driven: both photos are in the solution, have an interior orientation, and are on different stages.
    cameras, photos : mappings
    stages : mapping to stage
        Of the photos in models.
    to_photo : mapping to PlaneTransformation
        Plate to photo, of the photos in models.
    ground : GroundSystem
        See `object_ground`.
    """

    solution: Solution
    models: tuple[StereoModel, ...]
    cameras: Mapping[str, Camera]
    photos: Mapping[str, Photo]
    stages: Mapping[str, Stage]
    to_photo: Mapping[str, PlaneTransformation]
    ground: GroundSystem

    def used_photos(self) -> tuple[Photo, ...]:
        """Return the photos of the models, in the order of the solution."""
        used = {record_key(name) for model in self.models for name in (model.left, model.right)}
        return tuple(self.photos[key] for key in map(record_key, self.solution.photos.names) if key in used)

    def used_cameras(self) -> tuple[Camera, ...]:
        """Return the cameras of these photos, in the order of the solution."""
        used = {record_key(photo.camera) for photo in self.used_photos()}
        return tuple(self.cameras[key] for key in map(record_key, self.solution.cameras.names) if key in used)


def object_ground(crs: str | None, ground_unit: str, solution: Solution) -> GroundSystem:
    """Return the object system of a solution's drive table: the project's own without a crs, else a local frame.

    Raises
    ------
    InputError
        If the crs does not fit, or a grid for its heights is missing.
    """
    return ground_system(crs, ground_unit, (), solution.points.values)


def frame_size(camera: Camera) -> tuple[float, float]:
    """Return the frame at whose lines models change, mm: the camera's, else that of its sensor, else none (zero)."""
    if camera.frame is not None:
        return camera.frame
    return (camera.sensor.width, camera.sensor.height) if camera.sensor is not None else (0.0, 0.0)


def drive_table(ingredients: TableIngredients) -> DriveTable:
    """Make the table; `table_faults` tells whether it can be driven with."""
    solution = ingredients.solution
    photos = ingredients.used_photos()
    in_order = sorted(ingredients.models, key=lambda model: (model.row, model.column))
    templates = {record_key(photo.template): photo for photo in photos if photo.template is not None}
    digital = any(ingredients.cameras[record_key(photo.camera)].sensor is not None for photo in photos)
    upper, lower = (_limits(ingredients, stage) for stage in STAGES)
    return DriveTable(
        block=record_key(solution.bundle),
        project=solution.project,
        user=solution.user,
        plate_unit="px" if digital else "mm",
        object_unit=solution.ground_unit,
        upper=upper,
        lower=lower,
        cameras=tuple(_camera(camera, solution) for camera in ingredients.used_cameras()),
        templates=tuple(
            DriveTemplate(name, ingredients.stages[record_key(photo.name)]) for name, photo in templates.items()
        ),
        photos=tuple(_photos(ingredients, photos)),
        models=tuple(_model(model, ingredients.stages) for model in in_order),
        start=_start(ingredients, in_order[0]),
    )


def _camera(camera: Camera, solution: Solution) -> DriveCamera:
    row = list(map(record_key, solution.cameras.names)).index(record_key(camera.name))
    return DriveCamera(
        record_key(camera.name),
        tuple(solution.cameras.values[row, :READOUT].tolist()),
        frame_size(camera),
        camera.distortion_at,
        _parameter_set(camera, solution),
        camera.projection,
    )


def _parameter_set(camera: Camera, solution: Solution) -> DriveParameterSet | None:
    key = record_key(camera.name)
    found = {estimate.name: estimate.value for estimate in solution.additional if record_key(estimate.camera) == key}
    for name, parameter_set in PARAMETER_SETS.items():
        if any(parameter in found for parameter in parameter_set.parameter_names):
            # a parameter that was held at zero is not among the estimates
            values = tuple(float(found.get(parameter, 0.0)) for parameter in parameter_set.parameter_names)
            return DriveParameterSet(name, base_of_camera(camera), values)
    return None


def _photos(ingredients: TableIngredients, photos: Sequence[Photo]) -> Iterator[DrivePhoto]:
    solution = ingredients.solution
    row_of = {record_key(name): row for row, name in enumerate(solution.photos.names)}
    adjusted = solution.photos.values[[row_of[record_key(photo.name)] for photo in photos]]
    centres = ingredients.ground.to_local(adjusted[:, :3])
    axes = np.swapaxes(ingredients.ground.axes_at(adjusted[:, :3]), 1, 2)
    rotations = axes @ rotation_from_angles(adjusted[:, 3:] * RADIANS_PER_DEGREE)
    for photo, centre, rotation in zip(photos, centres, rotations, strict=True):
        to_plate = ingredients.to_photo[record_key(photo.name)].inverse()
        yield DrivePhoto(
            record_key(photo.name),
            record_key(photo.camera),
            record_key(photo.template) if photo.template is not None else None,
            ingredients.stages[record_key(photo.name)],
            _triple(centre),
            tuple(rotation.ravel().tolist()),
            tuple(np.column_stack([to_plate.shift, to_plate.matrix]).ravel().tolist()),
        )


def _model(model: StereoModel, stages: Mapping[str, Stage]) -> DriveModel:
    left, right = record_key(model.left), record_key(model.right)
    optics: Optics = "NORMAL" if stages[left] == "UPPER" else "SWAPPED"
    return DriveModel(record_key(model.name), model.row, model.column, left, right, optics)


def _start(ingredients: TableIngredients, model: StereoModel) -> Triple:
    """Return the mean of the adjusted points that both photos of a model show, of all points where there are none."""
    found = ingredients.solution.residuals
    seen: dict[str, set[str]] = {record_key(model.left): set(), record_key(model.right): set()}
    for kind, photo, point in zip(found.kind, found.photo, found.point, strict=True):
        if kind == "photo" and record_key(photo) in seen:
            seen[record_key(photo)].add(point)
    both = set.intersection(*seen.values())
    points = ingredients.solution.points
    rows = [row for row, name in enumerate(points.names) if name in both]
    local = ingredients.ground.to_local(points.values[rows] if rows else points.values)
    return _triple(local[np.isfinite(local).all(axis=1)].mean(axis=0))


def _limits(ingredients: TableIngredients, stage: Stage) -> StageLimits:
    photos = [photo for photo in ingredients.used_photos() if ingredients.stages[record_key(photo.name)] == stage]
    cameras = [ingredients.cameras[record_key(photo.camera)] for photo in photos]
    if not photos:
        return _limits(ingredients, "LOWER" if stage == "UPPER" else "UPPER")
    sensors = [camera.sensor for camera in cameras if camera.sensor is not None]
    if sensors:
        columns, rows = max(sensor.columns for sensor in sensors), max(sensor.rows for sensor in sensors)
        return StageLimits(0.0, float(columns), 0.0, float(rows), LEAST_COUNT)
    shown = np.vstack(
        [_shown_on_plate(ingredients, *photo_and_camera) for photo_and_camera in zip(photos, cameras, strict=True)]
    )
    low, high = shown.min(axis=0), shown.max(axis=0)
    half_travel = np.maximum(high - low, STAGE_TRAVEL_MM) / 2.0
    x_min, y_min = np.floor((low + high) / 2.0 - half_travel).tolist()
    x_max, y_max = np.ceil((low + high) / 2.0 + half_travel).tolist()
    return StageLimits(x_min, x_max, y_min, y_max, LEAST_COUNT)


def _shown_on_plate(ingredients: TableIngredients, photo: Photo, camera: Camera) -> FloatArray:
    """Return where the corners of the frame and the measured points of a photo are on the plate, (n, 2)."""
    found = ingredients.solution.residuals
    rows = [
        row
        for row, (kind, name) in enumerate(zip(found.kind, found.photo, strict=True))
        if kind == "photo" and record_key(name) == record_key(photo.name)
    ]
    corners = np.array([(x, y) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]) * frame_size(camera)
    # x and y of a point follow each other
    points = found.observed[rows].reshape(-1, 2)
    return ingredients.to_photo[record_key(photo.name)].inverse().apply(np.vstack([corners, points]))


def _triple(values: FloatArray) -> Triple:
    x, y, z = values.tolist()
    return x, y, z


# The plate processor knows models of two photos. A photo that has no partner is given one that does not exist: the same
# camera beside it, on the other stage, where nothing lies. The mark then has a place in the object: movements keep its
# height, or take it where they are told to, and the stage of the photo follows.

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
        upper=_single_limits(table.upper, table.lower, is_used="UPPER" in stage_of.values()),
        lower=_single_limits(table.lower, table.upper, is_used="LOWER" in stage_of.values()),
        cameras=(*table.cameras, *(_without_frame(cameras[name]) for name in used)),
        photos=(*table.photos, *partners),
        models=tuple(_single_model(model, stage_of[model.left]) for model in table.models),
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


def _single_model(model: DriveModel, stage: Stage) -> DriveModel:
    return replace(model, right=f"{model.left}{EMPTY}", optics="NORMAL" if stage == "UPPER" else "SWAPPED")


def _single_limits(own: StageLimits, other: StageLimits, *, is_used: bool) -> StageLimits:
    """Return the limits of a stage, half as far again on each side: the empty one goes a little farther."""
    limits = own if is_used else other
    x, y = 0.5 * (limits.x_max - limits.x_min), 0.5 * (limits.y_max - limits.y_min)
    return StageLimits(limits.x_min - x, limits.x_max + x, limits.y_min - y, limits.y_max + y, limits.least_count)


def _other(stage: Stage) -> Stage:
    return "LOWER" if stage == "UPPER" else "UPPER"
