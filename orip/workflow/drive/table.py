"""`orip drive table`: the drive table of the last adjustment, from the stores to BUNDLE.DRV; and reading it back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.drive.table_text import drive_table_text, read_drive_table
from orip.files.stores import solutions
from orip.files.stores.transaction import reading
from orip.files.text.atomic import replace_text, reporting_failure
from orip.geometry.plane import PlaneTransformation
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior, interior_orientation
from orip.multimodel.processor import Loaded, load
from orip.multimodel.table import TableIngredients, drive_table, frame_size, object_ground
from orip.multimodel.table_checks import drivable_name_fault, table_faults
from orip.records.drive_table import DriveFault, DriveTable
from orip.records.measurement import Measured
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo, Stage
from orip.records.project import BundleDefinition, StereoModel
from orip.records.solution import Solution
from orip.records.stages import plan_stages
from orip.workflow.adjust.bundle_input import stored_digests
from orip.workflow.project.definitions import read_definitions, require_initialised
from orip.workflow.project.folder import Project, open_project
from orip.workflow.project.measurements import read_measured
from orip.workflow.project.texts import raise_complaints


@dataclass(frozen=True, slots=True)
class DriveTableOutcome:
    """A table that was written: its file, whether that has changed, and what is doubtful or left out."""

    project: Project
    table: DriveTable
    path: Path
    changed: bool
    warnings: tuple[ProjectWarning, ...]


@dataclass(frozen=True, slots=True)
class _Stored:
    """What a table takes from the stores."""

    definitions: Definitions
    bundle: BundleDefinition
    measured: Measured
    interior: Interior
    solution: Solution
    is_stale: bool


def write_drive_table(folder: Path, bundle: str | None) -> DriveTableOutcome:
    """Write BUNDLE.DRV with the values of the last adjustment and the interior orientation in force.

    Parameters
    ----------
    folder : Path
    bundle : str or None
        None: the project's only one.

    Raises
    ------
    InputError
        If the bundle has not been adjusted or has no models that can be driven, or two photos of a model are on one
        stage.
    """
    project = open_project(folder)
    return write_bundle_drive_table(project, project.bundle_name(bundle))


def write_bundle_drive_table(project: Project, name: str) -> DriveTableOutcome:
    """Do what `write_drive_table` does for a bundle of a project that is open."""
    table, warnings = _current_table(project, name)
    path = project.beside_photos(name, "DRV")
    return DriveTableOutcome(project, table, path, _write(project, path, table), warnings)


def is_drive_table_current(project: Project, name: str) -> bool:
    """Tell whether BUNDLE.DRV is what `write_drive_table` would write now.

    Raises
    ------
    InputError
        If it would write none.
    """
    path = project.beside_photos(name, "DRV")
    table, _ = _current_table(project, name)
    return path.is_file() and path.read_bytes() == drive_table_text(table).encode("ascii")


def _current_table(project: Project, name: str) -> tuple[DriveTable, tuple[ProjectWarning, ...]]:
    stored = _read_stored(project, name)
    to_photo = _plate_to_photo(stored)
    models, warnings = _drivable_models(stored, to_photo)
    if not models:
        raise InputError([*stored.interior.complaints, _no_models(stored)])
    ground = object_ground(project.definition.crs, stored.solution.ground_unit, stored.solution)
    ingredients = TableIngredients(
        stored.solution, models, stored.definitions.cameras, stored.definitions.photos, _stages(stored, models),
        to_photo, ground,
    )  # fmt: skip
    raise_complaints(tuple(_name_complaints(ingredients)))
    table = drive_table(ingredients)
    raise_complaints([Complaint(f"{fault.text}; the table cannot be driven with") for fault in table_faults(table)])
    warnings += [*_solution_warnings(stored, ingredients), *ground.warnings]
    if project.definition.crs is not None:
        text = (
            f"holds object coordinates in a local frame (east, north, up) instead of {project.definition.crs}, in "
            "which straight rays would be curved"
        )
        warnings.append(ProjectWarning("local-object-frame", f"{name}.DRV", text))
    return table, tuple(warnings)


def load_drive_table(data: bytes) -> Loaded | tuple[DriveFault, ...]:
    """Load a plate processor from the bytes of a drive table, with all cross checks; return all faults if there is any.

    The first fault's code and sentence are what a plate processor replies.
    """
    read = read_drive_table(data)
    return read.faults if read.table is None else load(read.table)


def _read_stored(project: Project, name: str) -> _Stored:
    with reading([*project.record_stores, project.observations(name)]) as stores:
        stored = read_definitions(project, stores)
        require_initialised(project, stored)
        measured = read_measured(project, stores, [name])
        solution = solutions.read(stores[project.exterior], name)
    if solution is None:
        message = f"bundle {name} has not been adjusted yet; run 'orip solve' first"
        raise InputError.single(message)
    observations = measured.observations.get(record_key(name))
    inputs = dict(solution.inputs)
    is_stale = observations is None or any(
        inputs.get(key) != digest for key, digest in stored_digests(project, name, stored, measured, observations)
    )
    definitions = stored.by_name()
    interior = interior_orientation(definitions, measured)
    return _Stored(definitions, stored.bundle(name), measured, interior, solution, is_stale)


def _plate_to_photo(stored: _Stored) -> dict[str, PlaneTransformation]:
    """Return the transformations of all photos that are oriented on a plate, by `record_key`."""
    found = {}
    for key, to_photo in stored.interior.to_photo.items():
        template = stored.definitions.photos[key].template
        if template is None:
            found[key] = to_photo
        elif record_key(template) in stored.interior.to_template:
            found[key] = to_photo.after(stored.interior.to_template[record_key(template)])
    return found


def _drivable_models(
    stored: _Stored, to_photo: Mapping[str, PlaneTransformation]
) -> tuple[tuple[StereoModel, ...], list[ProjectWarning]]:
    """Return the models of which both photos are adjusted and oriented, and warnings of all that is left out."""
    adjusted = set(map(record_key, stored.solution.photos.names))
    models, warnings = [], []
    for model in stored.bundle.models:
        missing = [_missing(name, adjusted, to_photo) for name in (model.left, model.right)]
        reasons = [reason for reason in missing if reason is not None]
        if reasons:
            text = f"is not in the drive table: {' and '.join(reasons)}"
            warnings.append(ProjectWarning("model-left-out", f"model {model.name}", text))
        else:
            models.append(model)
    used = {record_key(name) for model in models for name in (model.left, model.right)}
    alone = [name for name in stored.solution.photos.names if record_key(name) not in used]
    if models and alone:
        text = f"in no model of the drive table, and not in it: {', '.join(alone)}"
        warnings.append(ProjectWarning("photo-left-out", "photos", text))
    return tuple(models), warnings


def _missing(name: str, adjusted: set[str], to_photo: Mapping[str, PlaneTransformation]) -> str | None:
    if record_key(name) not in adjusted:
        return f"photo {name} is not in the solution"
    return None if record_key(name) in to_photo else f"photo {name} has no valid interior orientation"


def _no_models(stored: _Stored) -> Complaint:
    name = stored.bundle.name
    if not stored.bundle.models:
        return Complaint(
            f"bundle {name} has no models to drive in; define them as [[bundle.model]] in orip.toml, then run "
            "'orip init'"
        )
    return Complaint(
        f"no model of bundle {name} has both its photos adjusted and with an interior orientation; measure them, then "
        "run 'orip solve'"
    )


def _stages(stored: _Stored, models: tuple[StereoModel, ...]) -> Mapping[str, Stage]:
    """Return the stage of every photo in a model: as mounted, else as defined, else by turns."""
    mounted = [
        replace(template, stage=stored.measured.templates[key].stage or template.stage)
        if key in stored.measured.templates
        else template
        for key, template in stored.definitions.templates.items()
    ]
    plan = plan_stages(tuple(stored.definitions.photos.values()), mounted, models)
    raise_complaints(
        [
            Complaint(
                f"photos {model.left} and {model.right} of model {model.name} are both on the "
                f"{plan.stages[record_key(model.left)]} stage; set the stages, or print them on different templates"
            )
            for model in plan.unsuited
        ]
    )
    return plan.stages


def _name_complaints(ingredients: TableIngredients) -> Iterator[Complaint]:
    """Yield a complaint for what cannot be written in a table of ASCII, or not in one with a single plate unit."""
    photos, cameras, solution = ingredients.used_photos(), ingredients.used_cameras(), ingredients.solution
    named = [("bundle", solution.bundle), *(("camera", each.name) for each in cameras)]
    named += [("photo", each.name) for each in photos]
    named += [("template", name) for name in dict.fromkeys(each.template for each in photos) if name is not None]
    named += [("model", each.name) for each in ingredients.models]
    for kind, name in named:
        fault = drivable_name_fault(record_key(name))
        if fault is not None:
            yield Complaint(f"{kind} {name}: {fault}, which a drive table cannot hold; rename it")
    for what, text in (("project name", solution.project), ("ground unit", solution.ground_unit)):
        if not (text and text.isascii() and text.isprintable() and text == text.strip()):
            yield Complaint(f"the {what} '{text}' has a character that is not ASCII, which a drive table cannot hold")
    digital = [each.name for each in photos if ingredients.cameras[record_key(each.camera)].sensor is not None]
    if digital and len(digital) < len(photos):
        yield Complaint(
            f"digital frames ({', '.join(digital)}) are driven in pixels, films in millimetres, and a drive table has "
            "one unit; put their models into different bundles"
        )


def _solution_warnings(stored: _Stored, ingredients: TableIngredients) -> Iterator[ProjectWarning]:
    solution = stored.solution
    if stored.is_stale:
        text = "was adjusted before the stores changed; run 'orip solve', then make the table again"
        yield ProjectWarning("stale-solution", f"bundle {solution.bundle}", text)
    if solution.status in ("not_converged", "stopped"):
        text = f"the adjustment is {solution.status.replace('_', ' ')}; do not rely on what is driven to"
        yield ProjectWarning("not-converged", f"bundle {solution.bundle}", text)
    used: dict[str, Photo] = {record_key(photo.name): photo for photo in ingredients.used_photos()}
    for name, deviations in zip(solution.photos.names, solution.photos.sd, strict=True):
        removed = [kind for kind, sd in zip(PHOTO_PARAMETERS, deviations, strict=True) if np.isinf(sd)]
        if removed and record_key(name) in used:
            text = f"nothing determines {', '.join(removed)}; its models cannot be relied on"
            yield ProjectWarning("singular-photo", f"photo {name}", text)
    for camera in ingredients.used_cameras():
        if 0.0 in frame_size(camera):
            text = "has no frame: models do not change at frame lines, only where a stage ends"
            yield ProjectWarning("no-frame", f"camera {camera.name}", text)


def _write(project: Project, path: Path, table: DriveTable) -> bool:
    """Write the table if that changes the file; tell whether it did."""
    text = drive_table_text(table)
    with reporting_failure(project.shown(path), "remove the cause and try again"):
        if path.is_file() and path.read_bytes() == text.encode("ascii"):
            return False
        replace_text(path, text)
    return True
