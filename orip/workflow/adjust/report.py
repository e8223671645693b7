"""`orip report`: the report of the last adjustment of a bundle."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from msgspec import Struct

from orip.progress import stage
from orip.records.results.result_tests import GateResult
from orip.records.results.solution import Solution
from orip.report.page import report_page
from orip.report.report_input import ReportInput
from orip.workflow.adjust.gates import check_solution, project_gates
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change
from orip.workflow.project.named_output import first_bytes, require_replaceable
from orip.workflow.project.state import Part, ProjectState
from orip.workflow.project.text_output import TextOutput
from orip.workflow.project.texts import Digests, is_measurement_file

REPORTED_FROM: tuple[Part, ...] = ("definitions", "replay")
"""What a report needs of the stores besides the solution."""

_REMEDY = "the page alone is missing; remove the cause, or choose another file: orip report --output FILE"


class WrittenReport(Struct, frozen=True):
    """A report: its bundle and run, its path, that as messages show it, and its size in bytes."""

    bundle: str
    run: str
    path: Path
    shown: str
    size: int


def report(bundle: BundleState, output: Path | None, *, force: bool = False) -> Change[WrittenReport]:
    """Make the report of the last adjustment of a bundle, with the gates of orip.toml.

    Parameters
    ----------
    bundle : BundleState
        With `REPORTED_FROM` and solutions.
    output : Path or None
        None: report.html in the project folder, NAME_report.html where there are several bundles.
    force : bool
        Also in the place of a file that is no earlier report.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, or a gate of orip.toml is malformed.
    UsageError
        If another file would be replaced.
    """
    gates = project_gates(bundle.project)
    change = report_of(bundle.state, bundle.adjusted, check_solution(bundle.adjusted, gates), output)
    usual = (bundle.project.report(bundle.name),)
    for written in change.outputs:
        begins = first_bytes(written.pieces())
        require_replaceable(bundle.project, written.path, force=force, usual=usual, begins=begins)
    return change


def report_of(
    state: ProjectState, solution: Solution, gates: Iterable[GateResult], output: Path | None = None
) -> Change[WrittenReport]:
    """Make the report of a solution, which need not be stored; the state has `REPORTED_FROM`."""
    project = state.project
    path = output if output is not None else project.report(solution.bundle)
    with stage("report"):
        definition = state.definitions.bundle(solution.bundle)
        records, header = state.records, project.definition
        given = ReportInput(
            solution, tuple(gates), definition, records.cameras, records.photos, records.templates, header.report,
            header.crs, _measurement_files(state), header.test_level,
        )  # fmt: skip
        text = report_page(given)
    written = WrittenReport(solution.bundle, solution.run, path, project.shown(path), len(text.encode()))
    return Change(state, written, outputs=(TextOutput(path, lambda: [text], _REMEDY),))


def _measurement_files(state: ProjectState) -> Digests:
    """Return the measurement files that were replayed last, with their digests."""
    project = state.project
    return tuple((name, digest) for name, digest in state.replay.inputs if is_measurement_file(project, Path(name)))
