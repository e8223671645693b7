"""What the terminal shows of an adjustment: pass lines while it runs, then the summary."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from orip.cli.exits import INTERRUPTED
from orip.cli.terminal import Style, Terminal
from orip.errors import GateError, NotSolvableError, ProjectWarning

if TYPE_CHECKING:
    from orip.model.block import Block
    from orip.model.preliminary import PreliminaryValues
    from orip.model.solution import IterationPass, Solution
    from orip.workflow.solve import SolveWatcher
    from orip.workflow.solve_checked import CheckedSolve

_STATUS_STYLE: dict[str, Style] = {"converged": "green", "doubtful": "yellow", "not_converged": "red", "stopped": "red"}
_SHOWN_DIAGNOSES = 10


def solve_watcher(terminal: Terminal) -> SolveWatcher:
    """Return who tells the terminal of an adjustment and lets Ctrl-C stop it."""
    from orip.workflow.solve import SolveWatcher

    return SolveWatcher(
        oriented=partial(tell_preliminary_values, terminal),
        started=partial(tell_start, terminal),
        passed=partial(tell_pass, terminal),
        stoppable=partial(stopping, terminal),
    )


@contextmanager
def stopping(terminal: Terminal) -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C into a wish to stop after the iteration in hand; a second one interrupts at once."""
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


@contextmanager
def limited_threads(terminal: Terminal) -> Iterator[None]:
    """Limit the threads of the linear algebra: small systems are slower with more, and one repeats to the last bit."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=terminal.threads):
        yield


def tell_preliminary_values(terminal: Terminal, values: PreliminaryValues) -> None:
    """Say that preliminary values were missing, and what was found of them."""
    oriented = sum(photo.rotation is not None for photo in values.photos)
    terminal.say(
        f"prelim   preliminary values were missing: {oriented} of {len(values.photos)} photos oriented, "
        f"{len(values.points)} points ('orip prelim' shows how)"
    )
    for photo in values.photos:
        terminal.detail(f"         {photo.name}: {photo.how}")


def tell_start(terminal: Terminal, block: Block) -> None:
    """Say what is adjusted, and head the pass lines."""
    points = len(block.photo_points.photo)
    terminal.say(
        f"solve    {block.definition.name}: {len(block.photos)} photos, {len(block.point_names)} points, "
        f"{points} photo points"
    )
    terminal.say("         iteration      ENP  down-weighted  singular       sigma0", "dim")


def tell_pass(terminal: Terminal, each: IterationPass) -> None:
    """Print a pass line."""
    mark = " *" if each.step_limited else ""
    terminal.say(
        f"         {each.iteration:9d}  {each.enp:7.1f}  {each.down_weighted:13d}  {each.singular:8d}  "
        f"{each.sigma0:11.4f}{mark}"
    )


def tell_solution(terminal: Terminal, checked: CheckedSolve) -> None:
    """Print the summary of an adjustment."""
    outcome = checked.outcome
    solution = outcome.solution
    terminal.warn(ProjectWarning(*row) for row in solution.warnings)
    same = "" if outcome.changed else "; unchanged: the store holds this solution already"
    terminal.say(f"status   {solution.status.replace('_', ' ')}{same}", _STATUS_STYLE[solution.status])
    terminal.say(
        f"sigma0   {solution.sigma0:.4f} (all observations {solution.sigma0_all:.4f}), "
        f"redundancy {solution.redundancy}, {solution.observations} observations, {solution.unknowns} unknowns"
    )
    _tell_check_points(terminal, solution)
    for each in solution.diagnosis[:_SHOWN_DIAGNOSES]:
        terminal.say(f"note     {each.text}: {each.remedy}", "yellow")
    if (more := len(solution.diagnosis) - _SHOWN_DIAGNOSES) > 0:
        terminal.say(f"         and {more} more notes: see {outcome.project.shown(outcome.files[1])}")
    for gate in checked.gates:
        terminal.say(f"gate     {gate}", None if gate.passed else "red")
    for path in outcome.files:
        terminal.say(f"wrote    {outcome.project.shown(path)}")


def exit_code(checked: CheckedSolve) -> int:
    """Return the exit code that an adjustment deserves."""
    status = checked.outcome.solution.status
    if status == "stopped":
        return INTERRUPTED
    if status == "not_converged":
        return NotSolvableError.exit_code
    return 0 if all(gate.passed for gate in checked.gates) else GateError.exit_code


def _tell_check_points(terminal: Terminal, solution: Solution) -> None:
    points = solution.check_points
    if not points:
        return
    import numpy as np

    differences = np.array([(point.dX, point.dY, point.dZ) for point in points])
    plan = np.sqrt(np.nanmean(differences[:, :2] ** 2)) if np.isfinite(differences[:, :2]).any() else float("nan")
    height = np.sqrt(np.nanmean(differences[:, 2] ** 2)) if np.isfinite(differences[:, 2]).any() else float("nan")
    terminal.say(
        f"check    {len(points)} check points, RMS {plan:.3f} {solution.ground_unit} (XY), "
        f"{height:.3f} {solution.ground_unit} (Z)"
    )
