"""A project seen from one of its bundles: its photo observations, what it is adjusted from, and its last adjustment."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from orip.errors import InputError
from orip.files.stores.digest import record_digest
from orip.interior.definitions import Definitions
from orip.records.definition import BundleDefinition
from orip.records.measurement import PhotoObservations, no_observations
from orip.records.names import record_key
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.run_id import digest_of_columns, digest_of_digests, digest_of_records
from orip.workflow.project.state import Part, ProjectState, read_state
from orip.workflow.project.texts import Digests, open_checked_project

if TYPE_CHECKING:
    from orip.interior.in_force import Interior
    from orip.records.control import Control
    from orip.records.results.solution import Solution


class BundleState(Struct, frozen=True, dict=True):
    """A bundle of a project state; it stores nothing except its name."""

    state: ProjectState
    name: str

    @property
    def project(self) -> ProjectFolder:
        """Return the project."""
        return self.state.project

    @property
    def definition(self) -> BundleDefinition:
        """Return the bundle's record in the stores."""
        return self.state.definitions.bundle(self.name)

    @cached_property
    def records(self) -> Definitions:
        """Return the records of the stores by `record_key` of their names; photos have the cameras of the bundle."""
        records = self.state.records
        own = records.settings.get(record_key(self.name))
        return records if own is None else records.with_cameras_of(own)

    @property
    def control(self) -> Control:
        """Return the control of the bundle, as far as it could be read."""
        return self.state.texts.control_of(self.name)

    @property
    def interior(self) -> Interior:
        """Return the interior orientation in force."""
        return self.state.interior

    @property
    def is_measured(self) -> bool:
        """Tell whether the stores hold photo observations of the bundle."""
        digests = self.state.stored.digests  # those of others would have to be computed
        known = self.state.measured.observations if digests is None else digests.observations
        return record_key(self.name) in known

    @property
    def number_of_observations(self) -> int:
        """Return how many photo observations the stores hold of the bundle."""
        number, _digest = self.state.digests.observations.get(record_key(self.name), (0, ""))
        return number

    @cached_property
    def observations(self) -> PhotoObservations:
        """Return the photo observations; none where nothing is measured."""
        return self.state.measured.observations.get(record_key(self.name), no_observations(self.name))

    @property
    def solution(self) -> Solution | None:
        """Return the last solution; None before the first adjustment."""
        return self.state.solution(self.name)

    @property
    def adjusted(self) -> Solution:
        """Return the last solution.

        Raises
        ------
        InputError
            If there is none.
        """
        if self.solution is None:
            message = f"bundle {self.name} has not been adjusted yet; run 'orip solve' first"
            raise InputError.single(message)
        return self.solution

    @property
    def command(self) -> str:
        """Return the command that adjusts the bundle."""
        return "orip solve" if self.project.has_one_bundle else f"orip solve {self.name}"

    def read_again(self) -> BundleState:
        """Read the same parts of the stores again."""
        return BundleState(self.state.read_again(), self.name)

    def require_measured(self) -> None:
        """Raise InputError unless something is measured."""
        if not self.is_measured:
            raise self.not_measured()

    def not_measured(self) -> InputError:
        """Return the error for a bundle without measurements."""
        return InputError.single(f"bundle {self.name} has no photo observations yet; run 'orip measure' first")

    @cached_property
    def digests(self) -> Digests:
        """Return the digests of what a solution depends on in the stores, and of what orip.toml alone has."""
        project, definitions = self.project, self.state.definitions
        cameras = [stored.record for stored in definitions.cameras]
        photos = (record_digest(stored.record) for stored in definitions.photos)
        of_photos = digest_of_digests((*photos, *self.state.digests.photos))
        return (
            (project.shown(project.cameras), digest_of_records(cameras)),
            (project.shown(project.photos), of_photos),
            (project.shown(project.exterior), digest_of_records([self.definition])),
            (project.shown(project.observations(self.name)), self.digest_of_observations),
            *project.crs_digest,
            *project.angle_digest,
            *project.antenna_digest,
            *project.terrain_digest,
            *project.rig_digest,
        )

    @cached_property
    def digest_of_observations(self) -> str:
        """Return the digest of the photo observations."""
        _number, digest = self.state.digests.observations.get(record_key(self.name), (0, digest_of_columns((), ())))
        return digest

    @cached_property
    def photos(self) -> Mapping[str, str]:
        """Return the names of the bundle's photos by `record_key`: those of its models, observations and solution."""
        from orip.records.coded_names import coded

        of_models = [photo for model in self.definition.models for photo in (model.left, model.right)]
        adjusted = self.solution.photos.names if self.solution else ()
        mine = {record_key(name) for name in (*of_models, *coded(self.observations.photos).occurring(), *adjusted)}
        return {key: photo.name for key, photo in self.records.photos.items() if key in mine}

    @cached_property
    def models_of_photos(self) -> Mapping[str, Mapping[str, str]]:
        """Return the names of the models of each photo in one, by the `record_key` of this and of the other photo."""
        models: dict[str, dict[str, str]] = {}
        for model in self.definition.models:
            left, right = record_key(model.left), record_key(model.right)
            models.setdefault(left, {}).setdefault(right, model.name)
            models.setdefault(right, {}).setdefault(left, model.name)
        return models


def read_bundle(folder: Path, bundle: str | None, *parts: Part) -> BundleState:
    """Read a project for a command on one bundle; see `orip.workflow.project.state`.

    Parameters
    ----------
    bundle : str or None
        None: the project's only one.
    parts : Part
        What is read of the stores; observations and solution of this bundle.

    Raises
    ------
    InputError
        With everything that is wrong in orip.toml, and then in the folder's other texts too, or if a store is damaged.
    UsageError
        If there is no such folder or bundle.
    LockedError
    """
    project = open_checked_project(folder)
    name = project.bundle_name(bundle)
    return BundleState(read_state(project, parts, [name]), name)
