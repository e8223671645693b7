"""What a bundle adjustment and its preliminary values start from: stores and ground texts, gathered into a block."""

from __future__ import annotations

from dataclasses import dataclass

from orip.bundle.assemble import Ingredients, gather
from orip.errors import InputError, ProjectWarning
from orip.files.stores.transaction import reading
from orip.interior.in_force import Interior, interior_orientation
from orip.mistakes.before_adjustment.checks import block_warnings, measurement_warnings
from orip.progress import stage
from orip.records.block import Block
from orip.records.measurement import Measured, PhotoObservations
from orip.records.names import record_key
from orip.workflow.project.definitions import StoredDefinitions, read_definitions, require_initialised
from orip.workflow.project.folder import Project
from orip.workflow.project.measurements import read_measured
from orip.workflow.project.run_id import digest_of_observations, digest_of_records
from orip.workflow.project.texts import Digests, GroundTexts


@dataclass(frozen=True, slots=True)
class Stored:
    """What an adjustment takes from the stores."""

    bundle: str
    definitions: StoredDefinitions
    observations: PhotoObservations
    interior: Interior
    warnings: tuple[ProjectWarning, ...]
    digests: Digests


@stage("gathering observations")
def read_stored(project: Project, bundle: str) -> Stored:
    """Read what the stores hold of one bundle.

    Raises
    ------
    InputError
        If the project is not initialised, or nothing of the bundle is measured.
    """
    with reading([*project.record_stores, project.observations(bundle)]) as stores:
        definitions = read_definitions(project, stores)
        require_initialised(project, definitions)
        measured = read_measured(project, stores, [bundle])
    observations = measured.observations.get(record_key(bundle))
    if observations is None:
        message = f"bundle {bundle} has no photo observations yet; run 'orip measure' first"
        raise InputError.single(message)
    digests = stored_digests(project, bundle, definitions, measured, observations)
    by_name = definitions.by_name()
    interior = interior_orientation(by_name, measured)
    warnings = measurement_warnings(by_name, measured, interior)
    return Stored(bundle, definitions, observations, interior, warnings, digests)


@stage("gathering observations")
def gathered_block(project: Project, stored: Stored, texts: GroundTexts) -> tuple[Block, tuple[ProjectWarning, ...]]:
    """Gather the block of a bundle, with the warnings that this gives rise to.

    Raises
    ------
    InputError
        With everything that keeps it from being one.
    """
    definitions, interior = stored.definitions.by_name(), stored.interior
    gathered = gather(
        Ingredients(
            stored.definitions.bundle(stored.bundle),
            definitions.cameras,
            definitions.photos,
            interior.to_photo,
            interior.pixel_sizes,
            stored.observations,
            texts.control,
            texts.preliminary,
            project.definition.ground_unit,
            project.definition.crs,
        )
    )
    if gathered.block is None:
        raise InputError((*interior.complaints, *gathered.complaints))
    found = block_warnings(gathered.block, texts.control, texts.preliminary)
    return gathered.block, (*found, *gathered.block.ground.warnings)


def stored_digests(
    project: Project, bundle: str, definitions: StoredDefinitions, measured: Measured, observations: PhotoObservations
) -> Digests:
    """Return the digests of what a solution depends on in the stores, and of the project's crs if it has one."""
    cameras = [each.record for each in definitions.cameras]
    photos = [each.record for each in definitions.photos]
    return (
        (project.shown(project.cameras), digest_of_records(cameras)),
        (project.shown(project.photos), digest_of_records([*photos, *measured.photos.values()])),
        (project.shown(project.exterior), digest_of_records([definitions.bundle(bundle)])),
        (project.shown(project.observations(bundle)), digest_of_observations(observations)),
        *project.crs_digest,
    )
