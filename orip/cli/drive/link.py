"""`orip drive download`, `goto`, `where` …: commands to a plate processor over a link."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from orip.cli.options import LINK_VARIABLE, BundleArgument, Invocation, command
from orip.cli.terminal import warning_rows
from orip.wording import counted

if TYPE_CHECKING:
    from orip.multimodel.state import Driven

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
    from orip.workflow.drive.link import download

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
    from orip.workflow.drive.link import operating

    with operating(invocation.folder, bundle, link) as project:
        invocation.terminal.warn(project.warnings)
        tell_driven(invocation, "goto", project.goto((x, y, z)), project.link.status().condition)


def where_command(invocation: Invocation, bundle: Bundle = None, link: Link = DEFAULT_LINK) -> None:
    """Show where the measuring mark is: model, ground, plates and photos.

    Example: orip drive where
    """
    from orip.cli.drive.output import where_document, where_lines
    from orip.workflow.drive.link import observing

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
    from orip.cli.drive.output import profile_document, profile_lines
    from orip.workflow.drive.link import operating

    with operating(invocation.folder, bundle, link) as project:
        points = project.profile((x1, y1, z1), (x2, y2, z2), step)
        invocation.terminal.warn(project.warnings)
    invocation.terminal.answer("drive-profile", profile_document(points), "\n".join(profile_lines(points)))


def forward_command(invocation: Invocation, link: Link = DEFAULT_LINK) -> None:
    """Bring both plates to the front, for films to be mounted.

    Example: orip drive forward
    """
    from orip.link.client import open_link

    with open_link(link) as processor:
        tell_driven(invocation, "forward", processor.forward(), processor.status().condition)


def model_command(
    invocation: Invocation, name: Annotated[str, typer.Argument(metavar="NAME")], link: Link = DEFAULT_LINK
) -> None:
    """Change to another model, at the same place on the ground.

    Example: orip drive model 1-2
    """
    from orip.link.client import open_link
    from orip.workflow.drive.link import stale_table_warnings

    with open_link(link) as processor:
        invocation.terminal.warn(stale_table_warnings(invocation.folder, None, processor))
        tell_driven(invocation, "model", processor.change_model(name), processor.status().condition)


def next_command(invocation: Invocation, link: Link = DEFAULT_LINK) -> None:
    """Change to the next model of the row, else to the first of the next row.

    Example: orip drive next
    """
    from orip.link.client import open_link
    from orip.workflow.drive.link import stale_table_warnings

    with open_link(link) as processor:
        invocation.terminal.warn(stale_table_warnings(invocation.folder, None, processor))
        tell_driven(invocation, "next", processor.next_model(), processor.status().condition)


def tell_driven(invocation: Invocation, verb: str, driven: Driven, condition: str) -> None:
    """Say where the stages were driven to."""
    from orip.cli.drive.output import driven_document, driven_line

    document = {"command": f"drive {verb}", **driven_document(driven), "condition": condition}
    invocation.terminal.answer("drive-to", document, f"{driven_line(driven)}  {condition}")
