"""Orientation by marks: ticks orient a template on its plate, fiducial marks a photo on its template or plate."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.errors import OrientationError
from orip.geometry.plane import (
    IDENTITY,
    MARKS_NEEDED,
    PARAMETERS,
    PlaneTransformation,
    TransformationKind,
    fit_plane_transformation,
)
from orip.interior.image_coordinates import sensor_transformation
from orip.records.camera import Camera, Mark
from orip.records.interior import MarkAdjustment
from orip.records.measurement import MeasuredMarks, PhotoOrientation, TemplateOrientation
from orip.records.photo import Stage
from orip.records.results.solution import InteriorSummary
from orip.units import DEGREES_PER_RADIAN
from orip.wording import counted, listed_names

_FITS = 0.01
"""Largest residual, as part of the extent of the marks, with which marks are where they are given."""

_MIRROR_GAIN = 0.1
"""A film is taken for mirrored when turning it over brings the residuals below this part of what they are."""


class OrientedMarks(NamedTuple):
    """A transformation (measured to given coordinates) and its listing."""

    transformation: PlaneTransformation
    adjustment: MarkAdjustment


def orient_template(orientation: TemplateOrientation, ticks: Iterable[Mark]) -> OrientedMarks:
    """Return the transformation plate to template.

    Raises
    ------
    OrientationError
        If a mark is not known, there are too few, or they do not give a transformation.
    """
    given = given_coordinates_of_template(orientation, ticks)
    return _orient(
        orientation.transformation,
        orientation.marks,
        given,
        "templates",
        orientation.template,
        "plate",
        orientation.stage,
    )


def orient_photo(orientation: PhotoOrientation, camera: Camera, on_template: bool) -> OrientedMarks:
    """Return the transformation template (plate off a template) to photo.

    Raises
    ------
    OrientationError
        If a mark is not known, there are too few, or they do not give a transformation.
    """
    given = given_coordinates_of_photo(orientation, camera)
    system: Literal["plate", "template"] = "template" if on_template else "plate"
    return _orient(orientation.transformation, orientation.marks, given, "photos", orientation.photo, system, None)


def given_coordinates_of_template(orientation: TemplateOrientation, ticks: Iterable[Mark]) -> FloatArray:
    """Return the template coordinates (n, 2) of measured ticks: their own, else those of the temtick record.

    Raises
    ------
    OrientationError
        If a mark has none.
    """
    return _given_coordinates(orientation.marks, ticks, f"template {orientation.template}", "its temtick record")


def given_coordinates_of_photo(orientation: PhotoOrientation, camera: Camera) -> FloatArray:
    """Return the photo coordinates (n, 2) of measured fiducial marks: their own, else those of the camera.

    Raises
    ------
    OrientationError
        If a mark has none.
    """
    owner, record = f"photo {orientation.photo}", f"camera {camera.name}"
    return _given_coordinates(orientation.marks, camera.fiducials, owner, record)


def _given_coordinates(marks: MeasuredMarks, record: Iterable[Mark], owner: str, record_name: str) -> FloatArray:
    """Return the given coordinates (n, 2) of measured marks: their own, else the record's."""
    known: Mapping[str, Mark] = {mark.name: mark for mark in record}
    given = marks.given.copy()
    missing = []
    for row, name in enumerate(marks.names):
        if np.isnan(given[row]).any():
            if name in known:
                given[row] = known[name].x, known[name].y
            else:
                missing.append(name)
    if missing:
        message = (
            f"{owner}: {record_name} has no mark {', '.join(missing)}; name one of its marks "
            f"({listed_names(known)}), or give coordinates after '='"
        )
        raise OrientationError(message)
    return given


def transformation_without_marks(camera: Camera) -> PlaneTransformation | None:
    """Return stored coordinates to photo millimetres for a camera that needs no fiducial marks, else None."""
    if camera.sensor is not None:
        return sensor_transformation(camera.sensor)
    return None if camera.fiducials else IDENTITY


def _orient(
    kind: TransformationKind,
    marks: MeasuredMarks,
    given: FloatArray,
    group: Literal["templates", "photos"],
    name: str,
    system: Literal["plate", "template"],
    stage: Stage | None,
) -> OrientedMarks:
    used = ~marks.disregarded
    what = "template" if group == "templates" else "photo"
    if (count := int(np.count_nonzero(used))) < MARKS_NEEDED[kind]:
        message = (
            f"{what} {name} has {counted(count, 'usable mark')}; transformation {kind} needs {MARKS_NEEDED[kind]}: "
            "measure more marks or include disregarded ones"
        )
        raise OrientationError(message)
    try:
        transformation = fit_plane_transformation(kind, marks.measured[used], given[used])
    except ValueError as fault:
        names = [mark for mark, is_used in zip(marks.names, used, strict=True) if is_used]
        remedy = _remedy(kind, names, marks.measured[used], given[used])
        message = f"{what} {name} cannot be oriented: {fault}; {remedy}"
        raise OrientationError(message) from None
    residuals = transformation.apply(marks.measured) - given
    square_sum = float(np.sum(residuals[used] ** 2))
    redundancy = 2 * count - PARAMETERS[kind]
    s0 = float(np.sqrt(square_sum / redundancy)) if redundancy > 0 else float("nan")
    rotation, skew = transformation.rotation_and_skew
    summary = InteriorSummary(
        group, name, kind, float(transformation.shift[0]), float(transformation.shift[1]),
        rotation * DEGREES_PER_RADIAN, skew * DEGREES_PER_RADIAN, *transformation.scales, s0, redundancy,
    )  # fmt: skip
    mirrored = transformation.mirrored or _fits_better_mirrored(kind, marks.measured[used], given[used], square_sum)
    return OrientedMarks(
        transformation, MarkAdjustment(summary, kind, system, stage, marks, given, residuals, mirrored)
    )


def _remedy(kind: TransformationKind, names: list[str], measured: FloatArray, given: FloatArray) -> str:
    """Return what is to be done with marks that no transformation fits as they are."""
    order = np.arange(len(given))
    ways = [(measured * [-1.0, 1.0], order, "they fit as a mirror image: the film or scan lies upside down")]
    for pair in combinations(range(len(given)), 2):
        rows = order.copy()
        rows[list(pair)] = pair[::-1]
        text = f"marks {names[pair[0]]} and {names[pair[1]]} fit when their names are exchanged"
        ways.append((measured, rows, text))
    found = []
    for lying, rows, text in ways:
        try:
            transformation = fit_plane_transformation(kind, lying, given[rows])
        except ValueError:
            continue
        largest = float(np.abs(transformation.apply(lying) - given[rows]).max())
        if not transformation.mirrored and largest < _FITS * np.ptp(given, axis=0).max():
            found.append((largest, text))
    return min(found)[1] if found else "measure marks that are spread over the frame"


def _fits_better_mirrored(kind: TransformationKind, measured: FloatArray, given: FloatArray, square_sum: float) -> bool:
    """Whether turning the film over makes a conformal fit far better; two marks fit either way and cannot tell."""
    if kind == "A" or len(measured) < 3:
        return False
    turned = measured * [-1.0, 1.0]
    try:
        residuals = fit_plane_transformation(kind, turned, given).apply(turned) - given
    except ValueError:
        # a square that lies right fits no conformal transformation when it is turned over
        return False
    return float(np.sum(residuals**2)) < _MIRROR_GAIN**2 * square_sum
