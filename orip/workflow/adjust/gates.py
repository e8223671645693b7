"""`orip check`: the gates of orip.toml and of the command line held against the last adjustment."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from orip.bundle.figures import figure
from orip.errors import Complaint, InputError, ProjectWarning, UsageError
from orip.files.project.toml_lines import TomlLines
from orip.files.stores import solutions
from orip.files.stores.transaction import reading
from orip.files.text.gate import parse_gate
from orip.files.text.lines import read_lines
from orip.records.gate import GATE_FIGURES, Gate, GateResult
from orip.records.solution import Solution, Status
from orip.workflow.project.folder import Project, open_project
from orip.workflow.project.texts import raise_complaints
from orip.workflow.status import project_status

_ALIKE = 0.4
"""Likeness of a name above which it is offered as what may have been meant; tried on slips of the hand."""


@dataclass(frozen=True, slots=True)
class CheckOutcome:
    """What the gates say of the last adjustment of a bundle.

    Parameters
    ----------
    bundle, run : str
    status : Status
    results : tuple of GateResult
        Those of orip.toml first, each gate once.
    warnings : tuple of ProjectWarning
    """

    bundle: str
    run: str
    status: Status
    results: tuple[GateResult, ...]
    warnings: tuple[ProjectWarning, ...]

    @property
    def solved(self) -> bool:
        """Tell whether the adjustment came to an end by itself."""
        return self.status in {"converged", "doubtful"}

    @property
    def failed(self) -> int:
        """Return how many gates failed."""
        return sum(not each.passed for each in self.results)


def check(folder: Path, bundle: str | None, expressions: Sequence[str]) -> CheckOutcome:
    """Hold gates against the last solution of a bundle. Reads only.

    Parameters
    ----------
    folder : Path
    bundle : str or None
        None: the project's only one.
    expressions : sequence of str
        ``name operator number`` each; those of orip.toml are checked too.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, or a gate of orip.toml is malformed.
    UsageError
        If an expression is malformed, or there is no gate at all.
    """
    project = open_project(folder)
    name = project.bundle_name(bundle)
    gates = project_gates(project, expressions)
    if not gates:
        message = "there is no gate to check; give one, such as 'sigma0<=1.5', or write [check] gates in orip.toml"
        raise UsageError(message)
    with reading([project.exterior]) as stores:
        solution = solutions.read(stores[project.exterior], name)
    if solution is None:
        message = f"bundle {name} has not been adjusted yet; run 'orip solve' first"
        raise InputError.single(message)
    warnings = tuple(_out_of_date(project, name))
    return CheckOutcome(name, solution.run, solution.status, check_solution(solution, gates), warnings)


def project_gates(project: Project, expressions: Sequence[str] = ()) -> tuple[Gate, ...]:
    """Return the gates of orip.toml, then those of the command line, each once.

    Raises
    ------
    InputError
        With every malformed gate of orip.toml.
    UsageError
        If an expression of the command line is malformed.
    """
    given = gates_from(expressions)
    gates, complaints = [], []
    for index, text in enumerate(project.definition.gates):
        try:
            gates.append(parse_gate(text))
        except ValueError as error:
            message = f"gates of [check]: {error}"
            complaints.append(Complaint(message, project.shown(project.text), _line(project, index)))
    raise_complaints(complaints)
    return tuple(dict.fromkeys((*gates, *given)))


def gates_from(expressions: Iterable[str]) -> tuple[Gate, ...]:
    """Return the gates of a command line.

    Raises
    ------
    UsageError
        If one is malformed.
    """
    try:
        return tuple(map(parse_gate, expressions))
    except ValueError as error:
        message = f"{error}; the shell needs the quotes"
        raise UsageError(message) from None


def check_solution(solution: Solution, gates: Iterable[Gate | str]) -> tuple[GateResult, ...]:
    """Hold gates against a solution; texts are those of a command line.

    A gate whose figure is unknown, NaN or infinite fails.

    Raises
    ------
    UsageError
        If a text is malformed.
    """
    wanted = [gate if isinstance(gate, Gate) else gates_from([gate])[0] for gate in gates]
    return tuple(_checked(solution, gate) for gate in wanted)


def _checked(solution: Solution, gate: Gate) -> GateResult:
    if gate.name not in GATE_FIGURES:
        return GateResult(gate, math.nan, passed=False, reason=_unknown(gate.name))
    value = figure(solution, gate.name)
    reason = ""
    if math.isnan(value):
        reason = "the solution has no such figure"
    elif math.isinf(value):
        reason = "not determined"
    return GateResult(gate, value, gate.holds(value), reason)


def _unknown(name: str) -> str:
    near = difflib.get_close_matches(name.lower()[:100], GATE_FIGURES, 1, _ALIKE)
    guess = f"did you mean {near[0]}? " if near else ""
    return f"no figure is called so; {guess}'orip check --help' lists all"


def _line(project: Project, index: int) -> int:
    text = "\n".join(read_lines(project.text, project.shown(project.text)).records)
    return TomlLines(text).line_of(("check", "gates", index))


def _out_of_date(project: Project, bundle: str) -> Iterable[ProjectWarning]:
    """Warn if the solution is not that of the project as it is now."""
    for step in project_status(project.folder).steps:
        if step.command in {"orip solve", f"orip solve {bundle}"} and step.state == "out of date":
            yield ProjectWarning("out-of-date", f"bundle {bundle}", f"the last adjustment is out of date: {step.text}")
