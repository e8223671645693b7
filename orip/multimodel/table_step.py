"""`orip drive table`: the drive table of the last adjustment, from the stores to BUNDLE.DRV; and reading it back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.text.regular_file import regular_bytes
from orip.geometry.plane import PlaneTransformation
from orip.multimodel.processor import Loaded, drivable_name_fault, load, table_faults
from orip.multimodel.table import TableIngredients, drive_table, frame_size, object_ground, with_empty_stages
from orip.multimodel.table_text import drive_table_text, read_drive_table
from orip.records.camera import READOUT, Camera
from orip.records.definition import StereoModel, plan_stages
from orip.records.drive_table import DriveFault, DriveTable
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo, Stage
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change, commit
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import TextOutput
from orip.workflow.project.run_id import Step
from orip.workflow.project.state import Part, ProjectState
from orip.workflow.project.texts import raise_complaints

DRIVEN_FROM: tuple[Part, ...] = ("definitions", "marks", "observations", "solutions")
"""What a drive table needs of the stores."""


class DriveTableOutcome(Struct, frozen=True):
    """A drive table: its file, whether that changes, and what is doubtful or left out."""

    project: ProjectFolder
    table: DriveTable
    path: Path
    changed: bool
    warnings: tuple[ProjectWarning, ...]


def table_of_run(state: ProjectState, bundle: str) -> DriveTableOutcome | InputError:
    """Make the drive table in `orip run`; models that cannot be driven do not make the adjustment fail."""
    try:
        return commit(make_drive_table(BundleState(state.read_again(*DRIVEN_FROM, bundles=[bundle]), bundle))).outcome
    except InputError as error:
        return error


def make_drive_table(bundle: BundleState) -> Change[DriveTableOutcome]:
    """Make BUNDLE.DRV with the values of the last adjustment and the interior orientation in force.

    A file that holds this table already is not written again.

    Parameters
    ----------
    bundle : BundleState
        With `DRIVEN_FROM`.

    Raises
    ------
    InputError
        If the bundle has not been adjusted or has no models that can be driven, or two photos of a model are on one
        stage.
    """
    table, warnings = current_table(bundle)
    path, text = bundle.project.drive_table(bundle.name), drive_table_text(table)
    changed = not _holds(path, text)
    outputs = (TextOutput(path, lambda: [text], "remove the cause and try again"),) if changed else ()
    return Change(bundle.state, DriveTableOutcome(bundle.project, table, path, changed, warnings), outputs=outputs)


def drive_step(bundle: BundleState) -> Step | None:
    """Return whether the drive table has to be made; None where the bundle has no models to drive in.

    Parameters
    ----------
    bundle : BundleState
        With `DRIVEN_FROM`.
    """
    project = bundle.project
    command = "orip drive table" if project.has_one_bundle else f"orip drive table {bundle.name}"
    path = project.drive_table(bundle.name)
    try:
        table, _ = current_table(bundle)
    except InputError:
        return None
    shown = project.shown(path)
    if _holds(path, drive_table_text(table)):
        return Step(command, "up to date", f"{shown} holds the last adjustment")
    return Step(command, "out of date", f"{shown} is missing, or older than the last adjustment or mounting")


def _holds(path: Path, text: str) -> bool:
    with suppress(OSError):
        return regular_bytes(path) == text.encode("ascii")
    return False


def current_table(
    bundle: BundleState, pairs: tuple[StereoModel, ...] | None = None
) -> tuple[DriveTable, tuple[ProjectWarning, ...]]:
    """Return the drive table of the last adjustment and warnings of what is doubtful or left out.

    Parameters
    ----------
    bundle : BundleState
        With `DRIVEN_FROM`.
    pairs : tuple of StereoModel or None
        Models to drive in; None: those of the bundle, and without any each photo alone.

    Raises
    ------
    InputError
        As `make_drive_table`.
    """
    bundle.state.require_initialised()
    solution, crs = bundle.adjusted, bundle.project.definition.crs
    to_photo, wanted = _plate_to_photo(bundle), bundle.definition.models if pairs is None else pairs
    is_single = not wanted
    models, warnings = _single_photos(bundle, to_photo) if is_single else _drivable_models(bundle, wanted, to_photo)
    if not models:
        raise InputError([*bundle.interior.complaints, _no_models(bundle)])
    ground = object_ground(crs, solution.ground_unit, solution)
    stages = _stages(bundle, () if is_single else models)
    if is_single:
        stages = {record_key(model.left): stages.get(record_key(model.left), "UPPER") for model in models}
    ingredients = TableIngredients(
        solution, models, bundle.records.cameras, bundle.records.photos, stages, to_photo, ground
    )
    raise_complaints(tuple(_name_complaints(ingredients)))
    table = drive_table(ingredients)
    if is_single:
        table = with_empty_stages(table)
    raise_complaints([Complaint(f"{fault.text}; the table cannot be driven with") for fault in table_faults(table)])
    warnings += [*_solution_warnings(bundle, ingredients), *ground.warnings]
    if crs is not None:
        text = (
            f"holds object coordinates in a local frame (east, north, up) instead of {crs}, in which straight rays "
            "would be curved"
        )
        warnings.append(ProjectWarning("local-object-frame", f"{bundle.name}.DRV", text))
    return table, tuple(warnings)


def load_drive_table(data: bytes) -> Loaded | tuple[DriveFault, ...]:
    """Load a plate processor from the bytes of a drive table, with all cross checks; return all faults if there is any.

    The first fault's code and sentence are what a plate processor replies.
    """
    read = read_drive_table(data)
    return read.faults if read.table is None else load(read.table)


def _plate_to_photo(bundle: BundleState) -> dict[str, PlaneTransformation]:
    """Return the transformations of all photos that are oriented on a plate, by `record_key`."""
    found = {}
    for key, to_photo in bundle.interior.to_photo.items():
        template = bundle.records.photos[key].template
        if template is None:
            found[key] = to_photo
        elif record_key(template) in bundle.interior.to_template:
            found[key] = to_photo.after(bundle.interior.to_template[record_key(template)])
    return found


def _drivable_models(
    bundle: BundleState, wanted: tuple[StereoModel, ...], to_photo: Mapping[str, PlaneTransformation]
) -> tuple[tuple[StereoModel, ...], list[ProjectWarning]]:
    """Return the models of which both photos are adjusted and oriented, and warnings of all that is left out."""
    adjusted = set(map(record_key, bundle.adjusted.photos.names))
    models, warnings = [], []
    for model in wanted:
        missing = [_missing(name, adjusted, to_photo) for name in (model.left, model.right)]
        reasons = [reason for reason in missing if reason is not None]
        if reasons:
            text = f"is not in the drive table: {' and '.join(reasons)}"
            warnings.append(ProjectWarning("model-left-out", f"model {model.name}", text))
        else:
            models.append(model)
    used = {record_key(name) for model in models for name in (model.left, model.right)}
    alone = [name for name in bundle.adjusted.photos.names if record_key(name) not in used]
    if models and alone:
        text = f"left out of the drive table, as no model in it has them: {', '.join(alone)}"
        warnings.append(ProjectWarning("photo-left-out", "photos", text))
    return tuple(models), warnings


def _single_photos(
    bundle: BundleState, to_photo: Mapping[str, PlaneTransformation]
) -> tuple[tuple[StereoModel, ...], list[ProjectWarning]]:
    """Return a model of each photo alone, for a bundle without models, and warnings of what is left out."""
    names = bundle.adjusted.photos.names
    driven = [name for name in names if record_key(name) in to_photo]
    models = tuple(StereoModel(name, name, name, 1, column) for column, name in enumerate(driven, start=1))
    text = "has no valid interior orientation, and is not in the drive table"
    return models, [ProjectWarning("photo-left-out", f"photo {name}", text) for name in names if name not in driven]


def _missing(name: str, adjusted: set[str], to_photo: Mapping[str, PlaneTransformation]) -> str | None:
    if record_key(name) not in adjusted:
        return f"photo {name} is not in the solution"
    return None if record_key(name) in to_photo else f"photo {name} has no valid interior orientation"


def _no_models(bundle: BundleState) -> Complaint:
    name = bundle.name
    if not bundle.definition.models:
        return Complaint(
            f"no photo of bundle {name} has an interior orientation to be driven in; measure its marks, then run 'orip "
            "measure'"
        )
    return Complaint(
        f"no model of bundle {name} has both its photos adjusted and with an interior orientation; measure them, then "
        "run 'orip solve'"
    )


def _stages(bundle: BundleState, models: tuple[StereoModel, ...]) -> Mapping[str, Stage]:
    """Return the stage of every photo in a model: as mounted, else as defined, else by turns."""
    mounted = [
        replace(template, stage=bundle.state.measured.templates[key].stage or template.stage)
        if key in bundle.state.measured.templates
        else template
        for key, template in bundle.records.templates.items()
    ]
    plan = plan_stages(tuple(bundle.records.photos.values()), mounted, models)
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
    named = [("bundle", solution.bundle), *(("camera", camera.name) for camera in cameras)]
    named += [("photo", photo.name) for photo in photos]
    named += [("template", name) for name in dict.fromkeys(photo.template for photo in photos) if name is not None]
    named += [("model", model.name) for model in ingredients.models]
    for kind, name in named:
        fault = drivable_name_fault(record_key(name))
        if fault is not None:
            yield Complaint(f"{kind} {name}: {fault}, which a drive table cannot hold; rename it")
    for what, text in (("project name", solution.project), ("ground unit", solution.ground_unit)):
        if not (text and text.isascii() and text.isprintable() and text == text.strip()):
            yield Complaint(f"the {what} '{text}' has a character that is not ASCII, which a drive table cannot hold")
    digital = [photo.name for photo in photos if ingredients.cameras[record_key(photo.camera)].sensor is not None]
    if digital and len(digital) < len(photos):
        yield Complaint(
            f"digital frames ({', '.join(digital)}) are driven in pixels, films in millimetres, and a drive table has "
            "one unit; put their models into different bundles"
        )


def _solution_warnings(bundle: BundleState, ingredients: TableIngredients) -> Iterator[ProjectWarning]:
    solution = bundle.adjusted
    if _is_stale(bundle):
        text = "was adjusted before the stores changed; run 'orip solve', then make the table again"
        yield ProjectWarning("stale-solution", f"bundle {solution.bundle}", text)
    if solution.status in ("not_converged", "not_determined", "stopped"):
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
        readout = _parameter(solution, camera, READOUT)
        if readout:
            photos = {photo.name for key, photo in used.items() if record_key(photo.camera) == record_key(camera.name)}
            moved = max((one.pixels for one in solution.motions if one.photo in photos), default=0.0)
            text = (
                f"has a readout of {readout:.4g} s, which a drive table does not hold: places are those of the middle "
                f"row, and off by up to half of the motion of the photos, {moved:.1f} px at most"
            )
            yield ProjectWarning("readout", f"camera {camera.name}", text)


def _parameter(solution: Solution, camera: Camera, place: int) -> float:
    row = list(map(record_key, solution.cameras.names)).index(record_key(camera.name))
    return float(solution.cameras.values[row, place])


def _is_stale(bundle: BundleState) -> bool:
    inputs = dict(bundle.adjusted.inputs)
    return not bundle.is_measured or any(inputs.get(name) != digest for name, digest in bundle.digests)
