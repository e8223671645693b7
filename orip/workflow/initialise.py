"""`orip init`: the records of orip.toml into the stores."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.stores.provenance import read_inputs, write_inputs
from orip.files.stores.transaction import writing
from orip.interior.distortion_forms import polynomial_from_curve, polynomial_from_isp
from orip.model.camera import CAMERA_PARAMETERS, Camera
from orip.model.names import record_key
from orip.workflow.project import Project, open_project
from orip.workflow.reconcile import Change, Conflict, Prefer, reconcile
from orip.workflow.records import StoredDefinitions, read_definitions, write_definitions
from orip.workflow.texts import check_texts, digests

_POLYNOMIAL = slice(CAMERA_PARAMETERS.index("A1"), CAMERA_PARAMETERS.index("A7") + 1)


@dataclass(frozen=True, slots=True)
class Initialised:
    """What `orip init` did: the changes of records (none: nothing had changed), and what to know."""

    project: Project
    created: bool
    changes: tuple[Change, ...]
    warnings: tuple[ProjectWarning, ...]


def initialise(folder: Path, prefer: Prefer | None = None) -> Initialised:
    """Apply orip.toml to the stores; records that its text has not changed since stay as they are.

    Parameters
    ----------
    folder : Path
    prefer : {"text", "store"} or None
        Which side wins where text and store have both changed a record.

    Raises
    ------
    InputError
        With everything that is wrong in any text file, or with all conflicts; nothing is written then.
    """
    project = open_project(folder)
    warnings = (*project.warnings, *check_texts(project))
    with writing(project.record_stores) as stores:
        old = read_definitions(project, stores)
        text_cameras = tuple(_with_polynomial(camera) for camera in project.definition.cameras)
        name = project.definition.name
        definition = project.definition
        cameras = reconcile("camera", text_cameras, old.cameras, name, prefer, shared=True)
        temticks = reconcile("temtick", definition.temticks, old.temticks, name, prefer, shared=True)
        templates = reconcile("template", definition.templates, old.templates, name, prefer, shared=False)
        photos = reconcile("photo", definition.photos, old.photos, name, prefer, shared=False)
        bundles = reconcile("bundle", definition.bundles, old.bundles, name, prefer, shared=False)
        outcomes = (cameras, temticks, templates, photos, bundles)
        _raise_conflicts(project, [conflict for each in outcomes for conflict in each.conflicts])
        new = StoredDefinitions(cameras.records, temticks.records, templates.records, photos.records, bundles.records)
        write_definitions(project, stores, old, new)
        text = digests(project, [project.text])
        created = not read_inputs(stores[project.exterior], "init")
        if read_inputs(stores[project.exterior], "init") != text:
            write_inputs(stores[project.exterior], "init", text)
    changes = tuple(change for each in outcomes for change in each.changes)
    return Initialised(project, created, changes, warnings)


def _with_polynomial(camera: Camera) -> Camera:
    """Return the camera with its distortion taken to the polynomial, if it was given in another form."""
    if camera.distortion_isp is not None:
        polynomial = polynomial_from_isp(camera.distortion_isp)
    elif camera.distortion_curve is not None:
        polynomial, _ = polynomial_from_curve(camera.distortion_curve)
    else:
        return camera
    parameters = list(camera.parameters)
    parameters[_POLYNOMIAL] = (float(value) for value in polynomial)
    return replace(camera, parameters=tuple(parameters))


def _raise_conflicts(project: Project, conflicts: list[Conflict]) -> None:
    if not conflicts:
        return
    remedy = "keep one of them with 'orip init --prefer text' or 'orip init --prefer store'"
    raise InputError(
        [
            Complaint(
                f"{conflict.kind} {conflict.name} {conflict.text}; {remedy}",
                project.shown(project.text),
                project.lines.get((conflict.kind, record_key(conflict.name))),
            )
            for conflict in conflicts
        ]
    )
