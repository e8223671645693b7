"""`orip digitise`: measuring through the plate processor."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from orip.annexes import MEASURING_ONLINE, annex
from orip.cli.completion import cameras, photos, points, templates
from orip.cli.options import LINK_VARIABLE, BundleArgument, BundleOption, Invocation, add_group, command
from orip.errors import UsageError

if TYPE_CHECKING:
    from orip.multimodel.digitising.screen import Screen
    from orip.multimodel.digitising.setup import DigitisingSetup
    from orip.multimodel.digitising.wanted import MarkChoice


LOG = Path("DIGITISED.MEA")
STEREO_FILE = Path("STEREO.STE")

LinkOption = Annotated[
    str | None, typer.Option("--link", envvar=LINK_VARIABLE, metavar="URL", help="As tcp://127.0.0.1:4788.")
]
LogOption = Annotated[Path, typer.Option("--log", metavar="FILE", help="Measurement file that is written to.")]
SimulateOption = Annotated[
    list[Path] | None,
    typer.Option("--simulate", metavar="FILE", help="Digitise all where this .MEA has it; several: one log."),
]
ScriptOption = Annotated[
    Path | None,
    typer.Option(
        "--script", metavar="FILE", help="What the operator does: MOVE dx dy, FOOT RIGHT, KEY ENTER; '-': stdin."
    ),
]
ScreenOption = Annotated[
    bool, typer.Option("--screen", help="Keys, plates, results and measurements on one screen of the terminal.")
]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Show the order and the places; needs no link.")]
KindOption = Annotated[
    Literal["A", "C", "W"] | None,
    typer.Option("--transformation", help="A affine, C conformal, W without scale; default: as before, else A."),
]
AgainOption = Annotated[bool, typer.Option("--again", help="Drive to the old coordinates; ENTER keeps them.")]
StageOption = Annotated[Literal["UPPER", "LOWER"], typer.Option("--stage", help="Where the film is mounted.")]
MarkOption = Annotated[
    list[str] | None,
    typer.Option("--mark", metavar="NAME[,X,Y]", help="That mark alone; a new one with its coordinates, mm."),
]
NewOption = Annotated[
    bool, typer.Option("--new", help="Points that the operator names while measuring, model by model.")
]
FirstOption = Annotated[str, typer.Option("--first", metavar="NAME", help="With --new: number points from here.")]
OnlyOption = Annotated[
    Literal["control", "tie"] | None, typer.Option("--only", help="Control and check points, or tie points, alone.")
]
ListOption = Annotated[Path | None, typer.Option("--list", metavar="FILE", help="Names, or 'observations todo'.")]
NamesArgument = Annotated[list[str] | None, typer.Argument(metavar="NAME", help="Default: 1, 2, 3 ...")]


class Instrument(NamedTuple):
    """Where to digitise: at which plate processor, who operates it, and what he sees."""

    link: LinkOption = None
    simulate: SimulateOption = None
    script: ScriptOption = None
    screen: ScreenOption = False

    def setup(self, invocation: Invocation, log: Path, *, dry_run: bool = False) -> DigitisingSetup:
        """Return what the commands digitise with, and the log that they write to.

        Raises
        ------
        UsageError
            If there is no plate processor to digitise at, or there are two operators.
        """
        from orip.multimodel.digitising.setup import by_link, rehearsal

        if self.screen and (self.script is not None or not sys.stdout.isatty()):
            message = "--screen is for an operator at a terminal; leave it out with --script, or where output is kept"
            raise UsageError(message)

        if self.simulate and self.script is not None:
            message = "the operator is simulated, or does what a script says; give --simulate or --script"
            raise UsageError(message)
        if dry_run:
            return rehearsal(invocation.folder, log, invocation.terminal.detail)
        if self.link is None:
            message = (
                f"which plate processor? name it with --link tcp://127.0.0.1:4788 or in the environment variable "
                f"{LINK_VARIABLE}, or see the order with --dry-run"
            )
            raise UsageError(message)
        return by_link(
            invocation.folder, log, self.link, invocation.terminal.say, simulate=self.simulate or (),
            script=self.script, screen=_screen() if self.screen else None,
        )  # fmt: skip


class Orienting(NamedTuple):
    """How marks of templates and photos are digitised."""

    log: LogOption = LOG
    transformation: KindOption = None
    again: AgainOption = False
    mark: MarkOption = None


class RecordMarks(NamedTuple):
    """Where the marks of a record are digitised."""

    stage: StageOption = "UPPER"
    log: LogOption = LOG


_ABOUT = """Measure through the plate processor: it drives, the operator sets the mark and presses the foot switch.

Right foot switch: digitise; left: skip (in stereo: lock, unlock); ENTER: keep; any other key, or ZERO: end.

Example: orip digitise template LEFT --link tcp://127.0.0.1:4788
"""


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    add_group(app, "digitise", _ABOUT, _register_commands)


def _register_commands(group: typer.Typer) -> None:
    command(group, "template")(template_command)
    command(group, "photo")(photo_command)
    command(group, "points")(points_command)
    command(group, "ground")(ground_command)
    command(group, "features")(features_command)
    command(group, "fiducials")(fiducials_command)
    command(group, "ticks")(ticks_command)


def template_command(
    invocation: Invocation,
    template: Annotated[str, typer.Argument(metavar="TEMPLATE", autocompletion=templates)],
    instrument: Instrument,
    orienting: Orienting,
    stage: Annotated[Literal["UPPER", "LOWER"] | None, typer.Option("--stage", help="Where it is mounted.")] = None,
    dry_run: DryRunOption = False,
) -> None:
    """Digitise the tick marks of a template that has been mounted.

    Example: orip digitise template LEFT --link tcp://127.0.0.1:4788
    """
    from orip.multimodel.commands.output import tell_digitised
    from orip.multimodel.digitising.marks import digitise_template

    found = digitise_template(
        instrument.setup(invocation, orienting.log, dry_run=dry_run),
        template,
        kind=orienting.transformation,
        stage=stage,
        again=orienting.again,
        chosen=_marks(orienting.mark),
    )
    tell_digitised(invocation.terminal, "digitise template", found)


def photo_command(
    invocation: Invocation,
    instrument: Instrument,
    orienting: Orienting,
    photos: Annotated[list[str] | None, typer.Argument(metavar="PHOTO", autocompletion=photos)] = None,
    template: Annotated[str | None, typer.Option("--template", help="All photos on that template.")] = None,
    start: Annotated[str | None, typer.Option("--from", metavar="PHOTO", help="Begin with this one.")] = None,
    dry_run: DryRunOption = False,
) -> None:
    """Digitise the fiducial marks of photos.

    Example: orip digitise photo --template LEFT --link tcp://127.0.0.1:4788
    """
    from orip.multimodel.commands.output import tell_digitised
    from orip.multimodel.digitising.marks import digitise_photos

    found = digitise_photos(
        instrument.setup(invocation, orienting.log, dry_run=dry_run),
        photos or (),
        template=template,
        kind=orienting.transformation,
        again=orienting.again,
        start=start,
        chosen=_marks(orienting.mark),
    )
    tell_digitised(invocation.terminal, "digitise photo", found)


def points_command(
    invocation: Invocation,
    instrument: Instrument,
    bundle: BundleArgument = None,
    photo: Annotated[
        list[str] | None,
        typer.Option(
            "--photo",
            autocompletion=photos,
            help="In that photo; may be repeated.",
        ),
    ] = None,
    point: Annotated[
        list[str] | None,
        typer.Option(
            "--point",
            autocompletion=points,
            help="That point; may be repeated.",
        ),
    ] = None,
    model: Annotated[str | None, typer.Option("--model", help="In the photos of that model.")] = None,
    stereo: Annotated[
        bool | None, typer.Option("--stereo/--mono", help="Two photos at once; default where there are models.")
    ] = None,
    log: LogOption = LOG,
    again: AgainOption = False,
    start: Annotated[str | None, typer.Option("--from", metavar="POINT", help="Begin with this one.")] = None,
    listed: ListOption = None,
    only: OnlyOption = None,
    new: NewOption = False,
    first: FirstOption = "1",
    online: Annotated[
        bool, typer.Option("--online", help="Test each point at once, as 'orip online' does, and show a page.")
    ] = False,
    dry_run: DryRunOption = False,
) -> None:
    """Digitise photo points: named or listed ones, else all that should be seen and are not measured yet.

    With --new the operator goes from model to model, and selects and names points himself.

    Example: orip digitise points --list again.txt --link tcp://127.0.0.1:4788
    """
    from orip.multimodel.commands.output import tell_digitised
    from orip.multimodel.digitising.new_points import NewPointsChoice, digitise_new_points
    from orip.multimodel.digitising.points import Viewing, digitise_points
    from orip.multimodel.digitising.wanted import PointChoice

    setup = instrument.setup(invocation, log, dry_run=dry_run)
    viewing: Viewing | None = None if stereo is None else "stereo" if stereo else "mono"
    answered = annex(MEASURING_ONLINE).answered_online(invocation, bundle) if online and not dry_run else nullcontext()
    with answered as written:
        if new:
            _refuse_with_new({"--point": point, "--list": listed, "--again": again, "--from": start, "--only": only})
            chosen = NewPointsChoice(tuple(photo or ()), model, first)
            found = digitise_new_points(setup, bundle, chosen, viewing=viewing, written=written)
        else:
            choice = PointChoice(tuple(photo or ()), model, tuple(point or ()), listed, again, only)
            found = digitise_points(setup, bundle, choice, viewing=viewing, start=start, written=written)
    tell_digitised(invocation.terminal, "digitise points", found)


def _refuse_with_new(options: dict[str, object]) -> None:
    given = [name for name, value in options.items() if value]
    if given:
        message = f"--new measures points that the operator names; leave {', '.join(given)} out"
        raise UsageError(message)


def fiducials_command(
    invocation: Invocation,
    camera: Annotated[str, typer.Argument(metavar="CAMERA", autocompletion=cameras)],
    instrument: Instrument,
    marks: RecordMarks,
    names: NamesArgument = None,
    arrangement: Annotated[
        Literal["corners", "midsides"], typer.Option("--at", help="Where the four marks of the system are.")
    ] = "corners",
) -> None:
    """Digitise the fiducial marks (reseau crosses, corners) of a camera, for its record.

    Example: orip digitise fiducials REFLEX35 --at midsides --link tcp://127.0.0.1:4788
    """
    from orip.multimodel.commands.output import tell_digitised
    from orip.multimodel.digitising.record_marks import digitise_fiducials

    setup = instrument.setup(invocation, marks.log)
    found = digitise_fiducials(setup, camera, arrangement, marks.stage, names or ())
    tell_digitised(invocation.terminal, "digitise fiducials", found)


def ticks_command(
    invocation: Invocation,
    temtick: Annotated[str, typer.Argument(metavar="TEMTICK")],
    instrument: Instrument,
    marks: RecordMarks,
    names: NamesArgument = None,
) -> None:
    """Digitise the tick marks of templates, for their temtick record; plate coordinates are taken as they are.

    Example: orip digitise ticks SHEET --link tcp://127.0.0.1:4788
    """
    from orip.multimodel.commands.output import tell_digitised
    from orip.multimodel.digitising.record_marks import digitise_ticks

    setup = instrument.setup(invocation, marks.log)
    found = digitise_ticks(setup, temtick, marks.stage, names or ())
    tell_digitised(invocation.terminal, "digitise ticks", found)


def ground_command(
    invocation: Invocation,
    instrument: Instrument,
    model: Annotated[str, typer.Option("--model", help="The oriented model that is used.")],
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            autocompletion=points,
            help="Points to set the mark on.",
        ),
    ] = None,
    target: Annotated[
        Literal["PNT", "PRE"], typer.Option("--to", help="Control points or preliminary coordinates.")
    ] = "PRE",
    error: Annotated[float | None, typer.Option("--error", help="A-priori error of control points.")] = None,
    first: Annotated[str | None, typer.Option("--first", metavar="NAME", help="Number points: 1000, 1001 ...")] = None,
    listed: ListOption = None,
    bundle: BundleOption = None,
) -> None:
    """Take ground coordinates from a model of the last adjustment.

    Example: orip digitise ground --model 1-1 --first 5000 --link tcp://127.0.0.1:4788
    """
    from orip.multimodel.commands.output import tell_ground
    from orip.multimodel.digitising.new_points import GroundChoice, digitise_ground

    setup = instrument.setup(invocation, LOG)
    choice = GroundChoice(model, target, tuple(names or ()), listed, first, error)
    tell_ground(invocation.terminal, digitise_ground(setup, bundle, choice))


def features_command(
    invocation: Invocation,
    codes: Annotated[list[str], typer.Argument(metavar="KIND:CODE", help="POINT, LINE or AREA; key 1 is the first.")],
    instrument: Instrument,
    file: Annotated[Path, typer.Option("--file", metavar="FILE", help="For 'orip restitute compute'.")] = STEREO_FILE,
    model: Annotated[str | None, typer.Option("--model", help="Begin in that model.")] = None,
    first: Annotated[str, typer.Option("--first", metavar="NAME", help="Number features from here.")] = "1",
    bundle: BundleOption = None,
) -> None:
    """Collect points, lines and areas with codes; models change at their frame lines.

    Example: orip digitise features LINE:ROAD POINT:TREE --link tcp://127.0.0.1:4788
    """
    from orip.multimodel.commands.output import tell_digitised
    from orip.multimodel.digitising.features import FeaturesChoice, digitise_features, feature_codes

    if instrument.simulate:
        message = "measurement files have no features; leave --simulate out, and give --script for an operator"
        raise UsageError(message)
    choice = FeaturesChoice(feature_codes(codes), file, model, first)
    found = digitise_features(instrument.setup(invocation, LOG), bundle, choice)
    tell_digitised(invocation.terminal, "digitise features", found, following=f"orip restitute compute {found.log}")


def _screen() -> Screen:
    from orip.multimodel.digitising.screen import Screen

    def write(text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()

    return Screen("digitise", write)


def _marks(words: list[str] | None) -> list[MarkChoice]:
    from orip.multimodel.digitising.wanted import MarkChoice

    found = []
    for word in words or ():
        name, *coordinates = word.split(",")
        try:
            xy = tuple(map(float, coordinates))
        except ValueError:
            xy = ()
        if not name or len(coordinates) != len(xy) or len(xy) not in (0, 2) or not all(map(isfinite, xy)):
            message = (
                f"'{word}' is not a mark; write its name, or of a new mark NAME,X,Y in mm, for example 9,10.0,220.0"
            )
            raise UsageError(message)
        found.append(MarkChoice(name, (xy[0], xy[1]) if xy else None))
    return found
