"""The drive table: what the plate processor has to know to drive from model to model, and its error codes.

Every name is in the form of `record_key`. A template or photo is mounted on the upper or the lower stage plate; the
left eyepiece shows the upper one, so that a model whose left photo is on the lower stage has its optics swapped.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Literal, NamedTuple

from msgspec import Struct

from orip.records.camera import AdditionalSet, DistortionArgument, Projection
from orip.records.photo import Stage

STAGES: tuple[Stage, Stage] = ("UPPER", "LOWER")
"""The stages in the order of every pair of plate positions."""

PlateUnit = Literal["mm", "px"]

Optics = Literal["NORMAL", "SWAPPED"]

Triple = tuple[float, float, float]


class DriveCode(IntEnum):
    """Error codes of the plate processor; `NONE` is no error."""

    NONE = 0
    UNKNOWN_VERB = 100
    ARGUMENT_COUNT = 101
    NOT_A_NUMBER = 102
    LINE_TOO_LONG = 103
    BAD_KEYWORD = 104
    BUSY = 110
    TABLE_FORMAT = 120
    TABLE_DAMAGED = 121
    TABLE_INCONSISTENT = 122
    TABLE_TOO_LARGE = 123
    NO_TABLE = 200
    UNKNOWN_MODEL = 201
    UNKNOWN_PHOTO = 202
    ONE_STAGE = 203
    LOCKED = 204
    WRONG_GUIDE = 205
    BEHIND_CAMERA = 310
    OUTSIDE_STAGE = 311
    NOT_INVERTIBLE = 312
    PARALLEL_RAYS = 313
    FORBIDDEN = 403
    INTERNAL = 900


class DriveFault(NamedTuple):
    """Why something was refused: its code, and a sentence for people."""

    code: DriveCode
    text: str


class StageLimits(Struct, frozen=True):
    """Travel of a stage in plate units, and the least count that its read-out is rounded to."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float
    least_count: float


class DriveParameterSet(Struct, frozen=True):
    """Additional parameters of a camera: the set, its base (mm), and all values in the order of the set's names."""

    name: AdditionalSet
    base: float
    values: tuple[float, ...]


class DriveCamera(Struct, frozen=True):
    """A camera as adjusted.

    Parameters
    ----------
    parameters : tuple of 12 floats
        In the order of `CAMERA_PARAMETERS`, without the readout: stages stand still.
    frame : tuple (x, y)
        Size of the photo frame, mm; a zero means that there is no frame line in that direction.
    distortion_at : {"ideal", "measured"}
    projection : {"perspective", "equidistant"}
    """

    name: str
    parameters: tuple[float, ...]
    frame: tuple[float, float]
    distortion_at: DistortionArgument
    additional: DriveParameterSet | None = None
    projection: Projection = "perspective"


class DriveTemplate(Struct, frozen=True):
    """A template and the stage that it is mounted on."""

    name: str
    stage: Stage


class DrivePhoto(Struct, frozen=True):
    """A photo as adjusted.

    Parameters
    ----------
    stage : {"UPPER", "LOWER"}
    centre : tuple (X0, Y0, Z0)
        Ground units.
    rotation : tuple of 9 floats
        Photo axes to ground axes, row by row.
    affine : tuple (a0, a1, a2, b0, b1, b2)
        Photo (mm) to plate: x = a0 + a1 xf + a2 yf, y = b0 + b1 xf + b2 yf.
    """

    name: str
    camera: str
    template: str | None
    stage: Stage
    centre: Triple
    rotation: tuple[float, ...]
    affine: tuple[float, ...]


class DriveModel(Struct, frozen=True):
    """Two photos seen stereoscopically, and the model's place in the block (1, 1 is upper left)."""

    name: str
    row: int
    column: int
    left: str
    right: str
    optics: Optics


class DriveTable(Struct, frozen=True):
    """Everything that is downloaded to the plate processor.

    Parameters
    ----------
    block, project, user : str
        Names of the bundle adjustment, of the project, and of who works on it (may be empty).
    plate_unit : {"mm", "px"}
    start : tuple (X, Y, Z)
        Where the measuring mark is driven to after the download.
    """

    block: str
    project: str
    user: str
    plate_unit: PlateUnit
    object_unit: str
    upper: StageLimits
    lower: StageLimits
    cameras: tuple[DriveCamera, ...]
    templates: tuple[DriveTemplate, ...]
    photos: tuple[DrivePhoto, ...]
    models: tuple[DriveModel, ...]
    start: Triple

    def limits(self, stage: Stage) -> StageLimits:
        """Return the limits of a stage."""
        return self.upper if stage == "UPPER" else self.lower
