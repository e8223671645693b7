"""What the stores hold of measurements: orientations by marks (.TEM, .PHO) and photo observations (.EXO)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from orip.files.stores import observations, photos, templates
from orip.files.stores.provenance import run_of, set_run
from orip.files.stores.transaction import Stores
from orip.records.measurement import Measured, no_observations
from orip.records.names import record_key
from orip.workflow.project.folder import Project


def measured_stores(project: Project) -> tuple[Path, ...]:
    """Return the stores that a replay writes."""
    bundles = (project.observations(each.name) for each in project.definition.bundles)
    return project.templates, project.photos, *bundles


def read_measured(project: Project, stores: Stores, bundles: Sequence[str]) -> Measured:
    """Return what the stores hold of measurements, photo observations of the named bundles alone."""
    found = {}
    for bundle in bundles:
        each = observations.read(stores[project.observations(bundle)])
        if each is not None:
            found[record_key(bundle)] = each
    return Measured(
        templates.read_orientations(stores[project.templates]), photos.read_orientations(stores[project.photos]), found
    )


def write_measured(project: Project, stores: Stores, measured: Measured, run: str) -> None:
    """Replace what the stores hold of measurements; they then carry the id of the run."""
    templates.write_orientations(stores[project.templates], measured.templates.values())
    photos.write_orientations(stores[project.photos], measured.photos.values())
    for bundle in project.definition.bundles:
        found = measured.observations.get(record_key(bundle.name), no_observations(bundle.name))
        observations.write(stores[project.observations(bundle.name)], found)
    for path in measured_stores(project):
        set_run(stores[path], run)


def runs_of_measurements(project: Project, stores: Stores) -> tuple[str | None, ...]:
    """Return the run that wrote each of the `measured_stores`; equal where they belong together."""
    return tuple(run_of(stores[path]) for path in measured_stores(project))
