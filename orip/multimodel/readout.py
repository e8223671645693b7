"""What is read of the plate processor, and driving to many points computed at once: nothing here changes its state."""

from __future__ import annotations

from math import dist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.multimodel.oriented_block import OrientedBlock
from orip.multimodel.state import (
    SIDES,
    Position,
    ProcessorState,
    SelectedModels,
    Side,
    Status,
    active_model,
    inside_model,
    read_out,
    select_model,
    select_models,
)
from orip.records.drive_table import STAGES, DriveCode, DriveFault, Triple
from orip.structs import replace


class ObjectReadout(NamedTuple):
    """Coordinates in the object or in the model, and the y-parallax (mm in the photo) that the two rays leave."""

    xyz: Triple
    y_parallax: float


class PhotoReadout(NamedTuple):
    """Where the measuring mark is in one photo, mm in the fiducial system."""

    photo: str
    side: Side
    xy: Position


_NO_PLACE = {
    DriveCode.BEHIND_CAMERA: "the rays of the two plates diverge: they would meet behind a camera",
    DriveCode.NOT_INVERTIBLE: "the camera's distortion has no inverse at a plate's position",
    DriveCode.PARALLEL_RAYS: "the rays of the two plates are parallel",
}


def status(block: OrientedBlock, state: ProcessorState) -> Status:
    """Return what is set."""
    model = active_model(block, state)
    sides = [side for side, photo in zip(SIDES, model.photos, strict=True) if photo.stage == state.locked]
    lock = sides[0] if sides else None
    return Status(model.name, state.guide, state.condition, lock, state.prisms, state.automatic)


def object_position(block: OrientedBlock, state: ProcessorState) -> ObjectReadout | DriveFault:
    """Return where the two rays meet, ground units: whatever moved the plates, this is what they show."""
    found = active_model(block, state).object_place(*state.plates)
    if found.code != DriveCode.NONE:
        return DriveFault(found.code, _NO_PLACE[found.code])
    return ObjectReadout(found.xyz, found.y_parallax)


def model_position(block: OrientedBlock, state: ProcessorState) -> ObjectReadout | DriveFault:
    """Return where the two rays meet in the axes of the active model, ground units."""
    found = object_position(block, state)
    if isinstance(found, DriveFault):
        return found
    return found._replace(xyz=active_model(block, state).model_of_object(*found.xyz))


def plate_position(block: OrientedBlock, state: ProcessorState) -> tuple[Position, Position]:
    """Return the read-out of the upper and the lower stage, rounded to their least counts."""
    return read_out(block, state)


def photo_positions(block: OrientedBlock, state: ProcessorState) -> tuple[PhotoReadout, PhotoReadout]:
    """Return where the mark is in the left and in the right photo of the active model."""
    left, right = (
        PhotoReadout(photo.name, side, photo.photo_of_plate(*state.plates[STAGES.index(photo.stage)]))
        for side, photo in zip(SIDES, active_model(block, state).photos, strict=True)
    )
    return left, right


def which(block: OrientedBlock, state: ProcessorState, xyz: Triple) -> str | None:
    """Return the model that a point would be driven to in, coming from the active one; None where none shows it."""
    found = select_model(block, state.model, xyz)
    return block.models[found.model].name if found.inside else None


# The active model depends on the point before, so that the order of points matters; all else does not.

MOST_PROFILE_POINTS = 10_000


class DrivenPoints(NamedTuple):
    """What driving to n points gives.

    Attributes
    ----------
    xyz : array (n, 3)
        The points.
    model : array (n,) of int
        Place of the active model in the block after each point.
    upper, lower : arrays (n, 2)
        Plate positions, unrounded; NaN where the code is not 0: the plates then stay where they were.
    inside : array (n,) of bool
        The point is inside its model.
    code : array (n,) of int
        A `DriveCode` for each point.
    """

    xyz: FloatArray
    model: NDArray[np.int64]
    upper: FloatArray
    lower: FloatArray
    inside: NDArray[np.bool_]
    code: NDArray[np.int64]


def drive_objects(block: OrientedBlock, state: ProcessorState, xyz: FloatArray) -> tuple[ProcessorState, DrivenPoints]:
    """Drive to points (n, 3) of the object one after the other: `drive_object`, n times.

    Parameters
    ----------
    state : ProcessorState
        With its locks, and automatic switching on or off.
    xyz : array (n, 3)
        Finite, ground units.

    Returns
    -------
    state : ProcessorState
        At the last point that could be driven to.
    driven : DrivenPoints
    """
    with np.errstate(all="ignore"):  # a point may be so far away that numbers overflow: it is then outside
        driven = _driven(block, state, xyz)
    return _state_after(state, driven), driven


def profile(
    block: OrientedBlock, state: ProcessorState, start: Triple, end: Triple, step: float
) -> tuple[ProcessorState, DrivenPoints | DriveFault]:
    """Drive along the line between two points in equal steps, from the start to the end; both are driven to.

    Parameters
    ----------
    start, end : tuple (X, Y, Z)
    step : float
        Ground units; the last step may be shorter.
    """
    length = dist(start, end)
    if not step > 0.0:
        return state, DriveFault(DriveCode.BAD_KEYWORD, f"a profile goes in steps greater than 0, not {step:g}")
    if not length / step <= MOST_PROFILE_POINTS - 1:
        text = f"the profile has more than {MOST_PROFILE_POINTS} points; take a longer step, or divide it"
        return state, DriveFault(DriveCode.BAD_KEYWORD, text)
    # a last step that is nothing but rounding is left out
    steps = int(np.ceil(length / step * (1.0 - 1e-12)))
    along = np.minimum(np.arange(steps + 1) * step, length)
    direction = np.subtract(end, start) / max(length, 1e-300)
    return drive_objects(block, state, np.array(start) + along[:, None] * direction)


def _driven(block: OrientedBlock, state: ProcessorState, xyz: FloatArray) -> DrivenPoints:
    selected = _selected(block, state, xyz)
    code = np.zeros(len(xyz), dtype=np.int64)
    plates = np.empty((2, len(xyz), 2))
    for side in (1, 0):  # of two faults the left photo's is reported
        shown_in = np.array([(model.left, model.right)[side] for model in block.models])[selected.model]
        for place in np.unique(shown_in).tolist():
            photo, mine = block.photos[place], np.flatnonzero(shown_in == place)
            stage = STAGES.index(photo.stage)
            if photo.stage == state.locked:
                plates[stage, mine] = state.plates[stage]
                continue
            found = photo.plate_places(xyz[mine])
            plates[stage, mine] = found.plate
            code[mine] = np.where(found.code != DriveCode.NONE, found.code, code[mine])
    plates[:, code != DriveCode.NONE] = np.nan
    return DrivenPoints(xyz, selected.model, plates[0], plates[1], selected.inside, code)


def _selected(block: OrientedBlock, state: ProcessorState, xyz: FloatArray) -> SelectedModels:
    if state.switches:
        return select_models(block, state.model, xyz)
    return SelectedModels(np.full(len(xyz), state.model), inside_model(block, state.model, xyz))


def _state_after(state: ProcessorState, driven: DrivenPoints) -> ProcessorState:
    done = np.flatnonzero(driven.code == DriveCode.NONE)
    if not len(done):
        return state
    last = int(done[-1])
    upper, lower, mark = (tuple(values[last].tolist()) for values in (driven.upper, driven.lower, driven.xyz))
    return replace(
        state,
        model=int(driven.model[last]),
        plates=(upper, lower),
        mark=mark,
        condition="IN" if driven.inside[last] else "OUTSIDE",
    )
