"""`orip drive guide`, `move`, `lock` …: what the operator does at the panel, also beside a running `orip digitise`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from orip.cli.drive.link import DEFAULT_LINK, NEGATIVE_NUMBERS, Link, tell_driven
from orip.cli.options import Invocation, command
from orip.errors import UsageError

if TYPE_CHECKING:
    from orip.link.client import PlateProcessorLink
    from orip.multimodel.state import Status

System = Annotated[
    str, typer.Argument(metavar="SYSTEM", help="upper, lower, both, model or object; the first letter, or 1 to 5.")
]
Increments = Annotated[
    list[float], typer.Argument(metavar="D1 D2 [D3]", help="Increments, mm or ground units.", show_default=False)
]
LockedSide = Annotated[
    Literal["left", "right", "none"],
    typer.Argument(metavar="SIDE", case_sensitive=False, help="The plate that stays; none: both move."),
]
Degrees = Annotated[Literal["0", "90"], typer.Argument(metavar="DEGREES", help="90, and 0 back.")]
PrismSide = Annotated[
    Literal["left", "right"] | None, typer.Argument(metavar="SIDE", case_sensitive=False, help="Default: both.")
]
Foot = Annotated[
    Literal["left", "right"], typer.Argument(metavar="SIDE", case_sensitive=False, help="The foot switch.")
]
Key = Annotated[str, typer.Argument(metavar="KEY", help="0 to 15, ENTER or ZERO.")]


def register(drive: typer.Typer) -> None:
    """Add the commands to the group."""
    command(drive, "guide")(guide_command)
    command(drive, "move", **NEGATIVE_NUMBERS)(move_command)
    command(drive, "lock")(lock_command)
    command(drive, "prism")(prism_command)
    command(drive, "foot")(foot_command)
    command(drive, "key")(key_command)


def guide_command(invocation: Invocation, system: System, link: Link = DEFAULT_LINK) -> None:
    """Choose what movements guide: one plate, both, or the mark along the axes of the model or of the object.

    Example: orip drive guide object
    """
    _set(invocation, "guide", link, lambda processor: processor.guide(system.upper()))  # type: ignore[arg-type]  # the processor knows abbreviations


def move_command(invocation: Invocation, increments: Increments, link: Link = DEFAULT_LINK) -> None:
    """Move by increments in the guiding system: x y of plates (mm), x y z of the model or the object (ground units).

    Example: orip drive move 0.05 -0.02
    """
    from orip.link.client import open_link

    if not 2 <= len(increments) <= 3:
        message = f"a movement has two or three increments, not {len(increments)}"
        raise UsageError(message)
    with open_link(link) as processor:
        tell_driven(invocation, "move", processor.move(*increments), processor.status().condition)


def lock_command(invocation: Invocation, side: LockedSide, link: Link = DEFAULT_LINK) -> None:
    """Lock the plate of the left or the right photo, or none.

    Example: orip drive lock left
    """
    words: dict[str, Literal["LEFT", "RIGHT"]] = {"left": "LEFT", "right": "RIGHT"}
    _set(invocation, "lock", link, lambda processor: processor.lock(words.get(side)))


def prism_command(invocation: Invocation, degrees: Degrees, side: PrismSide = None, link: Link = DEFAULT_LINK) -> None:
    """Turn what the eyes see by 90 degrees, to see the side lap in stereo, or back.

    Example: orip drive prism 90
    """
    turn: Literal[0, 90] = 90 if degrees == "90" else 0
    words: dict[str | None, Literal["LEFT", "RIGHT"]] = {"left": "LEFT", "right": "RIGHT"}
    _set(invocation, "prism", link, lambda processor: processor.prism(words.get(side), turn))


def foot_command(invocation: Invocation, side: Foot, link: Link = DEFAULT_LINK) -> None:
    """Press a foot switch: right digitises, left skips (in stereo it locks and unlocks).

    Example: orip drive foot right
    """
    _set(invocation, "foot", link, lambda processor: processor.foot("LEFT" if side == "left" else "RIGHT"))


def key_command(invocation: Invocation, key: Key, link: Link = DEFAULT_LINK) -> None:
    """Press a key of the keypad: ENTER keeps the old measurement; digits and ENTER name a new point; ZERO ends.

    Example: orip drive key ENTER
    """
    _set(invocation, "key", link, lambda processor: processor.key(key))


def _set(invocation: Invocation, verb: str, link: str, setting: Callable[[PlateProcessorLink], Status]) -> None:
    from orip.link.client import open_link

    with open_link(link) as processor:
        status = setting(processor)
    set_to = {"model": status.model, "guide": status.guide, "condition": status.condition, "lock": status.lock}
    switches = {"prisms": list(status.prisms), "automatic": status.automatic}
    invocation.terminal.answer(
        "drive-panel", {"command": f"drive {verb}", **set_to, **switches}, "\n".join(_lines(status))
    )


def _lines(status: Status) -> Sequence[str]:
    left, right = status.prisms
    automatic = "ON" if status.automatic else "OFF"
    settings = f"guide   {status.guide}  lock {status.lock or 'NONE'}  prism {left} {right}  automatic {automatic}"
    return [f"model   {status.model}  {status.condition}", settings]
