"""`orip status`: what the project has, what is out of date, and what comes next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from orip.errors import InputError, ProjectWarning
from orip.files.stores import solutions
from orip.files.stores.provenance import read_inputs
from orip.files.stores.transaction import Stores, reading
from orip.records.measurement import Measured
from orip.records.names import record_key
from orip.report.run_mark import run_of_page
from orip.wording import counted
from orip.workflow.adjust.bundle_input import stored_digests
from orip.workflow.drive.table import is_drive_table_current
from orip.workflow.observations.measure import measurement_inputs
from orip.workflow.project.definitions import StoredDefinitions, read_definitions
from orip.workflow.project.folder import Project, open_project
from orip.workflow.project.measurements import read_measured, runs_of_measurements
from orip.workflow.project.outputs import is_interior_listing_stale, outputs_of_other_names, stale_solution_outputs
from orip.workflow.project.texts import ground_digests, log_digests
from orip.workflow.records.apply_text import apply_text
from orip.workflow.records.reconcile import counted_changes

StepState = Literal["missing", "out of date", "up to date"]


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the work: its command, its state, and why."""

    command: str
    state: StepState
    text: str


@dataclass(frozen=True, slots=True)
class ProjectStatus:
    """The state of a project.

    Parameters
    ----------
    project : Project
    counts : tuple of (str, int)
        Cameras, templates, photos, bundles defined; photo points measured; names in the singular.
    steps : tuple of Step
        In the order of the work.
    next_command : str or None
        What comes next; None when everything is up to date.
    warnings : tuple of ProjectWarning
    """

    project: Project
    counts: tuple[tuple[str, int], ...]
    steps: tuple[Step, ...]
    next_command: str | None
    warnings: tuple[ProjectWarning, ...]


def project_status(folder: Path) -> ProjectStatus:
    """Return the state of a project; reads only.

    Raises
    ------
    InputError
        If orip.toml is missing or wrong, or a store is damaged.
    """
    project = open_project(folder)
    bundles = [bundle.name for bundle in project.definition.bundles]
    with reading([*project.record_stores, *(project.observations(name) for name in bundles)]) as stores:
        old_reports = list(_old_reports(project, stores))
        definitions = read_definitions(project, stores)
        steps = [_initialised(project, definitions), _measured(project, stores, definitions)]
        measured = read_measured(project, stores, bundles)
        steps += [_solved(project, stores, definitions, measured, name) for name in bundles]
        points = sum(len(each.points) for each in measured.observations.values())
    steps += [step for name in bundles if (step := _driven(project, name, steps)) is not None]
    counts = (
        ("camera", len(project.definition.cameras)),
        ("template", len(project.definition.templates)),
        ("photo", len(project.definition.photos)),
        ("bundle", len(bundles)),
        ("photo point", points),
    )
    following = next((step.command for step in steps if step.state != "up to date"), None)
    warnings = (*project.warnings, *_old_outputs(project), *old_reports)
    return ProjectStatus(project, counts, tuple(steps), following, warnings)


def observation_loop() -> str:
    """Return which loops over photo points this installation has."""
    from orip.bundle.compiled import photo_loop
    from orip.prelim import compiled

    both = photo_loop.is_compiled() and compiled.is_compiled()
    return "compiled" if both else "NumPy (slower: the extension was not built, as no C compiler was found)"


def _initialised(project: Project, definitions: StoredDefinitions) -> Step:
    applied = apply_text(project, definitions, prefer=None)
    if applied.complaints:
        text = f"changed both in orip.toml and in the stores: {len(applied.complaints)} of the records"
        return Step("orip init", "out of date", text)
    if applied.changes and not any((definitions.cameras, definitions.photos, definitions.bundles)):
        return Step("orip init", "missing", "orip.toml has not been applied to the stores")
    if applied.changes:
        return Step("orip init", "out of date", f"to be applied to the stores: {counted_changes(applied.changes)}")
    return Step("orip init", "up to date", "the stores hold what orip.toml says")


def _measured(project: Project, stores: Stores, definitions: StoredDefinitions) -> Step:
    command = "orip measure"
    log = log_digests(project)
    files = counted(len(log), "measurement file")
    runs = set(runs_of_measurements(project, stores))
    if runs == {None}:
        what = f"{files} to replay" if log else "there are no measurement files (*.MEA) yet"
        return Step(command, "missing", what)
    if len(runs) > 1:
        return Step(command, "out of date", "some of its stores are missing or come from elsewhere")
    applied = read_inputs(stores[project.photos], "measure")
    changed = _changed_inputs(applied, measurement_inputs(project, log, definitions))
    if changed:
        return Step(command, "out of date", f"changed since: {', '.join(changed)}")
    if is_interior_listing_stale(project, str(runs.pop())):
        shown = project.shown(project.interior_listing)
        return Step(command, "out of date", f"{shown} is missing or not of the last run; {_WRITTEN_BY}")
    return Step(command, "up to date", f"{files} in the stores")


def _solved(project: Project, stores: Stores, definitions: StoredDefinitions, measured: Measured, bundle: str) -> Step:
    command = "orip solve" if len(project.definition.bundles) == 1 else f"orip solve {bundle}"
    solution = solutions.read_head(stores[project.exterior], bundle)
    if solution is None:
        return Step(command, "missing", f"bundle {bundle} has not been adjusted")
    observations = measured.observations.get(record_key(bundle))
    if observations is None or record_key(bundle) not in definitions.by_name().bundles:
        return Step(command, "out of date", "its definition or photo observations are gone")
    digests = stored_digests(project, bundle, definitions, measured, observations)
    now = (*ground_digests(project, bundle), *digests, project.heading_digest)
    found = f"{solution.status.replace('_', ' ')}, sigma0 {solution.sigma0:.4f}"
    if changed := _changed_inputs(solution.inputs, now):
        return Step(command, "out of date", f"changed since: {', '.join(changed)}")
    if stale := stale_solution_outputs(project, bundle, solution.run):
        names = ", ".join(project.shown(path) for path in stale)
        return Step(command, "out of date", f"missing or not of the last adjustment: {names}; {_WRITTEN_BY}")
    if solution.status == "stopped":
        return Step(command, "out of date", f"{found}: Ctrl-C ended it before it converged")
    return Step(command, "up to date", found)


def _driven(project: Project, bundle: str, before: Sequence[Step]) -> Step | None:
    """Return the state of a drive table; None while it has to wait, or where there is nothing to drive."""
    models = any(each.models for each in project.definition.bundles if each.name == bundle)
    if not models or any(step.state != "up to date" for step in before):
        return None
    command = "orip drive table" if len(project.definition.bundles) == 1 else f"orip drive table {bundle}"
    shown = project.shown(project.beside_photos(bundle, "DRV"))
    try:
        current = is_drive_table_current(project, bundle)
    except InputError:
        return None
    if current:
        return Step(command, "up to date", f"{shown} holds the last adjustment")
    return Step(command, "out of date", f"{shown} is missing, or not of the last adjustment and the mountings in force")


_HEAD_OF_REPORT = 4096
_WRITTEN_BY = "the next init, measure, solve or run writes it"


def _old_outputs(project: Project) -> list[ProjectWarning]:
    text = "is of a time when the project had another number of bundles, and is not written any more; remove it"
    return [ProjectWarning("old-output", project.shown(path), text) for path in outputs_of_other_names(project)]


def _old_reports(project: Project, stores: Stores) -> Iterator[ProjectWarning]:
    for bundle in project.definition.bundles:
        path, solution = project.report(bundle.name), solutions.read_head(stores[project.exterior], bundle.name)
        if solution is None or not path.is_file():
            continue
        with path.open(encoding="utf-8", errors="replace") as file:
            run = run_of_page(file.read(_HEAD_OF_REPORT))
        if run != solution.run:
            text = "is not of the last adjustment; 'orip report' writes it again"
            yield ProjectWarning("old-report", project.shown(path), text)


def _changed_inputs(old: Sequence[tuple[str, str]], new: Sequence[tuple[str, str]]) -> list[str]:
    """Return the names of inputs that are new, gone or different."""
    before, after = dict(old), dict(new)
    return [name for name in {**before, **after} if before.get(name) != after.get(name)]
