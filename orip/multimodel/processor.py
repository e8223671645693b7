"""The plate processor loads a drive table as a whole or not at all: all that has to agree before a stage may move."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from orip.interior.additional_parameters import PARAMETER_SETS
from orip.multimodel.movement import drive_object
from orip.multimodel.oriented_block import OrientedBlock, model_axes, oriented_block
from orip.multimodel.photo_loop import camera_model
from orip.multimodel.state import Position, ProcessorState
from orip.records.drive_table import (
    DriveCamera,
    DriveCode,
    DriveFault,
    DriveModel,
    DrivePhoto,
    DriveTable,
    StageLimits,
)
from orip.records.names import name_fault, record_key
from orip.records.photo import Stage

ORTHONORMAL = 1e-9
"""Largest difference of R^T R from the unit matrix; 0.2 µm in a photo of 230 mm."""

_NO_INVERSE = 1e-9
"""Smallest area of the unit square on the plate, as a part of the product of its sides."""

_GRID = 65
"""Places along each side of a frame where the distortion is tested; a polynomial of the seventh degree has at most
three turning points between the middle and the border."""


def table_faults(table: DriveTable) -> tuple[DriveFault, ...]:
    """Return everything that is wrong in a table; empty: it can be driven with."""
    with np.errstate(all="ignore"):  # a file may have any numbers; those that overflow are beyond the limits
        return tuple(_all_faults(table))


def drivable_name_fault(name: str) -> str | None:
    """Say what keeps a name from being a drive table's, or return None; a table is ASCII in upper case."""
    fault = name_fault(name)
    if fault is None and not name.isascii():
        fault = f"'{name}' has a letter that is not ASCII"
    if fault is None and name != record_key(name):
        fault = f"'{name}' is not in upper case"
    return fault


def _all_faults(table: DriveTable) -> Iterator[DriveFault]:
    fault = drivable_name_fault(table.block)
    if fault is not None:
        yield _fault(f"block: {fault}")
    yield from _name_faults(table)
    yield from _limit_faults(table)
    for camera in table.cameras:
        yield from _camera_faults(camera)
    cameras = {camera.name for camera in table.cameras}
    stages = {template.name: template.stage for template in table.templates}
    for photo in table.photos:
        yield from _photo_faults(photo, cameras, stages)
    yield from _place_faults(table.models)
    photos = {photo.name: photo for photo in table.photos}
    for model in table.models:
        yield from _model_faults(model, photos)
    if not table.models:
        yield _fault("there is no model")


def _fault(text: str) -> DriveFault:
    return DriveFault(DriveCode.TABLE_INCONSISTENT, text)


def _name_faults(table: DriveTable) -> Iterator[DriveFault]:
    kinds = (
        ("camera", table.cameras),
        ("template", table.templates),
        ("photo", table.photos),
        ("model", table.models),
    )
    for kind, records in kinds:
        seen: set[str] = set()
        for record in records:
            fault = drivable_name_fault(record.name)
            if fault is not None:
                yield _fault(f"{kind}: {fault}")
            if record.name in seen:
                yield _fault(f"{kind} {record.name} is there twice")
            seen.add(record.name)


def _limit_faults(table: DriveTable) -> Iterator[DriveFault]:
    for name, limits in (("UPPER", table.upper), ("LOWER", table.lower)):
        if not (limits.x_min < limits.x_max and limits.y_min < limits.y_max):
            yield _fault(f"the {name} stage has no area between its limits")
        if not limits.least_count > 0.0:
            yield _fault(f"the {name} stage has the least count {limits.least_count:g}; it must be greater than 0")
        elif not _countable(limits):
            yield _fault(f"the {name} stage's limits are too far for its least count")


def _countable(limits: StageLimits) -> bool:
    """Tell whether positions can be written as numbers of least counts."""
    farthest = max(map(abs, (limits.x_min, limits.x_max, limits.y_min, limits.y_max)))
    return math.isfinite(farthest / limits.least_count)


def _camera_faults(camera: DriveCamera) -> Iterator[DriveFault]:
    where = f"camera {camera.name}"
    if not camera.parameters[0] > 0.0:
        yield _fault(f"{where} has C = {camera.parameters[0]:g}; it must be greater than 0")
        return
    if min(camera.frame) < 0.0:
        yield _fault(f"{where} has a negative frame size")
        return
    if camera.additional is not None:
        wanted = len(PARAMETER_SETS[camera.additional.name].parameter_names)
        if not camera.additional.base > 0.0:
            yield _fault(f"{where} has a parameter set with the base {camera.additional.base:g}")
            return
        if len(camera.additional.values) != wanted:
            yield _fault(f"{where} has {len(camera.additional.values)} parameters of {wanted}")
            return
    if not _is_one_to_one(camera):
        yield _fault(f"{where} has a distortion that is not monotone over the frame")


def _is_one_to_one(camera: DriveCamera) -> bool:
    """Tell whether no two points of the frame are imaged at one place; only at its middle, where no frame is given."""
    model = camera_model(camera)
    side = np.linspace(-0.5, 0.5, _GRID)
    x, y = (grid.ravel() for grid in np.meshgrid(side * camera.frame[0], side * camera.frame[1]))
    return model.is_one_to_one(x - model.image.x0, y - model.image.y0)


def _photo_faults(photo: DrivePhoto, cameras: set[str], stages: dict[str, Stage]) -> Iterator[DriveFault]:
    where = f"photo {photo.name}"
    if photo.camera not in cameras:
        yield _fault(f"{where} refers to camera {photo.camera}, which is not in the table")
    if photo.template is not None:
        if photo.template not in stages:
            yield _fault(f"{where} refers to template {photo.template}, which is not in the table")
        elif stages[photo.template] != photo.stage:
            yield _fault(f"{where} is on the {photo.stage} stage, its template {photo.template} on the other one")
    rotation = np.array(photo.rotation).reshape(3, 3)
    misfit = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if not misfit <= ORTHONORMAL:
        yield _fault(f"{where} has a rotation matrix that is not orthonormal, by {misfit:.1e}")
    elif np.linalg.det(rotation) < 0.0:
        yield _fault(f"{where} has a rotation matrix that is a mirror image")
    _, a1, a2, _, b1, b2 = photo.affine
    sides = math.hypot(a1, b1) * math.hypot(a2, b2)
    if not abs(a1 * b2 - a2 * b1) > _NO_INVERSE * sides:
        yield _fault(f"{where} has an affine transformation without an inverse")


def _place_faults(models: Sequence[DriveModel]) -> Iterator[DriveFault]:
    first: dict[tuple[int, int], str] = {}
    for model in models:
        if model.row < 1 or model.column < 1:
            yield _fault(f"model {model.name} is at row {model.row}, column {model.column}; both count from 1")
        other = first.setdefault((model.row, model.column), model.name)
        if other != model.name:
            yield _fault(f"models {other} and {model.name} are both at row {model.row}, column {model.column}")


def _model_faults(model: DriveModel, photos: dict[str, DrivePhoto]) -> Iterator[DriveFault]:
    where = f"model {model.name}"
    missing = [name for name in dict.fromkeys((model.left, model.right)) if name not in photos]
    if missing:
        yield from (_fault(f"{where} refers to photo {name}, which is not in the table") for name in missing)
        return
    left, right = photos[model.left], photos[model.right]
    if left.stage == right.stage:
        text = f"{where}: photos {left.name} and {right.name} are both on the {left.stage} stage"
        yield DriveFault(DriveCode.ONE_STAGE, text)
        return
    optics = "NORMAL" if left.stage == "UPPER" else "SWAPPED"
    if model.optics != optics:
        yield _fault(f"{where} has {model.optics} optics, but its left photo is on the {left.stage} stage: {optics}")
    if model_axes(left, right) is None:
        yield _fault(f"{where} has no base across its viewing direction: no stereo can be seen")


class Loaded(NamedTuple):
    """A table that has been loaded: the block, and the state to begin with."""

    block: OrientedBlock
    state: ProcessorState


def load(table: DriveTable) -> Loaded | tuple[DriveFault, ...]:
    """Load a table; if anything is wrong in it, all faults are returned."""
    faults = table_faults(table)
    if faults:
        return faults
    with np.errstate(all="ignore"):  # a table may have numbers of any size, as long as they agree
        block = oriented_block(table)
        return Loaded(block, first_state(block))


def first_state(block: OrientedBlock) -> ProcessorState:
    """Return the state after loading: the first model, driven to START; in the middle of the stages if that fails."""
    middles: list[Position] = [
        (0.5 * (limits.x_min + limits.x_max), 0.5 * (limits.y_min + limits.y_max))
        for limits in (block.table.upper, block.table.lower)
    ]
    upper, lower = middles
    state, _ = drive_object(block, ProcessorState(0, (upper, lower), None, "OUTSIDE"), block.table.start)
    return state
