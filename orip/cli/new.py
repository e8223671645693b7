"""`orip init` and `orip new`: projects that are made, and brought up to date with orip.toml."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Callable
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import msgspec
import typer

from orip.annexes import PHOTOGRAPHS, annex
from orip.cli.completion import samples
from orip.cli.options import Invocation, command
from orip.cli.terminal import Terminal, warning_rows
from orip.errors import UsageError
from orip.structs import replace

if TYPE_CHECKING:
    from orip.files.project.starting_texts import Start
    from orip.workflow.records.initialise import Initialised
    from orip.workflow.sample_projects import ProjectMade, SampleWritten


def list_samples(terminal: Terminal) -> None:
    """Print the samples, one a line, and what to write."""
    from orip.workflow.sample_projects import SAMPLES

    if terminal.json:
        rows = [{"name": name, "text": text} for name, text in SAMPLES.items()]
        terminal.document("samples", {"command": "init", "samples": rows})
        return
    width = max(map(len, SAMPLES))
    for name, text in SAMPLES.items():
        terminal.data(f"{name:{width}}  {text}")
    terminal.say("write one with: orip init --sample NAME DIR")


def tell_sample(terminal: Terminal, written: SampleWritten) -> None:
    """Say what was written, and the command that comes next."""
    terminal.say(f"wrote    {written.folder}: {', '.join(written.files)}")
    next_command = f"orip{_option(written.folder)} run"
    terminal.say(f"next     {next_command}", "bold")
    if terminal.json:
        terminal.document(
            "sample-written",
            {
                "command": "init",
                "sample": written.name,
                "folder": str(written.folder),
                "files": list(written.files),
                "next": next_command,
            },
        )


def tell_made(terminal: Terminal, made: ProjectMade) -> None:
    """Say which project was made, and the command that comes next."""
    next_command = f"orip{_option(made.folder)} {made.next}"
    terminal.say(f"wrote    {made.folder / 'orip.toml'}: project {made.name}")
    if len(made.files) > 1:
        terminal.say(f"         and {', '.join(name for name in made.files if name != 'orip.toml')}: fill them in")
    terminal.say(f"next     {next_command}", "bold")
    if terminal.json:
        terminal.document(
            "project-made",
            {
                "command": "init" if len(made.files) == 1 else "new",
                "project": made.name,
                "folder": str(made.folder),
                "files": list(made.files),
                "next": next_command,
            },
        )


def _option(folder: Path) -> str:
    """Return the option that names the project folder, as a shell wants it; none where the user is in it."""
    if folder == Path():
        return ""
    return f" -C {shlex.quote(str(folder)) if os.name == 'posix' else folder}"


Kind = Annotated[
    Literal["drone", "object", "film"] | None,
    typer.Option("--kind", help="drone: with RTK; object: with scale bars; film: scanned aerial photos."),
]

_KINDS = {"drone": "a drone block with RTK", "object": "an object with scale bars", "film": "scanned aerial film"}
_FRAME = re.compile(r"([1-9]\d{1,5})\s*[xX*]\s*([1-9]\d{1,5})")


class StartOptions(NamedTuple):
    """What is known of the camera, the system and the errors; a question is asked for what is not given."""

    camera: Annotated[str | None, typer.Option("--camera", metavar="NAME", help="Name of the camera.")] = None
    focal_length: Annotated[
        float | None, typer.Option("--c", metavar="MM", help="Principal distance; nominal focal length.")
    ] = None
    frame: Annotated[
        str | None, typer.Option("--frame", metavar="COLUMNSxROWS", help="Pixels of the sensor, such as 5472x3648.")
    ] = None
    pixel: Annotated[
        float | None, typer.Option("--pixel", metavar="MICROMETRES", help="Size of a pixel of sensor or scan.")
    ] = None
    crs: Annotated[
        str | None, typer.Option("--crs", metavar="CODE", help="Such as EPSG:25832; default: plane coordinates.")
    ] = None
    photo_error: Annotated[
        float | None, typer.Option("--photo-error", metavar="PIXELS", help="A-priori error of a photo coordinate.")
    ] = None
    control_error: Annotated[
        float | None, typer.Option("--control-error", metavar="METRES", help="That of control points.")
    ] = None
    station_error: Annotated[
        float | None, typer.Option("--station-error", metavar="METRES", help="That of exposure stations.")
    ] = None


def _register_new(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "new")
    def new_command(
        invocation: Invocation,
        name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the project.")],
        options: StartOptions,
        folder: Annotated[
            Path | None, typer.Argument(metavar="DIR", help="The folder of the project; default ./NAME.")
        ] = None,
        kind: Kind = None,
        user: Annotated[str, typer.Option("--user", help="The operator, whose name is on all outputs.")] = "",
        photographs: Annotated[
            Path | None,
            typer.Option("--photos", metavar="DIR", help="Cameras, photos and positions from these images."),
        ] = None,
    ) -> None:
        """Make a project with commented texts to fill in: camera, photos, control, measurements.

        On a terminal it asks for what no option says; elsewhere there are defaults, which the texts show. Of a folder
        of photographs it makes what 'orip photos' makes.
        For projects of other programs see 'orip import'.

        Example: orip new QUARRY --kind drone --frame 5280x3956 --pixel 3.3 --c 12.3 --crs EPSG:25832
        """
        from orip.workflow.sample_projects import make_started_project

        if photographs is not None:
            _require_none(kind, user, options)
            annex(PHOTOGRAPHS).make_project(invocation, photographs, folder or Path(name), options.crs)
            return
        if folder is None and len(Path(name).parts) > 1:
            message = f"'{name}' is a folder: write the project's name before it, 'orip new {Path(name).name} {name}'"
            raise UsageError(message)
        start = _start(name, user, kind, options)
        tell_made(invocation.terminal, make_started_project(start, invocation.folder / (folder or name)))


def _require_none(kind: str | None, user: str, options: StartOptions) -> None:
    """Refuse what a project of photographs does not take from options."""
    if kind or user or options != StartOptions(crs=options.crs):
        message = "--photos takes cameras and photos from the images: besides it give --crs alone; see 'orip photos'"
        raise UsageError(message)


def _start(name: str, user: str, kind: Literal["drone", "object", "film"] | None, options: StartOptions) -> Start:
    """Return what options say, then what the user answers, then defaults of the kind of block."""
    from orip.workflow.sample_projects import STARTS

    asks = sys.stdin.isatty() and sys.stderr.isatty()
    if kind is None and asks:
        text = "; ".join(f"{word}: {meaning}" for word, meaning in _KINDS.items())
        answer = _answer(f"Kind of block ({text})", "drone", lambda word: word in _KINDS)
        kind = next(word for word in ("drone", "object", "film") if word == answer)
    usual = replace(STARTS[kind or "drone"], name=name, user=user)
    film = usual.kind == "film"
    camera = _text(options.camera, asks, "Camera", usual.camera)
    c = _number(options.focal_length, asks, "Principal distance (focal length), mm", usual.focal_length)
    columns, rows = usual.columns, usual.rows
    if not film:
        columns, rows = _frame(_text(options.frame, asks, "Pixels of the sensor", f"{columns}x{rows}", _is_frame))
    pixel = _number(options.pixel, asks, f"Size of a pixel of the {'scan' if film else 'sensor'}, µm", usual.pixel)
    crs = _text(options.crs, asks, "Coordinate reference system, such as EPSG:25832 (none: plane coordinates)", "none")
    photo = _number(options.photo_error, asks, "A-priori error of a photo coordinate, pixels", usual.photo_error)
    control = _number(options.control_error, asks, "A-priori error of control points, m", usual.control_error)
    station = usual.station_error
    if usual.kind == "drone":
        station = _number(options.station_error, asks, "A-priori error of RTK positions, m", station)
    return replace(
        usual, camera=camera, focal_length=c, columns=columns, rows=rows, pixel=pixel,
        crs="" if crs.lower() == "none" else crs, photo_error=photo, control_error=control, station_error=station,
    )  # fmt: skip


def _text(given: str | None, asks: bool, question: str, usual: str, fits: Callable[[str], bool] = bool) -> str:
    return given if given is not None else _answer(question, usual, fits) if asks else usual


def _number(given: float | None, asks: bool, question: str, usual: float) -> float:
    if given is None:
        given = float(_answer(question, f"{usual:g}", _is_above_zero)) if asks else usual
    if not _is_above_zero(str(given)):
        message = f"{question}: {given} is not a number above 0"
        raise UsageError(message)
    return given


def _answer(question: str, usual: str, fits: Callable[[str], bool]) -> str:
    """Ask until the answer fits."""
    while True:
        answer = str(typer.prompt(question, default=usual, err=True)).strip()
        if fits(answer):
            return answer
        typer.echo(f"  '{answer}' is not possible here; write it as {usual}", err=True)


def _is_above_zero(text: str) -> bool:
    try:
        return 0.0 < float(text) < inf
    except ValueError:
        return False


def _is_frame(text: str) -> bool:
    return _FRAME.fullmatch(text) is not None


def _frame(text: str) -> tuple[int, int]:
    found = _FRAME.fullmatch(text)
    if found is None:
        message = f"--frame {text}: write columns and rows, such as 5472x3648"
        raise UsageError(message)
    return int(found[1]), int(found[2])


PreferOption = Annotated[
    Literal["text", "store"] | None,
    typer.Option("--prefer", help="Which side wins where orip.toml and a store have both changed a record."),
]

SampleOption = Annotated[
    bool, typer.Option("--sample", help="Write the sample project NAME into DIR; without a name, list them.")
]
SampleName = Annotated[
    str | None,
    typer.Argument(
        metavar="NAME", autocompletion=samples, help="Make a project of that name; with --sample: which one."
    ),
]
SampleFolder = Annotated[
    Path | None, typer.Argument(metavar="DIR", help="The folder of the project that is made; default ./NAME.")
]

UserOption = Annotated[str, typer.Option("--user", help="With NAME: the operator, whose name is on all outputs.")]

_SHOWN_VALUES = 12


def register(app: typer.Typer) -> None:
    """Add the command."""
    _register_new(app)

    @command(app, "init")
    def init(
        invocation: Invocation,
        name: SampleName = None,
        folder: SampleFolder = None,
        sample: SampleOption = False,
        prefer: PreferOption = None,
        user: UserOption = "",
    ) -> None:
        """Apply orip.toml to the record stores; or make a project, new or a sample. Safe to repeat.

        With NAME a project is made that commands define: 'orip camera add', 'photo add', 'bundle add' and others.

        Records whose text has not changed since the last time stay as they are, so what 'orip update' wrote survives.

        Example: orip init --sample small_frame_block try
        """
        if sample:
            _sample(invocation, name, folder, prefer)
            return
        if name is not None:
            _make(invocation, name, user, folder, prefer)
            return
        from orip.workflow.project.commit import carry_out
        from orip.workflow.project.state import read_project
        from orip.workflow.records.initialise import INITIALISED_FROM, initialise

        state = read_project(invocation.folder, *INITIALISED_FROM)
        outcome = carry_out(state, partial(initialise, prefer=prefer)).outcome
        tell(invocation.terminal, outcome)
        if invocation.terminal.json:
            invocation.terminal.document(
                "init",
                {
                    "command": "init",
                    "unchanged": not outcome.changes,
                    "changes": [
                        {"kind": change.kind, "name": change.name, "action": change.action}
                        for change in outcome.changes
                    ],
                    "differences": msgspec.to_builtins(outcome.differences),
                    "warnings": warning_rows(outcome.warnings),
                },
            )


def _sample(invocation: Invocation, name: str | None, folder: Path | None, prefer: str | None) -> None:
    if prefer is not None:
        message = "--prefer cannot be combined with --sample; leave one of them out"
        raise UsageError(message)
    if name is None:
        list_samples(invocation.terminal)
        return
    from orip.workflow.sample_projects import write_sample

    tell_sample(invocation.terminal, write_sample(name, invocation.folder / (folder or name)))


def _make(invocation: Invocation, name: str, user: str, folder: Path | None, prefer: str | None) -> None:
    from orip.workflow.sample_projects import SAMPLES, make_project

    if prefer is not None:
        message = "--prefer is for 'orip init' without a name; leave one of them out"
        raise UsageError(message)
    if name in SAMPLES:
        message = f"{name} is a sample: write it with 'orip init --sample {name}', or choose another name"
        raise UsageError(message)
    tell_made(invocation.terminal, make_project(name, user, invocation.folder / (folder or name)))


def tell(terminal: Terminal, outcome: Initialised) -> None:
    """Say what the stores took over."""
    terminal.warn(outcome.warnings)
    if not outcome.changes:
        terminal.say("init     unchanged: the stores hold what orip.toml says")
        return
    from orip.workflow.records.reconcile import counted_changes

    for change in outcome.changes:
        terminal.detail(f"         {change.action} {change.kind} {change.name}")
    terminal.say(f"init     {counted_changes(outcome.changes)}")
    for change in outcome.changes:
        if change.action == "detached":
            terminal.say(f"         {change.kind} {change.name} was removed from orip.toml; it stays in its store")
    _tell_differences(terminal, outcome)


def _tell_differences(terminal: Terminal, outcome: Initialised) -> None:
    """Show the values that have changed, a few of them always."""
    from orip.workflow.records.changes import shown_value

    lines = [
        f"         {record.kind} {record.name}: {value.key} {shown_value(value.old)} -> {shown_value(value.new)}"
        for record in outcome.differences
        if record.action == "changed"
        for value in record.values
    ]
    for line in lines[:_SHOWN_VALUES]:
        terminal.say(line)
    for line in lines[_SHOWN_VALUES:]:
        terminal.detail(line)
    if (more := len(lines) - _SHOWN_VALUES) > 0 and not terminal.verbose:
        terminal.say(f"         and {more} more; -v lists all")
