"""What each verb of the protocol does: ``verb(station, words) -> (station, reply)``, or `Refused`.

Words are those after the verb, and as many as the verb takes; a reply is what follows ``OK``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar, cast

from orip.multimodel import movement, readout
from orip.multimodel import movement as panel
from orip.multimodel.link.messages import (
    Refused,
    driven_text,
    event_text,
    keyword,
    limits_text,
    model_text,
    numbers,
    object_text,
    photos_text,
    plates_text,
    profile_lines,
    shown,
    status_text,
    three_numbers,
    two_numbers,
)
from orip.multimodel.link.station import Station, bare_stages
from orip.multimodel.readout import profile as drive_profile
from orip.multimodel.state import GUIDES, SIDES, Driven, ProcessorState, Side, Status
from orip.records.drive_table import STAGES, DriveCode, DriveFault
from orip.records.photo import Stage
from orip.structs import replace

T = TypeVar("T")

Words = Sequence[str]
Reply = str | list[str]
"""A line, or the lines of a list."""

Outcome = tuple[Station, Reply]
Verb = Callable[[Station, Words], Outcome]


def require_table(station: Station) -> None:
    """Refuse what takes an orientation where there is none."""
    if not station.is_ready:
        raise Refused(DriveCode.NO_TABLE, "no table is loaded; DOWNLOAD one first")


def clear(station: Station, _words: Words) -> Outcome:
    """Forget the table."""
    return bare_stages(is_paced=station.is_paced, stages=station.stages), "CLEARED"


def status(station: Station, _words: Words) -> Outcome:
    """Reply what is set."""
    return station, _status_text(station, readout.status(station.block, station.state))


def guide(station: Station, words: Words) -> Outcome:
    """Choose the guiding system."""
    system = panel.guide_named(words[0])
    if system is None:
        text = f"'{shown(words[0])}' is not a guiding system: {', '.join(GUIDES)}, their first letters, or 1 to 5"
        raise Refused(DriveCode.BAD_KEYWORD, text)
    if system in ("MODEL", "OBJECT"):
        require_table(station)
    return _set(station, panel.guide(station.block, station.state, system))


def drive(station: Station, words: Words) -> Outcome:
    """Drive in one of the systems."""
    block, state, rest = station.block, station.state, words[1:]
    system = keyword(words[0], "OBJECT", "MODEL", "PLATE", "PHOTO")
    if system == "PLATE":
        return _moved(station, movement.drive_plate(block, state, _stage(rest[0]), two_numbers(rest[1:])))
    require_table(station)
    if system == "PHOTO":
        return _moved(station, movement.drive_photo(block, state, shown(rest[0]), two_numbers(rest[1:])))
    drive_to = movement.drive_object if system == "OBJECT" else movement.drive_model
    return _moved(station, drive_to(block, state, three_numbers(rest)))


def move(station: Station, words: Words) -> Outcome:
    """Move by increments."""
    return _moved(station, movement.move(station.block, station.state, numbers(words)))


def forward(station: Station, _words: Words) -> Outcome:
    """Bring the plates to the front."""
    return _moved(station, movement.forward(station.block, station.state))


def change_model(station: Station, words: Words) -> Outcome:
    """Change to a model."""
    return _moved(station, movement.change_model(station.block, station.state, shown(words[0])))


def next_model(station: Station, _words: Words) -> Outcome:
    """Change to the next model."""
    return _moved(station, movement.next_model(station.block, station.state))


def position(station: Station, words: Words) -> Outcome:
    """Reply where the mark is in one of the systems."""
    block, state = station.block, station.shown
    system = keyword(words[0], "OBJECT", "MODEL", "PLATE", "PHOTO")
    if system == "PLATE":
        return station, plates_text(readout.plate_position(block, state))
    require_table(station)
    if system == "PHOTO":
        return station, photos_text(readout.photo_positions(block, state))
    find = readout.object_position if system == "OBJECT" else readout.model_position
    return station, object_text(_unless_fault(find(block, state)))


def which_model(station: Station, _words: Words) -> Outcome:
    """Reply the name of the active model."""
    return station, station.block.models[station.state.model].name


def models(station: Station, _words: Words) -> Outcome:
    """List the models."""
    return station, list(map(model_text, station.block.models))


def which(station: Station, words: Words) -> Outcome:
    """Reply which model a point would be driven to in."""
    return station, readout.which(station.block, station.state, three_numbers(words)) or "NONE"


def automatic(station: Station, words: Words) -> Outcome:
    """Let models change at frame lines, or not."""
    return _set(station, panel.automatic(station.block, station.state, keyword(words[0], "ON", "OFF") == "ON"))


def lock(station: Station, words: Words) -> Outcome:
    """Lock a photo's plate."""
    side = keyword(words[0], *SIDES, "NONE")
    return _set(station, panel.lock(station.block, station.state, None if side == "NONE" else cast("Side", side)))


def prism(station: Station, words: Words) -> Outcome:
    """Turn what the eyes see."""
    side = _side(words[0]) if len(words) == 2 else "BOTH"
    (degrees,) = numbers(words[-1:])
    return _set(station, panel.prism(station.block, station.state, side, degrees))


def foot(station: Station, words: Words) -> Outcome:
    """Press a foot switch: what it digitises is where the stages are now."""
    after, reply = panel.foot(station.block, station.shown, _side(words[0]))
    return _set(station, (replace(station.state, events=after.events), reply))


def key(station: Station, words: Words) -> Outcome:
    """Press a key."""
    return _set(station, panel.key(station.block, station.state, shown(words[0])))


def event(station: Station, _words: Words) -> Outcome:
    """Take the oldest event."""
    state, oldest = panel.next_event(station.state)
    return replace(station, state=state), event_text(oldest)


def profile(station: Station, words: Words) -> Outcome:
    """Drive along a line."""
    x1, y1, z1, x2, y2, z2, step = numbers(words)
    state, driven = drive_profile(station.block, station.state, (x1, y1, z1), (x2, y2, z2), step)
    found = _unless_fault(driven)
    return replace(station, state=state), list(profile_lines(station.block, found))


def limits(station: Station, words: Words) -> Outcome:
    """Reply the limits of a stage."""
    stage, table = _stage(words[0]), station.block.table
    return station, limits_text(stage, table.limits(stage), table.plate_unit)


def digest(station: Station, _words: Words) -> Outcome:
    """Reply the SHA-256 of the table."""
    return station, station.digest


def _moved(station: Station, outcome: tuple[ProcessorState, Driven | DriveFault]) -> Outcome:
    state, reply = outcome
    return replace(station, state=state), driven_text(_unless_fault(reply))


def _set(station: Station, outcome: tuple[ProcessorState, Status | DriveFault]) -> Outcome:
    state, reply = outcome
    return replace(station, state=state), _status_text(station, _unless_fault(reply))


def _status_text(station: Station, found: Status) -> str:
    return status_text(found, station.on_the_way is not None if station.is_paced else None)


def _unless_fault(reply: T | DriveFault) -> T:
    if isinstance(reply, DriveFault):
        raise Refused(*reply)
    return reply


def _stage(word: str) -> Stage:
    return cast("Stage", keyword(word, *STAGES))


def _side(word: str) -> Side:
    return cast("Side", keyword(word, *SIDES))
