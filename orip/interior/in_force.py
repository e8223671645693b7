"""The interior orientation in force, and the way back from stored coordinates to those of a measurement log."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from orip.errors import Complaint, OrientationError, ProjectWarning
from orip.geometry.plane import IDENTITY, PlaneTransformation
from orip.interior.definitions import Definitions
from orip.interior.image_coordinates import pixel_size, scan_transformation
from orip.interior.orientation import orient_photo, orient_template, transformation_without_marks
from orip.records.names import record_key
from orip.records.observations.measurement import Measured
from orip.records.project.photo import Photo
from orip.records.results.interior import MarkAdjustment


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
        text = "is a mirror image: the film or scan lies upside down, or its row axis is not declared by 'scan'"
        found.append(ProjectWarning("mirrored", where, text))
    if summary.redundancy == 0:
        text = "has no redundancy: a wrong mark would not be noticed; measure one more"
        found.append(ProjectWarning("no-redundancy", where, text))
    return found


# A log has plate millimetres of the mounting in force, or pixels of a scan or digital frame.


def stored_to_log(
    photo: Photo, definitions: Definitions, to_template: Mapping[str, PlaneTransformation]
) -> PlaneTransformation | None:
    """Return stored coordinates of a photo to those of a log; None where its template is not oriented.

    Parameters
    ----------
    photo : Photo
    definitions : Definitions
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
