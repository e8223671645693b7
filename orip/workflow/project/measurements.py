"""What the stores hold of measurements: orientations by marks (.TEM, .PHO) and photo observations (.EXO)."""

from __future__ import annotations

from pathlib import Path

from orip.files.stores.contents import observations, photos, templates
from orip.files.stores.provenance import run_of
from orip.files.stores.transaction import Stores
from orip.records.names import record_key
from orip.records.observations.measurement import Measured, no_observations
from orip.workflow.project.folder import ProjectFolder


def measured_stores(project: ProjectFolder) -> tuple[Path, ...]:
    """Return the stores that a replay writes."""
    bundles = (project.observations(name) for name in project.bundle_names)
    return project.templates, project.photos, *bundles


def read_marks(project: ProjectFolder, stores: Stores) -> Measured:
    """Return the orientations by marks that the stores hold; no photo observations."""
    return Measured(
        templates.ORIENTATIONS.read(stores[project.templates]), photos.ORIENTATIONS.read(stores[project.photos])
    )


def write_measured(project: ProjectFolder, stores: Stores, measured: Measured) -> None:
    """Replace what the stores hold of measurements."""
    templates.ORIENTATIONS.write(stores[project.templates], measured.templates.values())
    photos.ORIENTATIONS.write(stores[project.photos], measured.photos.values())
    for bundle in project.bundle_names:
        found = measured.observations.get(record_key(bundle), no_observations(bundle))
        observations.write(stores[project.observations(bundle)], found)


def runs_of_measurements(project: ProjectFolder, stores: Stores) -> tuple[str | None, ...]:
    """Return the run that wrote each of the `measured_stores`; equal where they belong together."""
    return tuple(run_of(stores[path]) for path in measured_stores(project))
