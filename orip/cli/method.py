"""How a bundle is adjusted, as options, and what the terminal shows of its adjustment."""

from __future__ import annotations

import shlex
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from orip.cli.terminal import Style, Terminal
from orip.errors import INTERRUPTED, GateError, NotSolvableError, ProjectWarning, UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from orip.bundle.methods import Method
    from orip.bundle.verdict import Level
    from orip.records.block import Block
    from orip.records.preliminary import PreliminaryValues
    from orip.records.results.solution import IterationPass
    from orip.solving.solve import SolveWatcher
    from orip.workflow.adjust.solve import SolveOutcome
    from orip.workflow.project.commit import Committed


Snoop = Annotated[
    bool, typer.Option("--snoop", help="Search for blunders and leave them out, instead of reducing weights.")
]
Sigma0 = Annotated[
    Literal["apriori", "posteriori"] | None,
    typer.Option("--sigma0", help="With --snoop: sigma0 is 1 (apriori, default), or estimated (posteriori)."),
]
Alpha = Annotated[
    float | None,
    typer.Option(
        "--alpha",
        min=1e-9,
        max=0.5,
        help="With --snoop: error probability of one test (default: 0.05 of all together).",
    ),
]
Prune = Annotated[
    bool, typer.Option("--prune", help="Hold camera parameters that are not significant at zero, one after the other.")
]
VarianceComponents = Annotated[
    bool,
    typer.Option(
        "--variance-components",
        help="Estimate the a-priori error of each group of observations, and adjust with these errors.",
    ),
]
Check = Annotated[
    list[str] | None,
    typer.Option("--check", metavar="EXPR", help="A gate such as 'sigma0<=1.5'; exit code 5 if it fails. Repeatable."),
]


class MethodOptions(NamedTuple):
    """How to adjust, as given on the command line."""

    snoop: Snoop = False
    sigma0: Sigma0 = None
    alpha: Alpha = None
    prune: Prune = False
    variance_components: VarianceComponents = False
    check: Check = None

    def method(self) -> Method:
        """Return the method of the adjustment.

        Raises
        ------
        UsageError
            If settings of data snooping are given without it.
        """
        from orip.bundle.methods import Method

        if not self.snoop and (self.sigma0 is not None or self.alpha is not None):
            message = "--sigma0 and --alpha need --snoop; add --snoop, or leave them out"
            raise UsageError(message)
        if not self.snoop:
            return Method(None, self.prune, self.variance_components)
        from orip.bundle.snooping.search import SnoopingSettings

        return Method(SnoopingSettings(self.sigma0 or "apriori", self.alpha), self.prune, self.variance_components)


_VERDICT_STYLES: dict[Level, Style] = {"good": "bold", "caution": "bold yellow", "bad": "bold red"}
_STYLES: dict[Level, Style | None] = {"good": None, "caution": "yellow", "bad": "red"}

REMINDERS = {"crs-without-heights"}
"""Codes of warnings that are printed after the summary: what the adjustment shows is said first."""

_HEADING = "         iteration      ENP  down-weighted  singular       sigma0"
_NARROW_HEADING = "pass    ENP   down  sing      sigma0"
"""Heading of pass lines on a terminal that is too narrow for the other one."""


AllPhotos = Annotated[
    bool, typer.Option("--all", help="Exit code 4 if a photo could not be oriented and was left out.")
]


def solve_watcher(terminal: Terminal) -> SolveWatcher:
    """Return what shows the progress of an adjustment on the terminal and lets Ctrl-C stop it."""
    from orip.solving.solve import SolveWatcher
    from orip.workflow.status import not_compiled

    terminal.warn(not_compiled())
    return SolveWatcher(
        oriented=partial(tell_preliminary_values, terminal),
        doubted=partial(tell_doubt, terminal),
        replaced=lambda _values: None,
        started=partial(tell_start, terminal),
        passed=partial(tell_pass, terminal),
        stoppable=partial(stopping, terminal),
    )


@contextmanager
def stopping(terminal: Terminal) -> Iterator[Callable[[], bool]]:
    """Make the first Ctrl-C stop the adjustment after the current iteration; a second one interrupts at once."""
    asked = False

    def ask(_signal: int, _frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        terminal.say("stopping after this iteration (Ctrl-C again to give up at once)", "yellow")

    before = signal.signal(signal.SIGINT, ask)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)


def tell_preliminary_values(terminal: Terminal, values: PreliminaryValues) -> None:
    """Say that preliminary values were missing, and what was found of them."""
    oriented = sum(photo.rotation is not None for photo in values.photos)
    terminal.say(
        f"prelim   preliminary values were missing: {oriented} of {len(values.photos)} photos oriented, "
        f"{len(values.points)} points ('orip prelim' shows how)"
    )
    for photo in values.photos:
        terminal.detail(f"         {photo.name}: {photo.how}")
    for camera in values.cameras:
        terminal.detail(f"         camera {camera.name}: starts with C {camera.parameters[0]:.3f}")


def tell_doubt(terminal: Terminal, doubt: str) -> None:
    """Say that the adjustment from given values is repeated from others, and why."""
    terminal.say(f"prelim   from the given values the adjustment {doubt}; now from orip's own preliminary values")


def tell_start(terminal: Terminal, block: Block) -> None:
    """Say what is adjusted, and head the pass lines."""
    points = len(block.photo_points.photo)
    terminal.say(
        f"solve    {block.definition.name}: {len(block.photos)} photos, {len(block.point_names)} points, "
        f"{points} photo points"
    )
    terminal.say(_NARROW_HEADING if _is_narrow(terminal) else _HEADING, "dim")


def tell_pass(terminal: Terminal, row: IterationPass) -> None:
    """Print a pass line."""
    mark = " *" if row.step_limited else ""
    if _is_narrow(terminal):
        line = f"{row.iteration:4d} {row.enp:6.1f} {row.down_weighted:6d} {row.singular:5d} {row.sigma0:11.4f}"
    else:
        line = (
            f"         {row.iteration:9d}  {row.enp:7.1f}  {row.down_weighted:13d}  {row.singular:8d}  "
            f"{row.sigma0:11.4f}"
        )
    terminal.say(f"{line}{mark}")


def _is_narrow(terminal: Terminal) -> bool:
    return terminal.columns is not None and terminal.columns < len(_HEADING) + len(" *")


def tell_solution(terminal: Terminal, solved: Committed[SolveOutcome]) -> None:
    """Print the summary of an adjustment: it is the command's result, warnings are not."""
    from orip.report.summary import summary

    outcome = solved.outcome
    solution = outcome.solution
    warnings = [ProjectWarning(*row) for row in solution.warnings]
    terminal.warn(warning for warning in warnings if warning.code not in REMINDERS)
    project, files = outcome.project, outcome.files
    for line in summary(solution, outcome.gates, project.shown(files[1]), project.definition.test_level):
        style = None if line.level is None else _STYLES[line.level]
        if line.label == "status":
            terminal.result(line.label, line.text, _VERDICT_STYLES[line.level or "good"])
        else:
            terminal.result(line.label, line.text, style)
    if outcome.worst:
        terminal.result("look", _where_to_look(terminal, project.folder, *outcome.worst))
    terminal.warn(warning for warning in warnings if warning.code in REMINDERS)
    same = "" if solved.changed else "; unchanged: the store holds this solution already"
    terminal.result("wrote", f"{', '.join(project.shown(path) for path in files)}{same}")


def _where_to_look(terminal: Terminal, folder: Path, photo: str, point: str) -> str:
    """Return how to see the worst misfit: by the command, or on the page that is open already."""
    from urllib.parse import urlencode

    from orip.workflow.open_screen import open_screen

    page = open_screen(folder)
    if not page:
        return f"orip screen --at {shlex.quote(f'{photo}/{point}')} shows the worst misfit in its picture"
    # whoever else reads the output could measure by the address
    where = f"{page}#{urlencode({'photo': photo, 'point': point})}" if terminal.is_terminal else "the open orip screen"
    return f"{where} shows the worst misfit, {point} in {photo}, in its picture"


def exit_code(outcome: SolveOutcome, *, all_wanted: bool) -> int:
    """Return the exit code of an adjustment; `all_wanted`: no photo may have been left out."""
    status = outcome.solution.status
    if status == "stopped":
        return INTERRUPTED
    if status in ("not_converged", "not_determined") or (all_wanted and outcome.left_out):
        return NotSolvableError.exit_code
    return 0 if all(gate.passed for gate in outcome.gates) else GateError.exit_code
