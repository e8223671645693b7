"""The commands of orip by their names, each loaded when it is asked for: a call needs one of them, `--help` none."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple

import typer
from typer.main import get_group

from orip.annexes import COMMANDS as COMMANDS_OF_ANNEXES
from orip.cli.conversion import Group


class Listed(NamedTuple):
    """What `orip --help` says of a command, and the modules that register it; none for those of annexes."""

    text: str
    modules: tuple[str, ...]


COMMANDS: Mapping[str, Listed] = {
    "init": Listed(
        "Apply orip.toml to the record stores; or make a project, new or a sample. Safe to repeat.", ("project.init",)
    ),
    "new": Listed(
        "Make a project with commented texts to fill in: camera, photos, control, measurements.", ("project.new",)
    ),
    "measure": Listed(
        "Replay the measurement files into orientations and photo observations; write INTERIOR_RESULT.OUT.",
        ("observations.measure",),
    ),
    "solve": Listed(
        "Adjust a bundle; write result.json, residuals.csv, BUNDLE_RESULT.OUT, BUNDLE_ERROR.OUT and report.html.",
        ("adjust.solve",),
    ),
    "run": Listed(
        "Do the whole project: init, measure, preliminary values, solve all bundles, drive tables, reports.",
        ("project.run",),
    ),
    "status": Listed(
        "Show what the project has, what is out of date, and what comes next. Reads only.", ("project.status",)
    ),
    "results": Listed(
        "Show cameras, photos, points, theodolites (zero directions) or residuals of the last adjustment.",
        ("adjust.results",),
    ),
    "report": Listed(
        "Write the report of the last adjustment: one HTML page that needs no network.", ("adjust.report",)
    ),
    "online": Listed(
        "Check measurements as they are made and report wrong ones immediately.",
        (),
    ),
    "update": Listed(
        "Take values of the last adjustment as preliminary values, but only those of its unknowns.", ("adjust.update",)
    ),
    "check": Listed(
        "Check gates against the last adjustment: exit code 5 if one fails, 4 if it did not converge.",
        ("adjust.check",),
    ),
    "compare": Listed(
        "Compare the figures of two results: exit code 0 if they are equal within the tolerance, 5 if not.",
        ("adjust.compare",),
    ),
    "dump": Listed("Print a record store as canonical text: equal data give equal text.", ("project.stores",)),
    "load": Listed("Replace a record store's content by that of a dump, all or nothing.", ("project.stores",)),
    "export-toml": Listed("Bring the record stores into the text: a complete orip.toml.", ("project.export_toml",)),
    "import": Listed("Make a project folder of a project of another program.", ()),
    "export": Listed("Write the result of the last adjustment in the format of another program.", ()),
    "adjust": Listed(
        "Adjust a project of another program: import, run, report, and the result written back, in one command.",
        (),
    ),
    "prelim": Listed(
        "Preliminary values of photos and points, from measurements and control only.", ("adjust.prelim",)
    ),
    "drive": Listed("Drive in the oriented block: the drive table and the plate processor.", ()),
    "digitise": Listed(
        "Measure through the plate processor: it drives, the operator sets the mark and presses the foot switch.",
        (),
    ),
    "observations": Listed(
        "Photo observations: list, disregard, include, kill, measure again.", ("observations.commands",)
    ),
    "camera": Listed(
        "Cameras: principal distance and point, distortion, fiducial marks.",
        ("records.commands", "records.camera_plot"),
    ),
    "temtick": Listed("Tick marks of kinds of templates.", ("records.commands",)),
    "photo": Listed("Photos: camera, template, preliminary orientation.", ("records.commands",)),
    "template": Listed("Templates: tick marks, stage plate, photos on them.", ("records.commands",)),
    "bundle": Listed("Bundle adjustments: what controls them.", ("records.commands",)),
    "model": Listed("Stereo models of a bundle.", ("records.commands",)),
    "control": Listed(
        "Ground control and preliminary coordinates, line by line; comments and order of the files stay.", ("control",)
    ),
    "stations": Listed("Exposure stations from GNSS and INS.", ()),
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
