"""Reading the plate processor: status, positions, and which model would be chosen. Nothing here changes the state."""

from __future__ import annotations

from typing import NamedTuple

from orip.multimodel.oriented_block import OrientedBlock
from orip.multimodel.state import SIDES, Position, ProcessorState, Side, Status, active_model, read_out
from orip.multimodel.switching import select_model
from orip.records.drive_table import STAGES, DriveCode, DriveFault, Triple


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
