"""Commands that move the plates, and those of the control panel: guiding systems, locks, prisms, foot switches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from orip.multimodel.oriented_block import OrientedBlock
from orip.multimodel.photo_loop import DrivenPhoto, PlatePlace
from orip.multimodel.readout import object_position, status
from orip.multimodel.state import (
    GUIDES,
    MOST_EVENTS,
    SIDES,
    Condition,
    Event,
    Guide,
    Outcome,
    Position,
    ProcessorState,
    Rotation,
    Selected,
    Side,
    Status,
    active_model,
    driven,
    places_in_model,
    read_out,
    select_model,
)
from orip.records.drive_table import STAGES, DriveCode, DriveFault, Triple
from orip.records.photo import Stage
from orip.structs import replace

# All of them return the new state and a `Driven`, or the old state and a `DriveFault`: a movement that cannot be done
# moves nothing. Coordinates must be finite.

_NOT_DRIVEN = {
    DriveCode.BEHIND_CAMERA: "the point is not in front of photo {photo}",
    DriveCode.OUTSIDE_STAGE: "the point is outside the limits of the {stage} stage with photo {photo}",
    DriveCode.NOT_INVERTIBLE: "the point is beyond the radius up to which the distortion of photo {photo} is valid",
}


def drive_object(block: OrientedBlock, state: ProcessorState, xyz: Triple) -> Outcome:
    """Drive to a point of the object; the model changes where the point is not inside the active one.

    A locked plate stays where it is, and then the model does not change either.
    """
    select = select_model if state.switches else places_in_model
    return _driven_to(block, state, select(block, state.model, xyz), xyz)


def drive_model(block: OrientedBlock, state: ProcessorState, xyz: Triple) -> Outcome:
    """Drive to a point given in the axes of the active model, ground units."""
    return drive_object(block, state, active_model(block, state).object_of_model(*xyz))


def drive_plate(block: OrientedBlock, state: ProcessorState, stage: Stage, xy: Position) -> Outcome:
    """Drive one stage to plate coordinates; the model never changes."""
    return _plates_to(block, state, {stage: xy})


def drive_photo(block: OrientedBlock, state: ProcessorState, photo: str, xy: Position) -> Outcome:
    """Drive the stage of a photo, of whatever model, to photo coordinates (mm); the model never changes."""
    found = block.photo(photo)
    if found is None:
        return state, DriveFault(DriveCode.UNKNOWN_PHOTO, f"the table has no photo {photo}")
    return _plates_to(block, state, {found.stage: found.plate_of_photo(*xy)})


def move(block: OrientedBlock, state: ProcessorState, increments: Sequence[float]) -> Outcome:
    """Move by increments in the guiding system: two or three numbers, plate units, or ground units in MODEL and OBJECT.

    Wheels in MODEL and OBJECT go on from where the mark was driven to, or from where the rays meet after the plates
    were moved by themselves.
    """
    if state.guide in ("MODEL", "OBJECT"):
        return _move_mark(block, state, increments)
    if len(increments) != 2:
        text = f"guiding system {state.guide} moves in x and y; {len(increments)} increments were given"
        return state, DriveFault(DriveCode.WRONG_GUIDE, text)
    dx, dy = increments
    wanted = {}
    for stage in STAGES:
        if state.guide in (stage, "BOTH"):
            x, y = state.plate(stage)
            wanted[stage] = x + dx, y + dy
    return _plates_to(block, state, wanted)


def change_model(block: OrientedBlock, state: ProcessorState, name: str) -> Outcome:
    """Make a model the active one, at the same place of the object as far as the plates can be driven there.

    Where they cannot, they stay, the state is OUTSIDE, and the next movement in the object goes on from the mark.
    """
    index = block.model_index(name)
    if index is None:
        return state, DriveFault(DriveCode.UNKNOWN_MODEL, f"the table has no model {name}")
    return _change(block, state, index)


def next_model(block: OrientedBlock, state: ProcessorState) -> Outcome:
    """Change to the next model of the row, else to the first of the next row; after the last comes the first."""
    return _change(block, state, (state.model + 1) % len(block.models))


def forward(block: OrientedBlock, state: ProcessorState) -> Outcome:
    """Bring both plates to the front for mounting films: the middle in x, the lower end in y."""
    wanted = {}
    for stage in STAGES:
        limits = block.table.limits(stage)
        wanted[stage] = 0.5 * (limits.x_min + limits.x_max), limits.y_min
    after, reply = _plates_to(block, state, wanted)
    return (
        (state, reply) if isinstance(reply, DriveFault) else (replace(after, mark=state.mark, condition="LIMIT"), reply)
    )


def _driven_to(block: OrientedBlock, state: ProcessorState, selected: Selected, xyz: Triple) -> Outcome:
    photos = block.models[selected.model].photos
    plates = list(state.plates)
    for photo, place in zip(photos, selected.places, strict=True):
        if photo.stage == state.locked:
            continue
        if place.code != DriveCode.NONE:
            return state, _fault(photo, place)
        plates[STAGES.index(photo.stage)] = place.plate
    condition: Condition = "IN" if selected.inside else "OUTSIDE"
    upper, lower = plates
    after = ProcessorState(
        selected.model, (upper, lower), xyz, condition, state.guide, state.automatic, state.locked, state.prisms,
        state.events,
    )  # fmt: skip
    return after, driven(block, after)


def _fault(photo: DrivenPhoto, place: PlatePlace) -> DriveFault:
    return DriveFault(place.code, _NOT_DRIVEN[place.code].format(photo=photo.name, stage=photo.stage))


def _plates_to(block: OrientedBlock, state: ProcessorState, wanted: dict[Stage, Position]) -> Outcome:
    """Drive stages to plate coordinates, all or none."""
    if state.locked in wanted:
        text = f"the {state.locked} plate is locked; unlock it, or move the other one"
        return state, DriveFault(DriveCode.LOCKED, text)
    after = state
    for stage, (x, y) in wanted.items():
        limits = block.table.limits(stage)
        if not (limits.x_min <= x <= limits.x_max and limits.y_min <= y <= limits.y_max):
            text = f"the position is outside the limits of the {stage} stage"
            return state, DriveFault(DriveCode.OUTSIDE_STAGE, text)
        after = after.with_plate(stage, (x, y))
    after = replace(after, mark=None)
    after = replace(after, condition="IN" if _is_within_frames(block, after) else "OUTSIDE")
    return after, driven(block, after)


def _is_within_frames(block: OrientedBlock, state: ProcessorState) -> bool:
    return all(
        photo.frame_ratio(*photo.photo_of_plate(*state.plate(photo.stage))) <= 1.0
        for photo in active_model(block, state).photos
    )


def _move_mark(block: OrientedBlock, state: ProcessorState, increments: Sequence[float]) -> Outcome:
    dx, dy, dz = (*increments, 0.0)[:3]
    mark = state.mark
    if mark is None:
        found = object_position(block, state)
        if isinstance(found, DriveFault):
            return state, found
        mark = found.xyz
    if state.guide == "MODEL":
        dx, dy, dz = active_model(block, state).object_direction(dx, dy, dz)
    return drive_object(block, state, (mark[0] + dx, mark[1] + dy, mark[2] + dz))


def _change(block: OrientedBlock, state: ProcessorState, index: int) -> Outcome:
    mark = state.mark
    if mark is None:
        found = object_position(block, state)
        mark = None if isinstance(found, DriveFault) else found.xyz
    after = replace(state, model=index, mark=mark, condition="OUTSIDE")
    if mark is not None:
        moved, reply = _driven_to(block, after, places_in_model(block, index, mark), mark)
        if not isinstance(reply, DriveFault):
            return moved, reply
    return after, driven(block, after)


# A setting returns the new state and the `Status`, or the old state and a `DriveFault`.

KEYS = (*(str(number) for number in range(16)), "ENTER", "ZERO")
"""The keypad of four by four keys, and the two beside it."""

Setting = tuple[ProcessorState, Status | DriveFault]


def guide_named(word: str) -> Guide | None:
    """Return the guiding system of a word, its first letter or its number 1 to 5; None if it is none."""
    written = word.upper()
    for number, name in enumerate(GUIDES, start=1):
        if written in (name, name[0], str(number)):
            return name
    return None


def guide(block: OrientedBlock, state: ProcessorState, system: Guide) -> Setting:
    """Choose the guiding system."""
    return _set(block, replace(state, guide=system))


def automatic(block: OrientedBlock, state: ProcessorState, on: bool) -> Setting:
    """Let models change at frame lines, or not."""
    return _set(block, replace(state, automatic=on))


def lock(block: OrientedBlock, state: ProcessorState, side: Side | None) -> Setting:
    """Lock the plate of the active model's left or right photo; None unlocks.

    The plate stays locked when the model is changed: so a point is transferred from a photo of the strip beside. After
    unlocking, movements go on from where the rays meet, so that the plate that was locked does not jump.
    """
    if side is None:
        return _set(block, replace(state, locked=None, mark=None if state.locked else state.mark))
    stage = active_model(block, state).photos[SIDES.index(side)].stage
    return _set(block, replace(state, locked=stage))


def prism(block: OrientedBlock, state: ProcessorState, side: Side | Literal["BOTH"], degrees: float) -> Setting:
    """Turn what one eye or both see by 0 or 90 degrees (the side lap in stereo); no coordinate changes."""
    if degrees not in (0, 90):
        return state, DriveFault(DriveCode.BAD_KEYWORD, f"a prism turns by 0 or 90 degrees, not by {degrees:g}")
    rotation: Rotation = 90 if degrees == 90 else 0
    left, right = state.prisms
    return _set(
        block, replace(state, prisms=(left if side == "RIGHT" else rotation, right if side == "LEFT" else rotation))
    )


def foot(block: OrientedBlock, state: ProcessorState, side: Side) -> Setting:
    """Queue a foot switch; the right one with the read-out of both stages at this moment."""
    event = Event(side, plates=read_out(block, state)) if side == "RIGHT" else Event(side)
    return _set(block, _queued(state, event))


def key(block: OrientedBlock, state: ProcessorState, name: str) -> Setting:
    """Queue a key of the keypad: 0 to 15, ENTER or ZERO."""
    if name.upper() not in KEYS:
        return state, DriveFault(DriveCode.BAD_KEYWORD, f"'{name}' is not a key; allowed: 0 to 15, ENTER, ZERO")
    return _set(block, _queued(state, Event("KEY", name.upper())))


def next_event(state: ProcessorState) -> tuple[ProcessorState, Event | None]:
    """Take the oldest event out of the queue; None if there is none."""
    if not state.events:
        return state, None
    return replace(state, events=state.events[1:]), state.events[0]


def _queued(state: ProcessorState, event: Event) -> ProcessorState:
    return replace(state, events=(*state.events, event)[-MOST_EVENTS:])


def _set(block: OrientedBlock, state: ProcessorState) -> Setting:
    return state, status(block, state)
