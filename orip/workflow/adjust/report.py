"""`orip report`: the report of the last adjustment of a bundle."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from orip.errors import InputError
from orip.files.stores import solutions
from orip.files.stores.transaction import reading
from orip.files.text.atomic import replace_text, reporting_failure
from orip.progress import stage
from orip.records.gate import GateResult
from orip.records.solution import Solution
from orip.report.page import report_page
from orip.report.report_input import ReportInput
from orip.workflow.adjust.gates import check_solution, project_gates
from orip.workflow.project.definitions import read_definitions
from orip.workflow.project.folder import Project, open_project


@dataclass(frozen=True, slots=True)
class WrittenReport:
    """A report that was written: of which bundle and run, where, as messages show it, and its size in bytes."""

    bundle: str
    run: str
    shown: str
    size: int


def report(folder: Path, bundle: str | None, output: Path | None) -> WrittenReport:
    """Write the report of the last adjustment of a bundle, with the gates of orip.toml.

    Parameters
    ----------
    folder : Path
    bundle : str or None
        None: the project's only one.
    output : Path or None
        None: report.html in the project folder, NAME_report.html where there are several bundles.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, or a gate of orip.toml is malformed.
    OripError
        If the file cannot be written.
    """
    project = open_project(folder)
    name = project.bundle_name(bundle)
    gates = project_gates(project)
    with reading([project.exterior]) as stores:
        solution = solutions.read(stores[project.exterior], name)
    if solution is None:
        message = f"bundle {name} has not been adjusted yet; run 'orip solve' first"
        raise InputError.single(message)
    return write_report(project, solution, check_solution(solution, gates), output)


def write_report(
    project: Project, solution: Solution, gates: Iterable[GateResult], output: Path | None = None
) -> WrittenReport:
    """Write the report of a solution that is at hand, as `report` does."""
    path = output if output is not None else project.report(solution.bundle)
    with stage("report"):
        text = report_page(_report_input(project, solution, tuple(gates)))
    consequence = "the page alone is missing; remove the cause, or choose another file: orip report --output FILE"
    with reporting_failure(project.shown(path), consequence):
        replace_text(path, text)
    return WrittenReport(solution.bundle, solution.run, project.shown(path), len(text.encode()))


def _report_input(project: Project, solution: Solution, gates: tuple[GateResult, ...]) -> ReportInput:
    with reading(project.record_stores) as stores:
        definitions = read_definitions(project, stores)
    known = definitions.by_name()
    return ReportInput(solution, gates, definitions.bundle(solution.bundle), known.cameras, known.photos)
