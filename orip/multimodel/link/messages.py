"""Requests and replies of the protocol as text: words to numbers, replies written, and read again at the host's end."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import wraps
from typing import Literal, NamedTuple, ParamSpec, TypeVar, cast

import numpy as np

from orip.errors import LinkError
from orip.multimodel.oriented_block import ModelLoop, OrientedBlock
from orip.multimodel.readout import DrivenPoints, ObjectReadout, PhotoReadout
from orip.multimodel.state import Condition, Driven, Event, Guide, Position, Rotation, Side, Status
from orip.records.drive_table import DriveCode, DriveFault, DriveTable, StageLimits, Triple

LONGEST_REQUEST = 512
"""Bytes of a request without the end of its line."""

LARGEST_NUMBER = 1e11
"""Beyond this a number in double precision does not have the four decimals of a reply."""

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")

_SHOWN = 40


class Refused(Exception):  # noqa: N818  # what the protocol does with a request
    """A request cannot be done; carries the fault that is the reply."""

    def __init__(self, code: DriveCode, text: str) -> None:
        super().__init__(text)
        self.fault = DriveFault(code, text)


class Request(NamedTuple):
    """A verb in upper case, and the words after it as they were written."""

    verb: str
    words: tuple[str, ...]


def read_request(line: bytes) -> Request:
    """Read a line, without its end; raises `Refused` if it is too long or has no verb."""
    if len(line) > LONGEST_REQUEST:
        raise Refused(DriveCode.LINE_TOO_LONG, f"a request has at most {LONGEST_REQUEST} bytes")
    words = line.decode("ascii", errors="replace").split()
    if not words:
        raise Refused(DriveCode.UNKNOWN_VERB, "the line is empty; HELP lists the verbs")
    return Request(words[0].upper(), tuple(words[1:]))


def numbers(words: Sequence[str]) -> tuple[float, ...]:
    """Read finite decimal numbers."""
    return tuple(map(_number, words))


def three_numbers(words: Sequence[str]) -> tuple[float, float, float]:
    """Read three numbers."""
    x, y, z = map(_number, words)
    return x, y, z


def two_numbers(words: Sequence[str]) -> tuple[float, float]:
    """Read two numbers."""
    x, y = map(_number, words)
    return x, y


def whole_number(word: str) -> int:
    """Read a number of lines."""
    if not (word.isascii() and word.isdecimal() and len(word) < 19):
        raise Refused(DriveCode.NOT_A_NUMBER, f"'{shown(word)}' is not a whole number")
    return int(word)


def keyword(word: str, *allowed: str) -> str:
    """Return one of the words that are allowed, in upper case."""
    written = word.upper()
    if written not in allowed:
        raise Refused(DriveCode.BAD_KEYWORD, f"'{shown(word)}' is none of {', '.join(allowed)}")
    return written


def shown(word: str) -> str:
    """Return a word as a reply may contain it."""
    plain = "".join(character if character.isascii() and character.isprintable() else "?" for character in word)
    return plain if len(plain) <= _SHOWN else f"{plain[:_SHOWN]}..."


def _number(word: str) -> float:
    if _NUMBER.fullmatch(word) is None:
        raise Refused(DriveCode.NOT_A_NUMBER, f"'{shown(word)}' is not a number; write for example 12.345")
    value = float(word)
    if abs(value) >= LARGEST_NUMBER:
        raise Refused(DriveCode.NOT_A_NUMBER, f"'{shown(word)}' is too large; numbers are below {LARGEST_NUMBER:g}")
    return value


_NO_PARALLAX = 0.00005
"""mm: what prints as 0.0000."""

_LONGEST_TEXT = 300


def error_line(fault: DriveFault) -> str:
    """Return the line of a refusal."""
    text = fault.text.encode("ascii", errors="replace").decode("ascii")
    return f"ERR {int(fault.code)} {' '.join(map(_printable, text.split()))[:_LONGEST_TEXT]}"


def driven_text(driven: Driven) -> str:
    """Return ``MODEL name UPPER x y LOWER x y``."""
    return f"MODEL {driven.model} {plates_text((driven.upper, driven.lower))}"


def plates_text(plates: tuple[Position, Position]) -> str:
    """Return ``UPPER x y LOWER x y``."""
    (x1, y1), (x2, y2) = plates
    return f"UPPER {x1:z.4f} {y1:z.4f} LOWER {x2:z.4f} {y2:z.4f}"


def status_text(status: Status, is_moving: bool | None) -> str:
    """Return what is set; MOVING only where travel takes time."""
    left, right = status.prisms
    moving = "" if is_moving is None else f" MOVING {'YES' if is_moving else 'NO'}"
    return (
        f"MODEL {status.model} GUIDE {status.guide} STATE {status.condition} LOCK {status.lock or 'NONE'} "
        f"PRISM {left} {right} AUTO {'ON' if status.automatic else 'OFF'}{moving}"
    )


def object_text(readout: ObjectReadout) -> str:
    """Return ``X Y Z``, and ``PY p`` where the rays do not meet."""
    x, y, z = readout.xyz
    parallax = f" PY {readout.y_parallax:z.4f}" if abs(readout.y_parallax) >= _NO_PARALLAX else ""
    return f"{x:z.4f} {y:z.4f} {z:z.4f}{parallax}"


def photos_text(readouts: Sequence[PhotoReadout]) -> str:
    """Return ``LEFT photo x y RIGHT photo x y``."""
    return " ".join(f"{readout.side} {readout.photo} {readout.xy[0]:z.4f} {readout.xy[1]:z.4f}" for readout in readouts)


def event_text(event: Event | None) -> str:
    """Return ``NONE``, ``LEFT``, ``KEY k`` or ``RIGHT UPPER x y LOWER x y``."""
    if event is None:
        return "NONE"
    if event.plates is not None:
        return f"{event.kind} {plates_text(event.plates)}"
    return f"{event.kind} {event.key}".rstrip()


def model_text(model: ModelLoop) -> str:
    """Return name, row, column, left photo, right photo and optics."""
    left, right = model.photos
    optics = "SWAPPED" if model.swapped else "NORMAL"
    return f"{model.name} {model.row} {model.column} {left.name} {right.name} {optics}"


def limits_text(stage: str, limits: StageLimits, unit: str) -> str:
    """Return ``stage x-min x-max y-min y-max LEAST count UNIT unit``."""
    borders = (limits.x_min, limits.x_max, limits.y_min, limits.y_max)
    return f"{stage} {' '.join(f'{value:z.4f}' for value in borders)} LEAST {limits.least_count:.4f} UNIT {unit}"


def loaded_text(table: DriveTable) -> str:
    """Return how much was loaded."""
    return f"LOADED cameras {len(table.cameras)} photos {len(table.photos)} models {len(table.models)}"


def profile_lines(block: OrientedBlock, driven: DrivenPoints) -> Iterator[str]:
    """Yield ``X Y Z MODEL name UPPER x y LOWER x y`` for each point, ``X Y Z ERR code`` where it is not driven to."""
    upper, lower = (
        (np.round(plate / limits.least_count) * limits.least_count).tolist()
        for plate, limits in ((driven.upper, block.table.upper), (driven.lower, block.table.lower))
    )
    rows = zip(driven.xyz.tolist(), driven.model.tolist(), driven.code.tolist(), upper, lower, strict=True)
    for (x, y, z), model, code, at_upper, at_lower in rows:
        reply = f"ERR {code}" if code else driven_text(Driven(block.models[model].name, at_upper, at_lower))
        yield f"{x:z.4f} {y:z.4f} {z:z.4f} {reply}"


def _printable(word: str) -> str:
    return word if word.isprintable() else shown(word)


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
