"""`orip drive goto`, `where`, `guide`, `emulate` …: commands to a plate processor over a link, and one to emulate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from orip.cli.options import LINK_VARIABLE, BundleArgument, Invocation, command
from orip.cli.terminal import warning_rows
from orip.errors import ProjectWarning, UsageError
from orip.wording import counted

if TYPE_CHECKING:
    from orip.multimodel.link.client import PlateProcessorLink
    from orip.multimodel.state import Driven, Status


DEFAULT_LINK = "tcp://127.0.0.1:4788"

Link = Annotated[
    str, typer.Option("--link", envvar=LINK_VARIABLE, metavar="URL", help="tcp://HOST:PORT or a serial device.")
]
Bundle = Annotated[
    str | None, typer.Option("--bundle", help="With a crs and several bundles: the one that is driven in.")
]
X = Annotated[float, typer.Argument(metavar="X", help="Ground coordinates, ground units.", show_default=False)]
Y = Annotated[float, typer.Argument(metavar="Y", show_default=False)]
Z = Annotated[float, typer.Argument(metavar="Z", show_default=False)]

NEGATIVE_NUMBERS: dict[str, Any] = {"context_settings": {"ignore_unknown_options": True}}
"""-12.5 is a coordinate, not an option."""


def register(drive: typer.Typer) -> None:
    """Add the commands to the group."""
    command(drive, "download")(download_command)
    command(drive, "goto", **NEGATIVE_NUMBERS)(goto_command)
    command(drive, "where", reads_only=True)(where_command)
    command(drive, "profile", **NEGATIVE_NUMBERS)(profile_command)
    command(drive, "forward")(forward_command)
    command(drive, "model")(model_command)
    command(drive, "next")(next_command)


def download_command(invocation: Invocation, bundle: BundleArgument = None, link: Link = DEFAULT_LINK) -> None:
    """Load the drive table into the plate processor; writes BUNDLE.DRV first where that is missing or out of date.

    Example: orip drive download --link tcp://127.0.0.1:4788
    """
    from orip.multimodel.project_link import download

    terminal = invocation.terminal
    done = download(invocation.folder, bundle, link)
    shown, table = done.table.project.shown(done.table.path), done.table.table
    terminal.warn(done.table.warnings)
    terminal.say(
        f"download  {shown} loaded at {link}: {counted(len(table.models), 'model')}; SHA-256 {done.digest[:12]}…",
        "green",
    )
    if terminal.json:
        document = {"command": "drive download", "link": link, "file": shown, "changed": done.table.changed}
        document |= {"photos": len(table.photos), "models": len(table.models), "sha256": done.digest}
        terminal.document("drive-download", {**document, "warnings": warning_rows(done.table.warnings)})


def goto_command(
    invocation: Invocation,
    x: X,
    y: Y,
    z: Z,
    bundle: Bundle = None,
    link: Link = DEFAULT_LINK,
) -> None:
    """Drive the measuring mark to ground coordinates; the model changes where they are not in the active one.

    Example: orip drive goto 1010.5 2031 -4.2
    """
    from orip.multimodel.project_link import operating

    with operating(invocation.folder, bundle, link) as project:
        invocation.terminal.warn(project.warnings)
        tell_driven(invocation, "goto", project.goto((x, y, z)), project.link.status().condition)


def where_command(invocation: Invocation, bundle: Bundle = None, link: Link = DEFAULT_LINK) -> None:
    """Show where the measuring mark is: model, ground, plates and photos.

    Example: orip drive where
    """
    from orip.multimodel.commands.output import where_document, where_lines
    from orip.multimodel.project_link import observing

    with observing(invocation.folder, bundle, link) as project:
        found = project.where()
        invocation.terminal.warn(project.warnings)
    invocation.terminal.answer("drive-where", where_document(found), "\n".join(where_lines(found)))


def profile_command(
    invocation: Invocation,
    x1: Annotated[float, typer.Argument(metavar="X1", help="Where the line begins, ground units.", show_default=False)],
    y1: Annotated[float, typer.Argument(metavar="Y1", show_default=False)],
    z1: Annotated[float, typer.Argument(metavar="Z1", show_default=False)],
    x2: Annotated[float, typer.Argument(metavar="X2", help="Where it ends.", show_default=False)],
    y2: Annotated[float, typer.Argument(metavar="Y2", show_default=False)],
    z2: Annotated[float, typer.Argument(metavar="Z2", show_default=False)],
    step: Annotated[float, typer.Argument(metavar="STEP", help="Length of a step.", show_default=False)],
    bundle: Bundle = None,
    link: Link = DEFAULT_LINK,
) -> None:
    """Drive along a line on the ground in equal steps, and list each with its model and plate coordinates.

    Example: orip drive profile 1000 2000 50 1100 2000 50 2.5
    """
    from orip.multimodel.commands.output import profile_document, profile_lines
    from orip.multimodel.project_link import operating

    with operating(invocation.folder, bundle, link) as project:
        points = project.profile((x1, y1, z1), (x2, y2, z2), step)
        invocation.terminal.warn(project.warnings)
    invocation.terminal.answer("drive-profile", profile_document(points), "\n".join(profile_lines(points)))


def forward_command(invocation: Invocation, link: Link = DEFAULT_LINK) -> None:
    """Bring both plates to the front, for films to be mounted.

    Example: orip drive forward
    """
    from orip.multimodel.link.client import open_link

    with open_link(link) as processor:
        tell_driven(invocation, "forward", processor.forward(), processor.status().condition)


def model_command(
    invocation: Invocation, name: Annotated[str, typer.Argument(metavar="NAME")], link: Link = DEFAULT_LINK
) -> None:
    """Change to another model, at the same place on the ground.

    Example: orip drive model 1-2
    """
    from orip.multimodel.link.client import open_link
    from orip.multimodel.project_link import stale_table_warnings

    with open_link(link) as processor:
        invocation.terminal.warn(stale_table_warnings(invocation.folder, None, processor))
        tell_driven(invocation, "model", processor.change_model(name), processor.status().condition)


def next_command(invocation: Invocation, link: Link = DEFAULT_LINK) -> None:
    """Change to the next model of the row, else to the first of the next row.

    Example: orip drive next
    """
    from orip.multimodel.link.client import open_link
    from orip.multimodel.project_link import stale_table_warnings

    with open_link(link) as processor:
        invocation.terminal.warn(stale_table_warnings(invocation.folder, None, processor))
        tell_driven(invocation, "next", processor.next_model(), processor.status().condition)


def tell_driven(invocation: Invocation, verb: str, driven: Driven, condition: str) -> None:
    """Say where the stages were driven to."""
    from orip.multimodel.commands.output import driven_document, driven_line

    document = {"command": f"drive {verb}", **driven_document(driven), "condition": condition}
    invocation.terminal.answer("drive-to", document, f"{driven_line(driven)}  {condition}")


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


def register_panel(drive: typer.Typer) -> None:
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
    from orip.multimodel.link.client import open_link

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
    from orip.multimodel.link.client import open_link

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


DEFAULT_ADDRESS = "127.0.0.1:4788"
PLATE_UPDATES_HZ = 50.0

Listen = Annotated[str, typer.Option("--listen", metavar="HOST:PORT", help="Port 0: any that is free.")]
StateFile = Annotated[
    Path | None, typer.Option("--state", metavar="FILE", help="Keep the table and the mark in this file.")
]
Speed = Annotated[
    float | None, typer.Option("--speed", min=1e-3, help="Speed of the stages, mm/s. Default: they move at once.")
]
Rate = Annotated[float | None, typer.Option("--rate", min=1e-3, help="Hz at which --speed moves them; default 50.")]
StagesOption = Annotated[
    str,
    typer.Option(
        "--stages",
        metavar="LIMITS",
        help="dsr (240 mm), x_min,x_max,y_min,y_max in mm, or table (its limits).",
    ),
]
AllowRemote = Annotated[
    bool, typer.Option("--allow-remote", help="Listen for other machines too; they need the token that is printed.")
]

_REMOTE = ProjectWarning(
    "remote",
    "--allow-remote",
    "whoever can reach this machine and has the token can drive the stages; the line is not encrypted",
)


def register_emulator(drive: typer.Typer) -> None:
    """Add the command to the group."""
    command(drive, "emulate")(emulate_command)


def emulate_command(
    invocation: Invocation,
    listen: Listen = DEFAULT_ADDRESS,
    state: StateFile = None,
    speed: Speed = None,
    rate: Rate = None,
    stages: StagesOption = "dsr",
    allow_remote: AllowRemote = False,
) -> None:
    """Emulate a plate processor over TCP until Ctrl-C or SIGTERM.

    The first client operates, others may read; beside a program that digitises one may operate. Commands of orip find
    the token that is printed. Line protocol, for example with netcat: send TOKEN and the token, then HELP.

    Example: orip drive emulate --state plates.json
    """
    from orip.multimodel.emulation import EmulatorSettings, emulate, stages_of_words
    from orip.multimodel.link.station import Pace

    if rate is not None and speed is None:
        message = "--rate says how often --speed moves the stages; give --speed too"
        raise UsageError(message)
    kept_in = None if state is None else invocation.folder / state
    pace = None if speed is None else Pace(speed, rate or PLATE_UPDATES_HZ)
    terminal = invocation.terminal

    def listening(address: str, token: str) -> None:
        link = f"tcp://{token}@{address}"
        terminal.answer(
            "drive-emulate",
            {"command": "drive emulate", "listening": address, "link": link},
            f"listening on {address}; link {link}",
        )
        terminal.flush()

    if allow_remote:
        terminal.warn([_REMOTE])
    ended = emulate(
        EmulatorSettings(listen, kept_in, pace, allow_remote, stages_of_words(stages)), listening, terminal.error
    )
    kept = "" if state is None else f"; its state is in {state}"
    terminal.say(f"the emulated plate processor has ended ({ended}){kept}", "green")
