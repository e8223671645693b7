"""A project as another program has it: cameras, photos, points and rays in that program's own conventions.

Readers of `orip.exchange` return it and writers take it. What its numbers mean is declared beside them (`ImageAxes`,
`PoseReading`, `Lens`); `orip.exchange.conversion` takes them to orip's conventions and back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from msgspec import Struct, field

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.records.control import IN_PROJECT, ControlDistance, ControlPoint, Station, StationReference

RotationForm = Literal["matrix", "quaternion", "rotation_vector", "omega_phi_kappa", "phi_omega_kappa"]
AngleUnit = Literal["radian", "degree", "gon"]

Lens = Literal[
    "opencv", "agisoft", "fraser", "measured", "isp", "division", "equidistant", "fisheye624", "fov", "eucm",
    "agisoft_fisheye", "angle_polynomial", "unsupported",
]  # fmt: skip
"""Formula of a camera; `orip.exchange.conversion.lens_exact` has them, with the names of their parameters."""


class ImageAxes(Struct, frozen=True):
    """How image coordinates are counted; x to the right.

    Parameters
    ----------
    unit : {"pixel", "mm"}
    origin : {"corner", "first_pixel", "frame_centre"}
        Outer corner of the upper left pixel; centre of that pixel; middle of the frame.
    y : {"down", "up"}
    """

    unit: Literal["pixel", "mm"] = "pixel"
    origin: Literal["corner", "first_pixel", "frame_centre"] = "corner"
    y: Literal["down", "up"] = "down"


PIXELS = ImageAxes()
"""Those of orip: columns to the right and rows down from the outer corner of the upper left pixel."""


class ExchangedCamera(Struct, frozen=True):
    """A camera.

    Parameters
    ----------
    name : str
        As the other program has it.
    columns, rows : int
        Of the frame; 0: the file does not say.
    parameters : mapping of str to float
        By the names of the lens' parameters; those that are missing are 0. Focal lengths and principal point are in
        `lens_axes`.
    model : str
        What the other program calls its model, for messages and for writing back.
    lens_axes : ImageAxes
        Of the focal length, the principal point and distortion.
    ray_axes : ImageAxes
        Of the measurements in photos of this camera.
    sensor_mm : tuple of 2 float, or None
        Width and height of the frame; None: the file does not say.
    free : tuple of str
        Parameters that the other program has estimated.
    """

    name: str
    columns: int
    rows: int
    lens: Lens
    parameters: Mapping[str, float]
    model: str = ""
    lens_axes: ImageAxes = PIXELS
    ray_axes: ImageAxes = PIXELS
    sensor_mm: tuple[float, float] | None = None
    free: tuple[str, ...] = ()

    @property
    def frame(self) -> tuple[int, int]:
        """Return columns and rows."""
        return self.columns, self.rows


class PoseReading(Struct, frozen=True):
    """What the numbers of poses mean; where a format does not say, there are several readings to be tried.

    Parameters
    ----------
    camera_axes : {"y_down", "y_up"}
        x right, y down, z forward; or x right, y up, z backward as orip.
    sense : {"to_camera", "to_ground"}
        The rotation takes ground axes to camera axes, or the other way.
    form : {"matrix", "quaternion", "rotation_vector", "omega_phi_kappa", "phi_omega_kappa"}
        9 numbers by rows; 4 numbers (w, x, y, z); 3 numbers, axis times angle; 3 angles of Rx(omega) Ry(phi) Rz(kappa),
        or of Ry(phi) Rx(omega) Rz(kappa), always given as omega, phi, kappa.
    unit : {"radian", "degree", "gon"}
        Of angles.
    position : {"centre", "translation"}
        The projection centre; or t of: camera coordinates = rotation to the camera · ground coordinates + t.
    """

    camera_axes: Literal["y_down", "y_up"] = "y_down"
    sense: Literal["to_camera", "to_ground"] = "to_camera"
    form: RotationForm = "matrix"
    unit: AngleUnit = "radian"
    position: Literal["centre", "translation"] = "centre"


class ExchangedPhoto(Struct, frozen=True):
    """A photo.

    Parameters
    ----------
    name : str
        As the other program has it, with folders and blanks.
    camera : int
        Its place among the cameras.
    rotation : tuple of float
        9, 4 or 3 numbers as the reading's form says; empty: not oriented.
    position : tuple of 3 float, or empty
        As the reading says.
    position_deviation : tuple of 3 float, or None
        Standard deviations of the adjusted projection centre.
    position_covariance : tuple of 9 float, or None
        Its covariances, by rows.
    pose_covariance : tuple of 36 float, or None
        By rows, of the rotation vector from the camera's axes to the ground (radians) and of the projection centre.
    angle_deviation : tuple of 3 float, or None
        Standard deviations of the adjusted omega, phi and kappa, degrees.
    key : int
        Number in the file that the photo is found by when a result is written back.
    footprint : tuple of tuple of 3 float
        Corners of what the photo shows of the ground, for drawings; empty where it is not known.
    """

    name: str
    camera: int
    rotation: tuple[float, ...] = ()
    position: tuple[float, ...] = ()
    position_deviation: tuple[float, float, float] | None = None
    position_covariance: tuple[float, ...] | None = None
    pose_covariance: tuple[float, ...] | None = None
    angle_deviation: tuple[float, float, float] | None = None
    key: int = 0
    footprint: tuple[tuple[float, float, float], ...] = ()


class ExchangedPoints(Struct, frozen=True):
    """m points that are measured or have coordinates: marks, which have names, and tracks, which have numbers.

    Mark 7 and track 7 are two points. Control and distances are those of marks.

    Parameters
    ----------
    names : tuple of m str
        As the other program has them; different from one another among tracks, and among the others.
    coordinates : array (m, 3)
        NaN where they are not known.
    is_track : array (m,) of bool
        The name is the number of a track, which orip calls T and the number; else a point with a name of its own.
    covariance : array (m, 3, 3), or None
        Of adjusted coordinates; NaN where it is not known.
    ellipse : array (m, 3), or None
        Standard error ellipse of X and Y: semi-major and semi-minor axis, and the direction of the former from X to Y,
        radians; NaN where it is not known.
    residual : array (m,), or None
        Mean length of the residuals of a point's rays, pixels; NaN where it is not known.
    """

    names: tuple[str, ...]
    coordinates: FloatArray
    is_track: BoolArray
    covariance: FloatArray | None = None
    ellipse: FloatArray | None = None
    residual: FloatArray | None = None

    @property
    def marks(self) -> dict[str, int]:
        """Return the places of marks by their names."""
        return {self.names[place]: place for place in np.flatnonzero(~self.is_track).tolist()}

    @property
    def tracks(self) -> dict[str, int]:
        """Return the places of tracks by their numbers."""
        return {self.names[place]: place for place in np.flatnonzero(self.is_track).tolist()}


class ExchangedRays(Struct, frozen=True):
    """k measurements of points in photos.

    Parameters
    ----------
    photo, point : arrays (k,) of int
        Places among photos and points.
    image : array (k, 2)
        In the `ray_axes` of the photo's camera.
    deviation : array (k,)
        A-priori standard deviation of a coordinate in the unit of these axes; NaN where the file does not say.
    is_active : array (k,) of bool
        False: measured, but the other program leaves it out.
    """

    photo: IntArray
    point: IntArray
    image: FloatArray
    deviation: FloatArray
    is_active: BoolArray


class StatedError(Struct, frozen=True):
    """The reprojection error that a file states, pixels.

    Parameters
    ----------
    of : {"rms", "mean", "mean_of_points"}
        Root mean square of the lengths of the residuals, their mean, or the mean over points of their mean lengths.
    """

    value: float
    of: Literal["rms", "mean", "mean_of_points"] = "rms"


class GroundFrame(Struct, frozen=True):
    """What ground coordinates refer to where this is not the project's system.

    Parameters
    ----------
    kind : {"plain", "geocentric", "topocentric"}
        The system of `ExchangedProject.crs`, or an arbitrary one if there is none; geocentric X, Y, Z (m); east, north
        and up (m) at an origin.
    origin : tuple of 3 float
        Longitude, latitude (degrees) and ellipsoidal height (m) of a topocentric frame's origin.
    named : str
        What the file calls it, for messages.
    """

    kind: Literal["plain", "geocentric", "topocentric"] = "plain"
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    named: str = "the place of the photos"


class MappedPlaces(Struct, frozen=True):
    """Adjusted places in the system that control is given in, where photos and points have another one.

    Parameters
    ----------
    photos : array (n, 3)
        Projection centres.
    points : array (m, 3)
    """

    photos: FloatArray
    points: FloatArray


class ExchangedMounting(Struct, frozen=True):
    """How a camera is mounted on a rig, against the reference camera of the rig; axes as in the reading of the poses.

    Parameters
    ----------
    camera : int
        Its place among the cameras.
    rotation : tuple of 9 float, or empty
        By rows, from the axes of the camera to those of the reference camera; empty: not known.
    offset : tuple of 3 float, or empty
        Projection centre along the axes of the reference camera, ground unit.
    rotation_error, offset_error : tuple of 3 float, or None
        With which they are observed, degrees about the axes of the reference camera, ground unit.
    is_held : bool
        The other program does not estimate it.
    """

    camera: int
    rotation: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()
    rotation_error: tuple[float, float, float] | None = None
    offset_error: tuple[float, float, float] | None = None
    is_held: bool = False


class ExchangedRig(Struct, frozen=True):
    """Cameras on one body, the reference first."""

    name: str
    mountings: tuple[ExchangedMounting, ...]


class ExchangedExposure(Struct, frozen=True):
    """Photos that the cameras of a rig took at the same instant, by their places."""

    name: str
    photos: tuple[int, ...]


class ExchangedProject(Struct, frozen=True):
    """All that is exchanged with another program.

    Parameters
    ----------
    name : str
        Of the project; empty: the file has none.
    readings : tuple of PoseReading
        Of the poses; more than one where the format does not say, the likeliest first.
    control : tuple of ControlPoint
        By the name of the point; negative errors: a check point. Errors are None where the file has none.
    checks : frozenset of str
        Names of control points that the other program only compares, whether it gives them errors or not.
    control_crs : str
        What control coordinates refer to, x or longitude first; empty: the system of all others.
    control_named : str
        Where that is said, for messages.
    stations : tuple of Station
        By the name of the photo.
    station_reference : StationReference
        What positions of stations refer to.
    crs : str or None
        None: an arbitrary or plain system.
    precision : float or None
        A-priori error of a measurement, pixels; None: as the residuals of the import say.
    is_calibration : bool
        It has cameras, and no photos.
    mapped : MappedPlaces or None
        Of a result whose frame is not the system of `control_crs`.
    notes : tuple of str
        What orip has no place for and is lost, a sentence each.
    """

    name: str
    cameras: tuple[ExchangedCamera, ...]
    photos: tuple[ExchangedPhoto, ...]
    points: ExchangedPoints
    rays: ExchangedRays
    readings: tuple[PoseReading, ...] = (PoseReading(),)
    control: tuple[ControlPoint, ...] = ()
    checks: frozenset[str] = frozenset()
    control_crs: str = ""
    control_named: str = ""
    stations: tuple[Station, ...] = ()
    station_reference: StationReference = IN_PROJECT
    distances: tuple[ControlDistance, ...] = ()
    crs: str | None = None
    ground_unit: str = "unit"
    frame: GroundFrame = field(default_factory=GroundFrame)
    precision: float | None = 1.0
    stated: StatedError | None = None
    is_calibration: bool = False
    mapped: MappedPlaces | None = None
    rigs: tuple[ExchangedRig, ...] = ()
    exposures: tuple[ExchangedExposure, ...] = ()
    notes: tuple[str, ...] = ()
