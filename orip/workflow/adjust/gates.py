"""Gates: those of orip.toml and of the command line, checked against a solution."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence

from orip.bundle.results.figures import figure
from orip.errors import Complaint, UsageError
from orip.files.project.toml_lines import TomlLines
from orip.files.text.decimal_numbers import GATE_FORM, parse_gate
from orip.files.text.lines import read_lines
from orip.files.text.shown import shown_token
from orip.records.results.solution import Solution
from orip.records.results.tests import GATE_FIGURES, Gate, GateResult
from orip.wording import joined
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.texts import raise_complaints

_ALIKE = 0.4
"""Similarity above which a name is suggested; determined by trial with typing errors."""


def project_gates(project: ProjectFolder, expressions: Sequence[str] = ()) -> tuple[Gate, ...]:
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
        With all that are malformed.
    """
    gates, malformed = [], []
    for text in expressions:
        try:
            gates.append(parse_gate(text))
        except ValueError:
            malformed.append(f"'{shown_token(text)}'")
    if malformed:
        what = "is not a gate" if len(malformed) == 1 else "are not gates"
        message = f"{joined(malformed)} {what}; write {GATE_FORM}; the shell needs the quotes"
        raise UsageError(message)
    return tuple(gates)


def check_solution(solution: Solution, gates: Iterable[Gate | str]) -> tuple[GateResult, ...]:
    """Check gates of a command line against a solution.

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
    return f"there is no figure of this name; {guess}'orip check --help' lists all"


def _line(project: ProjectFolder, index: int) -> int:
    text = "\n".join(read_lines(project.text, project.shown(project.text)).value)
    return TomlLines(text).line_of(("check", "gates", index))
