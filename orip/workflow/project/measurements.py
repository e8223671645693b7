"""What the stores hold of measurements: orientations by marks (.TEM, .PHO) and photo observations (.EXO)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from orip.files.stores.contents import observations, photos, templates
from orip.files.stores.digest import record_digest, run_of
from orip.files.stores.transaction import Stores
from orip.records.names import record_key
from orip.records.observations.measurement import Measured, no_observations
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.run_id import digest_of_columns, digest_of_observations


def measured_stores(project: ProjectFolder) -> tuple[Path, ...]:
    """Return the stores that a replay writes."""
    bundles = (project.observations(name) for name in project.bundle_names)
    return project.templates, project.photos, *bundles


def read_marks(project: ProjectFolder, stores: Stores) -> Measured:
    """Return the orientations by marks that the stores hold; no photo observations."""
    return Measured(
        templates.ORIENTATIONS.read(stores[project.templates]), photos.ORIENTATIONS.read(stores[project.photos])
    )


class MeasuredDigests(Struct, frozen=True):
    """What tells measurements from others.

    Parameters
    ----------
    photos : tuple of str
        Digests of the orientations of photos by marks.
    observations : mapping of str to (int, str)
        Number and digest of the photo observations, by `record_key` of their bundle.
    """

    photos: tuple[str, ...]
    observations: Mapping[str, tuple[int, str]]


def digests_of(measured: Measured) -> MeasuredDigests:
    """Return what tells measurements from others."""
    observed = measured.observations.items()
    return MeasuredDigests(
        tuple(map(record_digest, measured.photos.values())),
        {key: (len(found.points), digest_of_observations(found)) for key, found in observed},
    )


def read_digests(project: ProjectFolder, stores: Stores, bundles: Sequence[str]) -> MeasuredDigests:
    """Return what tells the measurements that the stores hold from others, without making arrays of them."""
    read = ((record_key(name), observations.read_plain(stores[project.observations(name)])) for name in bundles)
    return MeasuredDigests(
        photos.ORIENTATIONS.digests(stores[project.photos]),
        {
            key: (len(found.points), digest_of_columns((found.photos, found.points), found.numbers))
            for key, found in read
            if found is not None
        },
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
