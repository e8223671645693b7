"""The interior orientation in force, and where to look for marks before enough of them are measured."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint, OrientationError, ProjectWarning
from orip.geometry.plane import IDENTITY, MARKS_NEEDED, PlaneTransformation, fit_plane_transformation
from orip.interior.definitions import Definitions
from orip.interior.image_coordinates import pixel_size, scan_transformation
from orip.interior.orientation import (
    given_coordinates_of_photo,
    given_coordinates_of_template,
    orient_photo,
    orient_template,
    transformation_without_marks,
)
from orip.records.camera import Camera, Mark
from orip.records.interior import MarkAdjustment
from orip.records.measurement import (
    Measured,
    MeasuredMarks,
    PhotoOrientation,
    TemplateOrientation,
    TransformationKind,
)
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.wording import counted


class Interior(Struct, frozen=True):
    """The interior orientation of a project.

    Parameters
    ----------
    adjustments : tuple of MarkAdjustment
        Templates first, each kind in the order of its definition.
    to_template : mapping by `record_key`
        Plate to template millimetres, for templates that are oriented.
    to_photo : mapping by `record_key`
        Stored coordinates to photo millimetres, for photos that are oriented.
    pixel_sizes : mapping by `record_key`
        mm along the photo's x and y axes, for photos with a sensor or scan.
    complaints : tuple of Complaint
        Orientations that are not valid.
    warnings : tuple of ProjectWarning
        Mirror images, and marks without redundancy.
    """

    adjustments: tuple[MarkAdjustment, ...]
    to_template: Mapping[str, PlaneTransformation]
    to_photo: Mapping[str, PlaneTransformation]
    pixel_sizes: Mapping[str, tuple[float, float]]
    complaints: tuple[Complaint, ...]
    warnings: tuple[ProjectWarning, ...]


def interior_orientation(definitions: Definitions, measured: Measured) -> Interior:
    """Orient all templates and photos from their measured marks."""
    adjustments: list[MarkAdjustment] = []
    complaints: list[Complaint] = []
    to_template: dict[str, PlaneTransformation] = {}
    for key, template in definitions.templates.items():
        if key in measured.templates:
            ticks = definitions.temticks[record_key(template.temtick)].ticks
            try:
                mounted = orient_template(measured.templates[key], ticks)
            except OrientationError as error:
                complaints.append(Complaint(str(error)))
                continue
            to_template[key] = mounted.transformation
            adjustments.append(mounted.adjustment)
    to_photo: dict[str, PlaneTransformation] = {}
    for key, photo in definitions.photos.items():
        camera = definitions.cameras[record_key(photo.camera)]
        without_marks = transformation_without_marks(camera)
        if without_marks is not None:
            to_photo[key] = without_marks
        if key in measured.photos:
            try:
                oriented = orient_photo(measured.photos[key], camera, photo.template is not None)
            except OrientationError as error:
                complaints.append(Complaint(str(error)))
                continue
            to_photo[key] = oriented.transformation
            adjustments.append(oriented.adjustment)
    warnings = tuple(warning for adjustment in adjustments for warning in _warnings(adjustment))
    pixel_sizes = _pixel_sizes(definitions, to_template, to_photo)
    return Interior(tuple(adjustments), to_template, to_photo, pixel_sizes, tuple(complaints), warnings)


def _pixel_sizes(
    definitions: Definitions,
    to_template: Mapping[str, PlaneTransformation],
    to_photo: Mapping[str, PlaneTransformation],
) -> dict[str, tuple[float, float]]:
    sizes = {}
    for key, photo in definitions.photos.items():
        camera, template = definitions.camera_of(photo), definitions.template_of(photo)
        mounted = IDENTITY if template is None else to_template.get(record_key(template.name))
        oriented = to_photo.get(key)
        plate_to_photo = oriented.after(mounted) if oriented and mounted else None
        size = pixel_size(photo, camera, template, plate_to_photo)
        if size is not None:
            sizes[key] = size
    return sizes


def _warnings(adjustment: MarkAdjustment) -> list[ProjectWarning]:
    summary = adjustment.summary
    where = f"{summary.group[:-1]} {summary.name}"
    found = []
    if adjustment.mirrored:
        record = "camera" if summary.group == "photos" else "temtick"
        text = (
            "is a mirror image: the film or scan lies upside down, or its row axis is not declared by 'scan', or its "
            f"marks have the wrong sign of x or of y in the [[{record}]] of orip.toml"
        )
        found.append(ProjectWarning("mirrored", where, text))
    if summary.redundancy == 0:
        text = "no redundancy of the marks: a wrong one would not be noticed; measure one more"
        found.append(ProjectWarning("no-redundancy", where, text))
    return found


# A log has plate millimetres of the mounting in force, or pixels of a scan or digital frame.


def stored_to_log(
    photo: Photo, definitions: Definitions, to_template: Mapping[str, PlaneTransformation]
) -> PlaneTransformation | None:
    """Return stored coordinates of a photo to those of a log; None where its template is not oriented.

    Parameters
    ----------
    to_template : mapping by `record_key`
        Plate to template millimetres of the templates that are oriented.
    """
    if definitions.camera_of(photo).sensor is not None:
        return IDENTITY
    template = definitions.template_of(photo)
    mounted = IDENTITY if template is None else to_template.get(record_key(template.name))
    if mounted is None:
        return None
    scan = photo.scan or (template.scan if template else None)
    to_plate = mounted.inverse()
    return to_plate if scan is None else scan_transformation(scan).inverse().after(to_plate)


# An instrument has to drive somewhere before all marks are measured. With fewer marks than its transformation needs, a
# film is oriented by what there is: none, as it was oriented before; one, as before and shifted; two, by a conformal
# transformation. Such an orientation is not final: no photo coordinate may come from it.


class DrivingOrientation(NamedTuple):
    """A transformation (measured to given coordinates) that may be driven by.

    Attributes
    ----------
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
