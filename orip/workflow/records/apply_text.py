"""All records of orip.toml against those of the stores: what the stores should hold, and the conflicts."""

from __future__ import annotations

import math
from collections.abc import Iterable

from msgspec import Struct

from orip.errors import Complaint, InputError
from orip.records.names import record_key
from orip.records.project.camera import RADIAL_PLACES, Camera
from orip.structs import replace
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.records.reconcile import AppliedChange, Conflict, Prefer, reconcile


class TextApplied(Struct, frozen=True):
    """The definitions after orip.toml is applied, what that changes, and a complaint for every conflict."""

    definitions: StoredDefinitions
    changes: tuple[AppliedChange, ...]
    complaints: tuple[Complaint, ...]


def apply_text(project: ProjectFolder, old: StoredDefinitions, prefer: Prefer | None) -> TextApplied:
    """Apply the records of orip.toml to those of the stores; nothing is written."""
    text, name = project.definition, project.definition.name
    cameras = reconcile(
        "camera", [with_polynomial(camera) for camera in text.cameras], old.cameras, name, prefer, shared=True
    )
    temticks = reconcile("temtick", text.temticks, old.temticks, name, prefer, shared=True)
    templates = reconcile("template", text.templates, old.templates, name, prefer, shared=False)
    photos = reconcile("photo", text.photos, old.photos, name, prefer, shared=False)
    bundles = reconcile("bundle", text.bundles, old.bundles, name, prefer, shared=False)
    outcomes = (cameras, temticks, templates, photos, bundles)
    return TextApplied(
        StoredDefinitions(cameras.records, temticks.records, templates.records, photos.records, bundles.records),
        tuple(change for outcome in outcomes for change in outcome.changes),
        tuple(_complaints(project, (conflict for outcome in outcomes for conflict in outcome.conflicts))),
    )


def with_polynomial(camera: Camera) -> Camera:
    """Return the camera with its distortion converted to the polynomial, if it was given in another form.

    Raises
    ------
    InputError
        If that form has no polynomial.
    """
    if camera.distortion_isp is None and camera.distortion_curve is None:
        return camera
    try:
        polynomial = _polynomial(camera)
    except (ValueError, ArithmeticError) as fault:
        form = "distortion_curve" if camera.distortion_isp is None else "distortion_isp"
        message = f"{form} of camera '{camera.name}' has no polynomial ({fault}); correct it"
        raise InputError.single(message) from fault
    parameters = list(camera.parameters)
    parameters[RADIAL_PLACES] = polynomial
    return replace(camera, parameters=tuple(parameters))


def _polynomial(camera: Camera) -> list[float]:
    from orip.interior.distortion import polynomial_from_curve, polynomial_from_isp  # few cameras have them

    if camera.distortion_isp is not None:
        coefficients = polynomial_from_isp(camera.distortion_isp)
    else:
        coefficients, _ = polynomial_from_curve(camera.distortion_curve or ())
    polynomial: list[float] = coefficients.tolist()
    if not all(map(math.isfinite, polynomial)):
        message = "its numbers are too large"
        raise ArithmeticError(message)
    return polynomial


def _complaints(project: ProjectFolder, conflicts: Iterable[Conflict]) -> list[Complaint]:
    remedy = "keep one of them with 'orip init --prefer text' or 'orip init --prefer store'"
    return [
        Complaint(
            f"{conflict.kind} {conflict.name} {conflict.text}; {remedy}",
            project.shown(project.text),
            project.lines.get((conflict.kind, record_key(conflict.name))),
        )
        for conflict in conflicts
    ]
