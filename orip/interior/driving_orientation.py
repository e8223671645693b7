"""Orientation for driving: where to look for marks and points while too few marks are measured for an adjustment.

An instrument has to drive somewhere before all marks are measured. With fewer marks than its transformation needs, a
film is oriented by what there is: none, as it was oriented before; one, as before and shifted; two, by a conformal
transformation. Such an orientation is not final: no photo coordinate may come from it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.geometry.plane import IDENTITY, MARKS_NEEDED, PlaneTransformation, fit_plane_transformation
from orip.interior.orientation import given_coordinates_of_photo, given_coordinates_of_template
from orip.records.observations.measurement import (
    MeasuredMarks,
    PhotoOrientation,
    TemplateOrientation,
    TransformationKind,
)
from orip.records.project.camera import Camera, Mark
from orip.wording import counted


class DrivingOrientation(NamedTuple):
    """A transformation (measured to given coordinates) that may be driven by.

    Attributes
    ----------
    transformation : PlaneTransformation
    warning : ProjectWarning or None
        What was put in the place of an adjustment; None where the marks suffice, and the orientation is a final one.
    """

    transformation: PlaneTransformation
    warning: ProjectWarning | None


def drive_template(
    orientation: TemplateOrientation, ticks: Iterable[Mark], stored: PlaneTransformation | None = None
) -> DrivingOrientation:
    """Return plate to template for driving.

    Parameters
    ----------
    orientation : TemplateOrientation
        With any number of marks.
    ticks : iterable of Mark
    stored : PlaneTransformation or None
        The orientation of the mounting before; None: there is none, and the plate is taken for the template.

    Raises
    ------
    OrientationError
        If a mark is not known.
    """
    given = given_coordinates_of_template(orientation, ticks)
    where = f"template {orientation.template}"
    return _drive(orientation.transformation, orientation.marks, given, where, stored)


def drive_photo(
    orientation: PhotoOrientation, camera: Camera, stored: PlaneTransformation | None = None
) -> DrivingOrientation:
    """Return template (plate off a template) to photo for driving; see `drive_template`."""
    given = given_coordinates_of_photo(orientation, camera)
    return _drive(orientation.transformation, orientation.marks, given, f"photo {orientation.photo}", stored)


def _drive(
    kind: TransformationKind,
    marks: MeasuredMarks,
    given: FloatArray,
    where: str,
    stored: PlaneTransformation | None,
) -> DrivingOrientation:
    used = ~marks.disregarded
    measured, target = marks.measured[used], given[used]
    fault = f"{counted(len(measured), 'usable mark')}, and transformation {kind} needs {MARKS_NEEDED[kind]}"
    if len(measured) >= MARKS_NEEDED[kind]:
        try:
            return DrivingOrientation(fit_plane_transformation(kind, measured, target), None)
        except ValueError as reason:
            fault = str(reason)
    fewer: TransformationKind = "W" if kind == "W" else "C"
    try:
        found = fit_plane_transformation(fewer, measured, target)
        instead = "the conformal transformation of these marks"
    except ValueError:
        found, instead = _shifted(measured, target, stored)
    text = f"{fault}: driven by {instead}; as an orientation it is not valid, measure more marks"
    return DrivingOrientation(found, ProjectWarning("driving-only", where, text))


def _shifted(
    measured: FloatArray, target: FloatArray, stored: PlaneTransformation | None
) -> tuple[PlaneTransformation, str]:
    """Return the orientation before, shifted to the marks if there are any, and how a message calls it."""
    before = stored or IDENTITY
    name = "the orientation before" if stored else "no transformation at all"
    if not len(measured):
        return before, name
    shift = target.mean(axis=0) - before.matrix @ measured.mean(axis=0)
    return PlaneTransformation(before.matrix, shift), f"{name}, shifted to the mark"
