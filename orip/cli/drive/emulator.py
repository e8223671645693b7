"""`orip drive emulate`: a plate processor where there is none."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orip.cli.options import Invocation, command
from orip.errors import ProjectWarning, UsageError

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


def register(drive: typer.Typer) -> None:
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
    from orip.link.travel import Pace
    from orip.workflow.drive.emulator import EmulatorSettings, emulate, stages_of_words

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
