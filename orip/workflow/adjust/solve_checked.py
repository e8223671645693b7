"""An adjustment with the gates that it has to pass, those of orip.toml and those of the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from orip.bundle.methods import Method
from orip.records.gate import GateResult
from orip.workflow.adjust.gates import check_solution, project_gates
from orip.workflow.adjust.solve import SolveOutcome, SolveWatcher, solve
from orip.workflow.project.folder import open_project


@dataclass(frozen=True, slots=True)
class CheckedSolve:
    """An adjustment, and what its gates say."""

    outcome: SolveOutcome
    gates: tuple[GateResult, ...]


def solve_checked(
    folder: Path, bundle: str | None, watcher: SolveWatcher, method: Method, expressions: Sequence[str]
) -> CheckedSolve:
    """Adjust one bundle, see `orip.workflow.adjust.solve.solve`, and hold its gates against the solution.

    Parameters
    ----------
    expressions : sequence of str
        Gates of the command line; malformed ones are refused before anything is computed.

    Raises
    ------
    InputError, NotSolvableError, LockedError, UsageError
    """
    gates = project_gates(open_project(folder), expressions)
    outcome = solve(folder, bundle, watcher, method)
    return CheckedSolve(outcome, check_solution(outcome.solution, gates))
