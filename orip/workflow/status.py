"""`orip status`: what the project has, what is out of date, and what comes next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from orip.files.stores import solutions
from orip.files.stores.provenance import read_inputs
from orip.files.stores.transaction import Stores, reading
from orip.model.names import record_key
from orip.workflow.measure import measurement_inputs, read_measured
from orip.workflow.outputs import stale_outputs
from orip.workflow.project import Project, open_project
from orip.workflow.records import StoredDefinitions, read_definitions
from orip.workflow.solve import solve_inputs
from orip.workflow.texts import digests, measurement_files

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
    """

    project: Project
    counts: tuple[tuple[str, int], ...]
    steps: tuple[Step, ...]
    next_command: str | None


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
        definitions = read_definitions(project, stores)
        steps = [_initialised(project, stores), _measured(project, stores, definitions)]
        steps += [_solved(project, stores, definitions, name) for name in bundles]
        points = sum(len(each.points) for each in read_measured(project, stores, bundles).observations.values())
    counts = (
        ("camera", len(project.definition.cameras)),
        ("template", len(project.definition.templates)),
        ("photo", len(project.definition.photos)),
        ("bundle", len(bundles)),
        ("photo point", points),
    )
    following = next((step.command for step in steps if step.state != "up to date"), None)
    return ProjectStatus(project, counts, tuple(steps), following)


def _initialised(project: Project, stores: Stores) -> Step:
    applied = read_inputs(stores[project.exterior], "init")
    if not applied:
        return Step("orip init", "missing", "orip.toml has not been applied to the stores")
    if applied != digests(project, [project.text]):
        return Step("orip init", "out of date", "orip.toml has changed")
    return Step("orip init", "up to date", "the stores hold what orip.toml says")


def _measured(project: Project, stores: Stores, definitions: StoredDefinitions) -> Step:
    applied = read_inputs(stores[project.photos], "measure")
    files = measurement_files(project).records
    if not applied:
        what = f"{len(files)} measurement files are waiting" if files else "there are no measurement files (*.MEA) yet"
        return Step("orip measure", "missing", what)
    changed = changed_inputs(applied, measurement_inputs(project, files, definitions))
    if changed:
        return Step("orip measure", "out of date", f"changed since: {', '.join(changed)}")
    return Step("orip measure", "up to date", f"{len(files)} measurement files are in the stores")


def _solved(project: Project, stores: Stores, definitions: StoredDefinitions, bundle: str) -> Step:
    command = "orip solve" if len(project.definition.bundles) == 1 else f"orip solve {bundle}"
    solution = solutions.read_head(stores[project.exterior], bundle)
    if solution is None:
        return Step(command, "missing", f"bundle {bundle} has not been adjusted")
    measured = read_measured(project, stores, [bundle])
    observations = measured.observations.get(record_key(bundle))
    found = "" if observations is None else f"{solution.status}, sigma0 {solution.sigma0:.4f}"
    if observations is None or record_key(bundle) not in definitions.by_name().bundles:
        return Step(command, "out of date", "its photo observations are gone")
    changed = changed_inputs(solution.inputs, solve_inputs(project, bundle, definitions, measured, observations))
    if changed:
        return Step(command, "out of date", f"changed since: {', '.join(changed)}")
    stale = stale_outputs(project, bundle, solution.run)
    if stale:
        names = ", ".join(project.shown(path) for path in stale)
        return Step(command, "out of date", f"{names} are not those of the last adjustment; any command rewrites them")
    return Step(command, "up to date", found)


def changed_inputs(old: Sequence[tuple[str, str]], new: Sequence[tuple[str, str]]) -> list[str]:
    """Return the names of inputs that are new, gone or different."""
    before, after = dict(old), dict(new)
    return [name for name in {**before, **after} if before.get(name) != after.get(name)]
