"""Measurements: the records of a log, the state that replaying it leaves, and vertices measured in stereo."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from msgspec import Struct, field

from orip.records.camera import Camera
from orip.records.photo import Stage, Temtick

if TYPE_CHECKING:
    from orip.arrays import BoolArray, FloatArray, IntArray


TransformationKind = Literal["A", "C", "W"]
"""Plane transformations: A affine, C conformal, W conformal without scale."""


class MeasuredMarks(Struct, frozen=True):
    """Tick or fiducial marks as measured.

    Parameters
    ----------
    names : tuple of str, length n
    measured : array (n, 2)
        Measured coordinates: plate or template millimetres, or pixels straight from a log of a scan.
    disregarded : array (n,) of bool
        Residual listed, no influence.
    given : array (n, 2)
        The mark's own photo coordinates, mm; NaN where the camera or temtick record has them.
    """

    names: tuple[str, ...]
    measured: FloatArray
    disregarded: BoolArray
    given: FloatArray


class TextPlace(Struct, frozen=True):
    """Where in the text something stands."""

    path: str
    line: int


class TemplateRecord(Struct, frozen=True):
    """``TEMPLATE``: a template is mounted and its tick marks are measured on the plate."""

    place: TextPlace
    template: str
    transformation: TransformationKind
    stage: Stage | None
    marks: MeasuredMarks


class PhotoRecord(Struct, frozen=True):
    """``PHOTO``: fiducial marks of one photo, plate coordinates."""

    place: TextPlace
    photo: str
    transformation: TransformationKind
    marks: MeasuredMarks


class PointsRecord(Struct, frozen=True):
    """``POINTS``: photo points of one bundle in one photo, plate coordinates (pixels for sensor or scan).

    Parameters
    ----------
    names : tuple of str, length n
    measured : array (n, 2)
    errors : array (n, 2)
        Own a-priori errors along the photo axes; NaN: the bundle's measurement precision; negative: disregarded.
    errors_in_pixels : array (n, 2) of bool
        Whether that error was given as '0.5px'; the others are millimetres.
    disregarded : array (n,) of bool
    lines : array (n,) of int
    """

    place: TextPlace
    bundle: str
    photo: str
    names: tuple[str, ...]
    measured: FloatArray
    errors: FloatArray
    errors_in_pixels: BoolArray
    disregarded: BoolArray
    lines: IntArray


class EditRecord(Struct, frozen=True):
    """``DISREGARD``, ``INCLUDE`` or ``KILL`` of a point, mark or tick; ``RENAME`` of a point.

    `owner` is the photo (template for a tick), `name` the point, mark or tick; ``*`` stands for all. Only points have a
    `bundle`, and a `new_name` where they are renamed.
    """

    place: TextPlace
    action: Literal["DISREGARD", "INCLUDE", "KILL", "RENAME"]
    what: Literal["POINT", "MARK", "TICK"]
    bundle: str | None
    owner: str
    name: str
    new_name: str | None = None


class FiducialsRecord(Struct, frozen=True):
    """``FIDUCIALS``: fiducial marks of a camera, digitised in plate coordinates."""

    place: TextPlace
    camera: str
    arrangement: Literal["corners", "midsides"]
    marks: MeasuredMarks


class TicksRecord(Struct, frozen=True):
    """``TICKS``: tick marks of a temtick record, digitised and taken as they are."""

    place: TextPlace
    temtick: str
    marks: MeasuredMarks


LogRecord = TemplateRecord | PhotoRecord | PointsRecord | EditRecord | FiducialsRecord | TicksRecord


class TemplateOrientation(Struct, frozen=True):
    """Tick marks of a template as measured on the stage plate (plate mm): what orients it."""

    template: str
    transformation: TransformationKind
    stage: Stage | None
    marks: MeasuredMarks


class PhotoOrientation(Struct, frozen=True):
    """Fiducial marks of a photo in template (off a template: plate) millimetres: what orients it."""

    photo: str
    transformation: TransformationKind
    marks: MeasuredMarks


class PhotoObservations(Struct, frozen=True):
    """Photo points of one bundle adjustment, sorted by photo and point as they were measured.

    Parameters
    ----------
    photos, points : sequences of str, length n
        Photo and point of each observation.
    measured : array (n, 2)
        Template coordinates (plate off a template), mm; pixels for a digital frame.
    errors : array (n, 2)
        Own a-priori errors along the photo axes, mm; NaN: the bundle's measurement precision; negative: disregarded.
    disregarded : array (n,) of bool
        Residual listed, no influence.
    """

    bundle: str
    photos: Sequence[str]
    points: Sequence[str]
    measured: FloatArray
    errors: FloatArray
    disregarded: BoolArray


def no_observations(bundle: str) -> PhotoObservations:
    """Return the observations of a bundle in which nothing is measured yet."""
    import numpy as np  # `orip status` needs the records, and no arrays

    return PhotoObservations(bundle, (), (), np.empty((0, 2)), np.empty((0, 2)), np.empty(0, dtype=bool))


class Measured(Struct, frozen=True):
    """What is measured: orientations by `record_key`, observations by bundle, digitised marks taken into records."""

    templates: dict[str, TemplateOrientation] = field(default_factory=dict)
    photos: dict[str, PhotoOrientation] = field(default_factory=dict)
    observations: dict[str, PhotoObservations] = field(default_factory=dict)
    cameras: dict[str, Camera] = field(default_factory=dict)
    temticks: dict[str, Temtick] = field(default_factory=dict)


FeatureKind = Literal["POINT", "LINE", "AREA"]
FEATURE_KINDS: tuple[FeatureKind, ...] = ("POINT", "LINE", "AREA")

LEAST_VERTICES: dict[FeatureKind, int] = {"POINT": 1, "LINE": 2, "AREA": 3}


class StereoVertex(Struct, frozen=True):
    """A vertex measured in two photos.

    Parameters
    ----------
    left, right : str
        Photos.
    left_xy, right_xy : tuple (x, y)
        Pixels of a digital frame, else mm in the photo.
    error : float or None
        A-priori error of each coordinate, in the same unit; None: that of the photo's points in the adjustment.
    line : int
        Where it stands in its file.
    """

    left: str
    left_xy: tuple[float, float]
    right: str
    right_xy: tuple[float, float]
    error: float | None = None
    line: int = 0


class StereoFeature(Struct, frozen=True):
    """A point, line or area as measured; of a point the vertices are points of one name, of an area its outline.

    Parameters
    ----------
    kind : {"POINT", "LINE", "AREA"}
    code : str
        What it is, such as ROAD.
    name : str
        Which one it is: with its code it names the feature in a file.
    line : int
        Where it stands in its file.
    """

    kind: FeatureKind
    code: str
    name: str
    vertices: tuple[StereoVertex, ...]
    line: int = 0
