"""A bundle as an operator has it at hand: its photo observations, interior orientation and last adjustment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from orip.errors import InputError, ProjectWarning, UsageError
from orip.files.stores import solutions
from orip.files.stores.transaction import reading
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior, interior_orientation
from orip.records.measurement import PhotoObservations, no_observations
from orip.records.names import near_names, record_key
from orip.records.project import BundleDefinition
from orip.records.solution import Solution
from orip.workflow.project.definitions import read_definitions, require_initialised
from orip.workflow.project.folder import Project, open_project
from orip.workflow.project.measurements import read_measured
from orip.workflow.project.run_id import digest_of_observations


@dataclass(frozen=True)
class BundleAtHand:
    """What the stores hold of a bundle; `solution` is None before the first adjustment."""

    project: Project
    definition: BundleDefinition
    definitions: Definitions
    observations: PhotoObservations
    interior: Interior
    solution: Solution | None

    @property
    def name(self) -> str:
        """Return the bundle's name."""
        return self.definition.name

    @property
    def warnings(self) -> tuple[ProjectWarning, ...]:
        """Return a warning if the observations are not those that were adjusted."""
        if self.solution is None:
            return ()
        path = self.project.shown(self.project.observations(self.name))
        if dict(self.solution.inputs).get(path) == digest_of_observations(self.observations):
            return ()
        text = "has changed since the last adjustment, whose residuals and weights are shown; run 'orip solve'"
        return (ProjectWarning("out-of-date", path, text),)

    @cached_property
    def photos(self) -> dict[str, str]:
        """Return the names of the bundle's photos by `record_key`: those of its models, observations and solution."""
        of_models = [photo for model in self.definition.models for photo in (model.left, model.right)]
        adjusted = self.solution.photos.names if self.solution else ()
        mine = {record_key(name) for name in (*of_models, *self.observations.photos, *adjusted)}
        return {key: photo.name for key, photo in self.definitions.photos.items() if key in mine}

    def models_of(self, photo: str) -> dict[str, str]:
        """Return the models that a photo (`record_key`) is in, by the `record_key` of the other photo."""
        return self._models.get(photo, {})

    @cached_property
    def _models(self) -> dict[str, dict[str, str]]:
        models: dict[str, dict[str, str]] = {}
        for each in self.definition.models:
            left, right = record_key(each.left), record_key(each.right)
            models.setdefault(left, {}).setdefault(right, each.name)
            models.setdefault(right, {}).setdefault(left, each.name)
        return models

    def photo_key(self, name: str) -> str:
        """Return the `record_key` of a photo that the bundle has; raise UsageError, with names like it, if none."""
        key = record_key(name)
        if key not in self.photos:
            message = f"bundle {self.name} has no photo {name}; {near_names(name, self.photos.values())}"
            raise UsageError(message)
        return key

    def require_point(self, name: str) -> None:
        """Raise UsageError, with names like it, unless a point of this name is measured."""
        if name not in self.observations.points:
            message = f"bundle {self.name} has no point {name}; {near_names(name, self.observations.points)}"
            raise UsageError(message)


def bundle_at_hand(folder: Path, bundle: str | None) -> BundleAtHand:
    """Read a bundle from the stores.

    Raises
    ------
    InputError
        If nothing is measured yet.
    UsageError
        If there is no such bundle.
    """
    project = open_project(folder)
    name = project.bundle_name(bundle)
    with reading([*project.record_stores, project.observations(name)]) as stores:
        definitions = read_definitions(project, stores)
        require_initialised(project, definitions)
        measured = read_measured(project, stores, [name])
        solution = solutions.read(stores[project.exterior], name)
    observations = measured.observations.get(record_key(name), no_observations(name))
    if not observations.points and solution is None:
        message = f"bundle {name} has no photo observations yet; run 'orip measure' first"
        raise InputError.single(message)
    by_name = definitions.by_name()
    interior = interior_orientation(by_name, measured)
    return BundleAtHand(project, definitions.bundle(name), by_name, observations, interior, solution)
