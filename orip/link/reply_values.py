"""Reading the plate processor's replies: the inverse of `orip.link.replies`."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import wraps
from typing import Literal, NamedTuple, ParamSpec, TypeVar, cast

from orip.errors import LinkError
from orip.multimodel.readout import ObjectReadout, PhotoReadout
from orip.multimodel.state import Condition, Driven, Event, Guide, Position, Rotation, Side, Status
from orip.records.drive_table import Triple

_GREETING = re.compile(r"OK KDPP-EMU 1 (READY|EMPTY)(?: OBSERVER (.+))?")

P = ParamSpec("P")
T = TypeVar("T")


class Greeting(NamedTuple):
    """What a plate processor says first: whether a table is loaded, and who operates it if not this end."""

    state: Literal["READY", "EMPTY"]
    operator: str | None


class ProfilePoint(NamedTuple):
    """One step of a profile: a point of the object, and how it is driven to; None: it cannot be driven to."""

    xyz: Triple
    driven: Driven | None


def _reading(read: Callable[[str], T]) -> Callable[[str], T]:
    """Let a reader of replies raise `LinkError` where the reply is not of its form."""

    @wraps(read)
    def read_reply(reply: str) -> T:
        try:
            return read(reply)
        except (ValueError, IndexError) as error:
            message = f"the plate processor's reply '{reply[:80]}' cannot be read; is it of another version?"
            raise LinkError(message) from error

    return read_reply


def greeting_of(line: str) -> Greeting | None:
    """Read a greeting; None: it is none."""
    found = _GREETING.fullmatch(line)
    return Greeting("READY" if found[1] == "READY" else "EMPTY", found[2]) if found else None


@_reading
def driven_of(reply: str) -> Driven:
    """Read ``MODEL name UPPER x y LOWER x y``."""
    _, model, _, x1, y1, _, x2, y2 = reply.split()
    return Driven(model, (float(x1), float(y1)), (float(x2), float(y2)))


@_reading
def plates_of(reply: str) -> tuple[Position, Position]:
    """Read ``UPPER x y LOWER x y``."""
    _, x1, y1, _, x2, y2 = reply.split()
    return (float(x1), float(y1)), (float(x2), float(y2))


@_reading
def object_readout_of(reply: str) -> ObjectReadout:
    """Read ``X Y Z``, and ``PY p`` where the rays do not meet."""
    x, y, z, *rest = reply.split()
    return ObjectReadout((float(x), float(y), float(z)), float(rest[1]) if rest else 0.0)


@_reading
def photo_readouts_of(reply: str) -> tuple[PhotoReadout, PhotoReadout]:
    """Read ``LEFT photo x y RIGHT photo x y``."""
    _, left, x1, y1, _, right, x2, y2 = reply.split()
    return PhotoReadout(left, "LEFT", (float(x1), float(y1))), PhotoReadout(right, "RIGHT", (float(x2), float(y2)))


@_reading
def status_of(reply: str) -> Status:
    """Read ``MODEL m GUIDE g STATE s LOCK l PRISM a a AUTO a``."""
    _, model, _, guide, _, condition, _, lock, _, left, right, _, automatic, *_ = reply.split()
    return Status(
        model,
        cast("Guide", guide),
        cast("Condition", condition),
        None if lock == "NONE" else cast("Side", lock),
        (cast("Rotation", int(left)), cast("Rotation", int(right))),
        automatic == "ON",
    )


@_reading
def is_moving(reply: str) -> bool:
    """Tell of a status whether the stages are on their way."""
    return reply.split()[-2:] == ["MOVING", "YES"]


@_reading
def event_of(reply: str) -> Event | None:
    """Read ``NONE``, ``LEFT``, ``KEY k`` or ``RIGHT UPPER x y LOWER x y``."""
    kind, _, rest = reply.partition(" ")
    if kind == "NONE":
        return None
    if kind == "RIGHT":
        return Event("RIGHT", plates=plates_of(rest))
    if kind == "KEY":
        return Event("KEY", rest)
    if kind != "LEFT":
        raise ValueError(kind)
    return Event("LEFT")


@_reading
def profile_point_of(line: str) -> ProfilePoint:
    """Read ``X Y Z MODEL name UPPER x y LOWER x y`` or ``X Y Z ERR code text``."""
    x, y, z, rest = line.split(" ", 3)
    return ProfilePoint((float(x), float(y), float(z)), None if rest.startswith("ERR ") else driven_of(rest))
