"""The program `orip`: its commands, each loaded when it is asked for, and what it says without one."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from typer.main import get_group

from orip.annexes import COMMANDS as COMMANDS_OF_ANNEXES
from orip.cli.conversion import Group
from orip.cli.exits import exit_on_error, report, report_usage, warnings_kept_back
from orip.cli.options import Color, Invocation, Json, Quiet, SharedOptions, Threads, Verbose
from orip.cli.terminal import Terminal, output_taken
from orip.errors import INTERRUPTED, OripError
from orip.version import __version__


class Listed(NamedTuple):
    """What `orip --help` says of a command, and the modules that register it; none for those of annexes."""

    text: str
    modules: tuple[str, ...]


COMMANDS: Mapping[str, Listed] = {
    "init": Listed(
        "Apply orip.toml to the record stores; or make a project, new or a sample. Safe to repeat.", ("new",)
    ),
    "new": Listed("Make a project with commented texts to fill in: camera, photos, control, measurements.", ("new",)),
    "measure": Listed(
        "Replay the measurement files into orientations and photo observations; write INTERIOR_RESULT.OUT.",
        ("observations",),
    ),
    "solve": Listed(
        "Adjust a bundle; write result.json, residuals.csv, BUNDLE_RESULT.OUT, BUNDLE_ERROR.OUT and report.html.",
        ("solve",),
    ),
    "run": Listed(
        "Do the whole project: init, measure, preliminary values, solve all bundles, drive tables, reports.",
        ("run",),
    ),
    "status": Listed("Show what the project has, what is out of date, and what comes next. Reads only.", ("run",)),
    "results": Listed(
        "Show cameras, photos, points, theodolites (zero directions), figures or residuals of the last adjustment.",
        ("results",),
    ),
    "report": Listed("Write the report of the last adjustment: one HTML page that needs no network.", ("results",)),
    "online": Listed(
        "Check measurements as they are made and report wrong ones immediately.",
        (),
    ),
    "update": Listed(
        "Take values of the last adjustment as preliminary values, but only those of its unknowns.", ("update",)
    ),
    "check": Listed(
        "Check gates against the last adjustment: exit code 5 if one fails, 4 if it did not converge.",
        ("gates",),
    ),
    "compare": Listed(
        "Compare the figures of two results: exit code 0 if they are equal within the tolerance, 5 if not.",
        ("gates",),
    ),
    "dump": Listed("Print a record store as canonical text: equal data give equal text.", ("stores",)),
    "load": Listed("Replace a record store's content by that of a dump, all or nothing.", ("stores",)),
    "export-toml": Listed("Bring the record stores into the text: a complete orip.toml.", ("stores",)),
    "photos": Listed("Make a project folder of a folder of photographs.", ()),
    "import": Listed("Make a project folder of a project of another program.", ()),
    "export": Listed("Write the result of the last adjustment in the format of another program.", ()),
    "adjust": Listed(
        "Adjust a project of another program: import, run, report, and the result written back, in one command.",
        (),
    ),
    "prelim": Listed("Preliminary values of photos and points, from measurements and control only.", ("prelim",)),
    "drive": Listed("Drive in the oriented block: the drive table and the plate processor.", ()),
    "digitise": Listed(
        "Measure through the plate processor: it drives, the operator sets the mark and presses the foot switch.",
        (),
    ),
    "observations": Listed("Photo observations: list, disregard, include, kill, measure again.", ("observations",)),
    "camera": Listed(
        "Cameras: principal distance and point, distortion, fiducial marks.",
        ("records", "camera_plot"),
    ),
    "temtick": Listed("Tick marks of kinds of templates.", ("records",)),
    "photo": Listed("Photos: camera, template, preliminary orientation.", ("records",)),
    "template": Listed("Templates: tick marks, stage plate, photos on them.", ("records",)),
    "bundle": Listed("Bundle adjustments: what controls them.", ("records",)),
    "model": Listed("Stereo models of a bundle.", ("records",)),
    "control": Listed(
        "Ground control and preliminary coordinates, line by line; comments and order of the files stay.", ("control",)
    ),
    "stations": Listed("Exposure stations from GNSS and INS.", ()),
    "gnss": Listed("Positions of a receiver, or a network of receivers that stand, with RTKLIB.", ()),
    "imu": Listed("Smooth a trajectory with attitudes from inertial data and positions; noise of a unit.", ()),
    "detect": Listed("Targets in pictures: boards, tags, sheets of coded dots.", ()),
    "plan": Listed("Plan a flight or a network, and forecast its precision.", ()),
    "match": Listed("Measure tie points in the images of the photos, and write them to TIES.MEA.", ()),
    "restitute": Listed(
        "Points, lines and areas from stereo measurements, with standard deviations, in the .GEO file.", ()
    ),
    "screen": Listed("Measure in the images of the photos, in the browser: points, control, what does not fit.", ()),
    "archive": Listed("Many projects at once, on the cores of this machine or of many.", ()),
}
"""In the order of `orip --help`; the texts are the first paragraphs of the commands' own."""


class LateCommands(dict[str, Any]):
    """The commands by their names; the value of one is made when it is first taken."""

    def __init__(self) -> None:
        super().__init__(dict.fromkeys(COMMANDS))

    def __getitem__(self, name: str) -> Any:
        if super().__getitem__(name) is None:
            self[name] = _loaded(name)
        return super().__getitem__(name)

    def get(self, name: str, default: Any = None) -> Any:
        """Return the command of that name."""
        try:
            return self[name]
        except KeyError:
            return default

    def values(self) -> Any:
        """Return all commands."""
        return [self[name] for name in self]

    def items(self) -> Any:
        """Return all names and commands."""
        return [(name, self[name]) for name in self]


def _loaded(name: str) -> Any:
    app = typer.Typer(rich_markup_mode=None)
    modules = [f"orip.cli.{module}" for module in COMMANDS[name].modules] or [COMMANDS_OF_ANNEXES[name]]
    for module in modules:
        import_module(module).register(app)
    return get_group(app).commands[name]


class Commands(Group):
    """The program's group of commands."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = LateCommands()

    def list_commands(self, _ctx: Any) -> list[str]:
        """Return the names in their order."""
        return list(COMMANDS)

    def format_commands(self, _ctx: Any, formatter: Any) -> None:
        """Write the names and texts of the commands, of which none is loaded."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, listed.text) for name, listed in COMMANDS.items()])


app = typer.Typer(
    name="orip",
    cls=Commands,
    invoke_without_command=True,
    no_args_is_help=False,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"orip {__version__}")
        raise typer.Exit


@app.callback()
def before_command(
    context: typer.Context,
    folder: Annotated[
        Path,
        typer.Option(
            "--project", "-C", metavar="DIR", help="The project folder: work as if started there (file names too)."
        ),
    ] = Path(),
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: Json = False,
    color: Color = None,
    threads: Threads = None,
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Bundle adjustment of photogrammetric project folders.

    Without a command: what the project has, and what is next.

    Example: orip init --sample small_frame_block; orip -C small_frame_block run
    """
    options = SharedOptions(quiet, verbose, json, color, threads)
    context.obj = Invocation(folder, options, options.terminal())
    if context.invoked_subcommand is None:
        from orip.cli import run as status

        with exit_on_error(context.obj.terminal):
            status.show(context.obj)


def main() -> None:
    """Run the program."""
    _prepare_streams()
    try:
        with output_taken(), warnings_kept_back():  # typer prints its help without a terminal of orip's
            code = app(prog_name="orip", standalone_mode=False)
            sys.stdout.flush()
    except OripError as error:
        code = report(Terminal(), error)
    except BrokenPipeError:
        code = 0
    except typer.Abort:
        code = INTERRUPTED
    except typer.TyperException as error:  # every fault of the command line that typer finds
        code = report_usage(error, sys.argv[1:])
    sys.exit(code)


def _prepare_streams() -> None:
    """Let no stream fail a command: a closed one is empty or discards, a full one waits, every character prints."""
    sys.stdin = sys.stdin or Path(os.devnull).open(encoding="utf-8")  # noqa: SIM115  # open for as long as orip runs
    sys.stdout = sys.stdout or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    sys.stderr = sys.stderr or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
        with suppress(OSError, ValueError):  # a pipe that does not wait for its reader would lose what it cannot take
            os.set_blocking(stream.fileno(), True)


if __name__ == "__main__":
    main()
