"""`orip drive`: the drive table of an oriented block, and the page that shows the plate processor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.options import LINK_VARIABLE, BundleArgument, Invocation, command, group_of_commands
from orip.cli.terminal import Terminal, warning_rows
from orip.errors import InputError, ProjectWarning
from orip.multimodel.commands import link
from orip.web import ANY_PORT
from orip.wording import counted

if TYPE_CHECKING:
    from orip.multimodel.table_step import DriveTableOutcome


_ABOUT = "Drive in the oriented block: the drive table and the plate processor.\n\nExample: orip drive table"

drive = group_of_commands("drive", _ABOUT, no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    link.register(drive)
    link.register_panel(drive)
    link.register_emulator(drive)
    command(drive, "watch")(watch_command)
    app.add_typer(drive)


@command(drive, "table")
def table_command(invocation: Invocation, bundle: BundleArgument = None) -> None:
    """Write BUNDLE.DRV, what a plate processor needs to drive from model to model.

    Orientations are those of the last adjustment, with the interior orientation that is in force now.

    Example: orip drive table
    """
    from orip.multimodel.table_step import DRIVEN_FROM, make_drive_table
    from orip.workflow.project.bundle_state import read_bundle
    from orip.workflow.project.commit import commit

    outcome = commit(make_drive_table(read_bundle(invocation.folder, bundle, *DRIVEN_FROM))).outcome
    tell_table(invocation.terminal, outcome)
    if invocation.terminal.json:
        document = {
            "command": "drive table",
            "file": outcome.project.shown(outcome.path),
            "changed": outcome.changed,
            **_counts(outcome),
            "start": list(outcome.table.start),
            "warnings": warning_rows(outcome.warnings),
        }
        invocation.terminal.document("drive-table", document)


def tell_made(terminal: Terminal, made: DriveTableOutcome | InputError) -> None:
    """Say what `orip run` made of a bundle with models: a drive table, or why there is none."""
    if isinstance(made, InputError):
        tell_no_table(terminal, made)
    else:
        tell_table(terminal, made)


def tell_table(terminal: Terminal, outcome: DriveTableOutcome) -> None:
    """Say what the drive table holds."""
    terminal.warn(outcome.warnings)
    what = ", ".join(counted(number, name[:-1]) for name, number in _counts(outcome).items())
    state = "wrote    " if outcome.changed else "kept     "
    terminal.say(f"{state}{outcome.project.shown(outcome.path)}: {what}")


def tell_no_table(terminal: Terminal, error: InputError) -> None:
    """Say why a bundle with models has no drive table."""
    terminal.warn(
        ProjectWarning("no-drive-table", "", f"no drive table: {complaint}") for complaint in error.complaints
    )


def _counts(outcome: DriveTableOutcome) -> dict[str, int]:
    table = outcome.table
    return {"cameras": len(table.cameras), "photos": len(table.photos), "models": len(table.models)}


Link = Annotated[
    str | None,
    typer.Option(
        "--link",
        envvar=LINK_VARIABLE,
        metavar="URL",
        help="Show this plate processor, for example tcp://127.0.0.1:4788.",
    ),
]
Listen = Annotated[
    str,
    typer.Option(
        "--listen", metavar="HOST:PORT", help="Where the page is served, on this machine. Port 0: any that is free."
    ),
]
Open = Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")]


def watch_command(
    invocation: Invocation,
    bundle: BundleArgument = None,
    link: Link = None,
    listen: Listen = ANY_PORT,
    browser: Open = True,
) -> None:
    """Show the block in plan, the measuring mark and both plates in the browser; a click in the plan drives the mark.

    Photos that have images lie on the plates. Without --link (or ORIP_LINK) the page has a plate processor of its own.
    The page can be seen only from this machine; Ctrl-C ends it.

    Example: orip drive watch
    """
    from orip.multimodel.project_link import open_watch, watch_warnings
    from orip.web.access import listening_address
    from orip.web.serving import page_server, serve_until_ended

    address = listening_address(listen, ", which is where the page can be seen")
    watch = open_watch(invocation.folder, bundle, link)
    try:
        invocation.terminal.warn(watch_warnings(invocation.folder, bundle, link))
        with page_server(watch, address, watch.picture) as server:
            invocation.terminal.answer("drive-watch", {"command": "drive watch", "url": server.url}, server.url)
            invocation.terminal.flush()
            invocation.terminal.say("Ctrl-C ends it")
            serve_until_ended(server, browser=browser)
    finally:
        watch.close()
