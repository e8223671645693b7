"""`orip prelim relative`, `bridge`, `connect`, `absolute`, `show`: a single step to preliminary values.

Every step is computed from the measurements, with the steps before it. Nothing is stored, so that no result can be
older than the measurements.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.errors import InputError, NotSolvableError, ProjectWarning, UsageError
from orip.prelim.ground import absolute_in_project, block_in_project
from orip.prelim.rays import ImageRays, image_rays, photo_index
from orip.prelim.routes import ListedModels, bridge_rows, connect_rows, in_driving_order, orient_model, orient_models
from orip.prelim.similarity.bridging import JoinedSystems, bridge, connect
from orip.prelim.similarity.joining import Joined
from orip.records.block import Block
from orip.records.definition import StereoModel
from orip.records.names import record_key
from orip.records.preliminary import (
    ModelCoordinates,
    NotOriented,
    PartialBlock,
    PreliminaryValues,
    RelativeOrientation,
    SimilarityStep,
    Stage,
)
from orip.solving.starting_values import explained_preliminary_values, gather_bundle, not_oriented
from orip.wording import agreeing, first_names
from orip.workflow.adjust.gathering import block_input
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.folder import ProjectFolder

_SHOWN_MODELS = 6


class PrelimInput(Struct, frozen=True):
    """What preliminary values are computed from."""

    of: BundleState
    block: Block

    @property
    def warnings(self) -> tuple[ProjectWarning, ...]:
        """Return what is doubtful in what was measured and given."""
        return self.block.warnings

    @property
    def project(self) -> ProjectFolder:
        """Return the project."""
        return self.of.project

    @property
    def bundle(self) -> str:
        """Return the name of the bundle."""
        return self.of.name

    @property
    def models(self) -> tuple[StereoModel, ...]:
        """Return the models in driving order.

        Raises
        ------
        InputError
            If the bundle has none.
        """
        models = self.block.definition.models
        if not models:
            message = (
                f"bundle {self.bundle} has no models to go step by step; define them ([[bundle.model]] in orip.toml: "
                "name, left, right, row, column), or run 'orip prelim', which orients photos without them"
            )
            raise InputError.single(message)
        return tuple(in_driving_order(models))

    @property
    def measured_models(self) -> tuple[StereoModel, ...]:
        """Return the models of which both photos are measured, in driving order; if there is none, all of them.

        Raises
        ------
        InputError
            If the bundle has none.
        """
        measured = self._measured_photos()
        return tuple(model for model in self.models if {model.left, model.right} <= measured) or self.models

    @property
    def unmeasured_models(self) -> tuple[ProjectWarning, ...]:
        """Return a warning that names the models that are left out, as their photos have no points yet."""
        measured, left_out = self._measured_photos(), len(self.models) - len(self.measured_models)
        if not left_out:
            return ()
        names = [model.name for model in self.models if not {model.left, model.right} <= measured]
        photos = dict.fromkeys(
            photo for model in self.models for photo in (model.left, model.right) if photo not in measured
        )
        of_models, of_photos = agreeing(left_out, "model", "models"), agreeing(len(photos), "photo", "photos")
        text = (
            f"{of_models} {first_names(names, _SHOWN_MODELS)} left out: no point is measured yet in "
            f"{of_photos} {first_names(list(photos), _SHOWN_MODELS)}"
        )
        return (ProjectWarning("unmeasured-models", "", text),)

    def _measured_photos(self) -> set[str]:
        counts = np.bincount(self.block.photo_points.photo, minlength=len(self.block.photos))
        return {photo.name for photo, count in zip(self.block.photos, counts.tolist(), strict=True) if count}

    def model(self, name: str) -> StereoModel:
        """Return a model by its name.

        Raises
        ------
        UsageError
            If there is none.
        """
        for model in self.models:
            if record_key(model.name) == record_key(name):
                return model
        listed = ", ".join(model.name for model in self.models)
        message = f"there is no model '{name}' in bundle {self.bundle}; its models are: {listed}"
        raise UsageError(message)


class Relative(Struct, frozen=True):
    """Models that are oriented relatively, and those that could not be."""

    oriented: Sequence[RelativeOrientation]
    failures: tuple[NotOriented, ...]


class SimilaritySteps(Struct, frozen=True):
    """Similarities that could be determined, and those that could not."""

    steps: tuple[SimilarityStep, ...]
    failures: tuple[NotOriented, ...]


def prelim_input(bundle: BundleState) -> PrelimInput:
    """Gather what preliminary values of a bundle are computed from; see `block_input`."""
    return PrelimInput(bundle, gather_bundle(block_input(bundle)))


def relative_orientations(given: PrelimInput, model: str | None) -> Relative:
    """Orient one model relatively, or all that are measured."""
    rays = image_rays(given.block)
    index = photo_index(rays)
    if model is None:
        oriented, failures = orient_models(rays, given.measured_models, index)
        return Relative(ListedModels(rays, oriented), tuple(failures))
    found = orient_model(rays, given.model(model), index)
    return Relative((), (found,)) if isinstance(found, NotOriented) else Relative(ListedModels(rays, [found]), ())


def bridges(given: PrelimInput, model: str | None) -> SimilaritySteps:
    """Bridge all rows, or one model to the next one in its row.

    Raises
    ------
    UsageError
        If there is no such model, or none after it in its row.
    NotSolvableError
        If one of the two could not be oriented relatively.
    """
    rays = image_rays(given.block)
    if model is None:
        bridged = _bridged(given, rays)
        return SimilaritySteps(bridged.steps, bridged.failures)
    first = given.model(model)
    after = [later for later in given.models if later.row == first.row and later.column > first.column]
    if not after:
        message = f"model {first.name} is the last of row {first.row}: there is no next one to bridge it to"
        raise UsageError(message)
    found = bridge(_oriented(rays, after[0]), _oriented(rays, first), rays)
    return _one(found)


def connections(given: PrelimInput, rows: tuple[int, int] | None) -> SimilaritySteps:
    """Connect all rows, or one row to another one.

    Raises
    ------
    UsageError
        If there is no such row.
    """
    rays = image_rays(given.block)
    if rows is None:
        connected = connect_rows(_bridged(given, rays), rays)
        return SimilaritySteps(connected.steps, connected.failures)
    target, source = (_strip(given, rays, row) for row in rows)
    return _one(connect(source, target, rays))


def values_of(given: PrelimInput) -> PreliminaryValues:
    """Run the whole chain, with its absolute orientation in the project's coordinates."""
    return absolute_in_project(explained_preliminary_values(given.block), given.block.ground)


def model_coordinates(given: PrelimInput, stage: Stage) -> ModelCoordinates:
    """Return the model coordinate list after a step for all.

    Raises
    ------
    NotSolvableError
        If there are none after this step.
    """
    rays = image_rays(given.block)
    systems, reason = _systems(given, rays, stage)
    if not systems:
        raise NotSolvableError(reason)
    return ModelCoordinates(stage, rays.photos, rays.points, systems)


def _systems(given: PrelimInput, rays: ImageRays, stage: Stage) -> tuple[tuple[PartialBlock, ...], str]:
    """Return the systems after a step, and what to say if there are none."""
    if stage == "absolute":
        values = values_of(given)
        block = block_in_project(values, rays, given.block.ground)
        return (block,) if len(block.photos) else (), not_oriented(values)
    if stage == "relative":
        found = relative_orientations(given, None)
        return tuple(model.block for model in found.oriented), _reasons(found.failures)
    joined = _bridged(given, rays)
    if stage == "connected":
        joined = connect_rows(joined, rays)
    return joined.systems, _reasons(joined.failures)


def _reasons(failures: Sequence[NotOriented]) -> str:
    return "\n".join(f"model {failure.name}: {failure.reason}" for failure in failures)


def _bridged(given: PrelimInput, rays: ImageRays) -> JoinedSystems:
    oriented, failures = orient_models(rays, given.measured_models, photo_index(rays))
    bridged = bridge_rows(oriented, rays)
    return JoinedSystems(bridged.systems, bridged.steps, (*failures, *bridged.failures))


def _oriented(rays: ImageRays, model: StereoModel) -> PartialBlock:
    found = orient_model(rays, model, photo_index(rays))
    if isinstance(found, NotOriented):
        message = f"model {model.name} cannot be bridged: {found.reason}"
        raise NotSolvableError(message)
    return found.pair.block


def _strip(given: PrelimInput, rays: ImageRays, row: int) -> PartialBlock:
    """Return the strip of a row; if the row is not connected, its largest part."""
    models = [model for model in given.models if model.row == row]
    if not models:
        listed = ", ".join(map(str, dict.fromkeys(model.row for model in given.models)))
        message = f"there is no row {row} in bundle {given.bundle}; its rows are: {listed}"
        raise UsageError(message)
    oriented, failures = orient_models(rays, models, photo_index(rays))
    strips: Sequence[PartialBlock] = bridge_rows(oriented, rays).systems
    if not strips:
        message = f"row {row} has no model that is oriented: {failures[0].reason}"
        raise NotSolvableError(message)
    return max(strips, key=lambda strip: len(strip.photos))


def _one(found: Joined | NotOriented) -> SimilaritySteps:
    return SimilaritySteps((found.step,), ()) if isinstance(found, Joined) else SimilaritySteps((), (found,))
