"""Commands of the control panel: guiding system, automatic switching, locks, prisms, foot switches and keys.

A setting returns the new state and the `Status`, or the old state and a `DriveFault`.
"""

from __future__ import annotations

from typing import Literal

from orip.multimodel.oriented_block import OrientedBlock
from orip.multimodel.readout import status
from orip.multimodel.state import (
    GUIDES,
    MOST_EVENTS,
    SIDES,
    Event,
    Guide,
    ProcessorState,
    Rotation,
    Side,
    Status,
    active_model,
    read_out,
)
from orip.records.drive_table import DriveCode, DriveFault
from orip.structs import replace

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
