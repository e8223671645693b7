"""Ground control: points, elements, distances, directions, exposure stations and their differences; error limits."""

from __future__ import annotations

import math
from typing import Literal

from msgspec import Struct

from orip.units import RADIANS_PER_DEGREE

NOT_GIVEN = (math.nan, math.nan, math.nan)
"""Position or angles of a station that has none; their errors are these too."""

ONLY_COMPARED = (-1.0, -1.0, -1.0)
ANGLES_ONLY_COMPARED = (-RADIANS_PER_DEGREE, -RADIANS_PER_DEGREE, -RADIANS_PER_DEGREE)
"""A-priori errors of positions and angles that are not observed: they have no influence."""


class StationReference(Struct, frozen=True):
    """What positions and angles of stations refer to, as a file says.

    Parameters
    ----------
    crs : str
        Empty: the project's coordinates.
    navigation : bool
        Angles are roll, pitch and heading of a vehicle on which the camera looks down, the top of the picture forward;
        else omega, phi and kappa.
    line : int
        Of the file, where it says so.
    """

    crs: str = ""
    navigation: bool = False
    line: int = 0


IN_PROJECT = StationReference()
"""Coordinates of the project, omega, phi and kappa."""


class StationMotion(Struct, frozen=True):
    """How a station moved while the photo was exposed, along and about the axes of the project.

    Parameters
    ----------
    velocity, velocity_error : tuples of 3 float
        Of what its position is of, ground unit a second, and standard deviations, 0 constant; NaN throughout where it
        is not known.
    rate, rate_error : tuples of 3 float
        Angular rate, radians a second, and standard deviations, as of the velocity.
    """

    velocity: tuple[float, float, float] = NOT_GIVEN
    velocity_error: tuple[float, float, float] = NOT_GIVEN
    rate: tuple[float, float, float] = NOT_GIVEN
    rate_error: tuple[float, float, float] = NOT_GIVEN


class Station(Struct, frozen=True):
    """The exposure station of a photo.

    Parameters
    ----------
    photo : str
        Record name; case does not count.
    position : tuple of 3 float
        X, Y, Z in the project, ground unit; NaN throughout where no position was observed.
    position_error : tuple of 3 float
        Standard deviations, ground unit: 0 constant, negative only compared; NaN as the position.
    angles : tuple of 3 float
        OMEGA, PHI, KAPPA in the project (grid east, grid north, up), radians; NaN throughout where no attitude was
        observed.
    angle_error : tuple of 3 float
        Standard deviations, radians: 0 constant, negative only compared; NaN as the angles.
    covariance : tuple of 3 tuples of 3 float, or of 6 of 6, or None
        Of the position, or of position and angles; ground units and radians, positive definite, its diagonal the
        squares of the errors. None: all errors are independent.
    time : float
        Of the exposure, seconds; NaN where it is not known.
    strip : str
        Empty where it is not known.
    motion : StationMotion or None
        None: nothing is known of it.
    line : int
        Line of the file.
    """

    photo: str
    position: tuple[float, float, float]
    position_error: tuple[float, float, float]
    angles: tuple[float, float, float] = NOT_GIVEN
    angle_error: tuple[float, float, float] = NOT_GIVEN
    covariance: tuple[tuple[float, ...], ...] | None = None
    time: float = math.nan
    strip: str = ""
    motion: StationMotion | None = None
    line: int = 0

    @property
    def has_joint_covariance(self) -> bool:
        """Return whether position and angles are correlated."""
        return self.covariance is not None and len(self.covariance) > len(self.position)

    @property
    def has_position(self) -> bool:
        """Return whether a position was observed."""
        return not math.isnan(self.position[0])

    @property
    def has_angles(self) -> bool:
        """Return whether an attitude was observed."""
        return not math.isnan(self.angles[0])


class StationDifference(Struct, frozen=True):
    """What the station of a photo has more than that of another one: one line of a .REL file.

    Parameters
    ----------
    first, second : str
        Photos; case does not count.
    position : tuple of 3 float
        Position of the second station less that of the first, along the axes of the project, ground unit; NaN
        throughout where none was observed.
    position_error : tuple of 3 float
        Standard deviations: negative only compared; NaN as the position.
    angles : tuple of 3 float
        OMEGA, PHI and KAPPA, radians, of the attitude of the second along the axes of the first: A1^T A2; NaN
        throughout where none was observed.
    angle_error : tuple of 3 float
        Standard deviations of small rotations about the axes of the first, radians; signs and NaN as above.
    covariance : tuple of 6 tuples of 6 float, or None
        Of the position and of these rotations; its diagonal the squares of the errors. None: they are independent.
    line : int
        Line of the file.
    """

    first: str
    second: str
    position: tuple[float, float, float]
    position_error: tuple[float, float, float]
    angles: tuple[float, float, float] = NOT_GIVEN
    angle_error: tuple[float, float, float] = NOT_GIVEN
    covariance: tuple[tuple[float, ...], ...] | None = None
    line: int = 0

    @property
    def name(self) -> str:
        """Return what it is called."""
        return f"{self.first}-{self.second}"

    @property
    def errors(self) -> tuple[float, ...]:
        """Return the errors of all six components."""
        return (*self.position_error, *self.angle_error)


class ErrorLimits(Struct, frozen=True):
    """The least and the largest size of an a-priori error, in a unit.

    An error of 0 (constant, where that is possible) and the sign (negative: disregarded) are not judged.
    """

    least: float
    largest: float
    unit: str

    def fault(self, error: float) -> str | None:
        """Return what is wrong with an a-priori error; None for one that is possible, or no number."""
        size = abs(error)
        if 0.0 < size < self.least:
            return (
                f"an a-priori error of {error:g} is smaller than any that makes sense; "
                f"write one from {self.least:g} to {self.largest:g} {self.unit}, or 0 for what is exactly known"
            )
        if size > self.largest:
            return (
                f"an a-priori error of {error:g} is larger than any that makes sense; "
                f"write one from {self.least:g} to {self.largest:g} {self.unit}, or a negative one to disregard"
            )
        return None


GROUND_ERRORS = ErrorLimits(1e-7, 1e6, "ground units")
ANGLE_ERRORS = ErrorLimits(1e-8, 360.0, "degrees")
PHOTO_ERRORS = ErrorLimits(1e-6, 1e3, "mm")
SPEED_ERRORS = ErrorLimits(1e-6, 1e4, "ground units a second")
RATE_ERRORS = ErrorLimits(1e-6, 1e4, "degrees a second")
TIME_ERRORS = ErrorLimits(1e-9, 10.0, "seconds")
PIXEL_ERRORS = ErrorLimits(1e-4, 1e5, "px")
COEFFICIENT_ERRORS = ErrorLimits(1e-30, 1e3, "of the coefficient's unit")


PointKind = Literal["control", "check", "rejected", "tie"]
DistanceCode = Literal["X", "Y", "Z", "XY", "YZ", "ZX", "XYZ"]
ElementGroup = Literal["CAMERA", "PHOTO", "POINT", "THEODOLITE"]
FigureKind = Literal["LINE", "PLANE", "CYLINDER", "HEIGHT"]


class ControlPoint(Struct, frozen=True):
    """One line of a .PNT file.

    Parameters
    ----------
    coordinates : tuple of 3 (float or None)
        X, Y, Z in ground units; None where the file has '-'.
    errors : tuple of 3 (float or None)
        A-priori errors, ground units: 0 constant, negative disregarded; None where the coordinate is not known.
    rejected : bool
        Neither control nor check.
    line : int
        Line of the file.
    correlations : tuple of 3 float, or None
        Coefficients rXY, rXZ and rYZ; None: the errors of X, Y and Z are independent.
    """

    name: str
    coordinates: tuple[float | None, float | None, float | None]
    errors: tuple[float | None, float | None, float | None]
    rejected: bool = False
    line: int = 0
    correlations: tuple[float, float, float] | None = None

    @property
    def kind(self) -> PointKind:
        """Return what the point is good for: a check point is one whose a-priori errors are all negative."""
        if self.rejected:
            return "rejected"
        known = [error for error in self.errors if error is not None]
        return "check" if all(error < 0 for error in known) else "control"


class PointCorrelation(Struct, frozen=True):
    """How the errors of two control points are correlated.

    Parameters
    ----------
    first, second : str
        Names of control points, each pair once.
    coefficients : tuple of 3 tuples of 3 float
        Of X, Y, Z of the first (rows) with X, Y, Z of the second.
    """

    first: str
    second: str
    coefficients: tuple[tuple[float, float, float], ...]


class ControlElement(Struct, frozen=True):
    """One line of a .ELE file: an observed value of an unknown; angles in degrees, as in the file."""

    name: str
    group: ElementGroup
    kind: str
    value: float
    error: float
    line: int = 0


class ControlDistance(Struct, frozen=True):
    """One line of a .LEN file; X, Y and Z are signed (end minus start); ground units."""

    name: str
    start: str
    end: str
    code: DistanceCode
    distance: float
    error: float
    line: int = 0


class ControlDirection(Struct, frozen=True):
    """One line of a .DIR file: a theodolite direction and perhaps a zenith angle, degrees."""

    set: str
    station: str
    target: str
    direction: float
    direction_error: float
    zenith: float | None = None
    zenith_error: float | None = None
    line: int = 0


class FigurePoint(Struct, frozen=True):
    """One line of a .CON file: a point that lies on a figure.

    The a-priori error, ground units, is that of its distance from the line, the plane or the surface of the cylinder,
    or of its height from the common one: negative disregarded, never 0.
    """

    figure: str
    kind: FigureKind
    point: str
    error: float
    line: int = 0


class GivenDirection(Struct, frozen=True):
    """A DIRECTION in a .CON file: that from one point to another, along the project's axes, of any length above 0.

    The a-priori error is an angle, degrees: negative disregarded, never 0.
    """

    name: str
    start: str
    end: str
    direction: tuple[float, float, float]
    error: float
    line: int = 0


class Control(Struct, frozen=True):
    """All ground control of a project."""

    points: tuple[ControlPoint, ...] = ()
    elements: tuple[ControlElement, ...] = ()
    distances: tuple[ControlDistance, ...] = ()
    directions: tuple[ControlDirection, ...] = ()
    stations: tuple[Station, ...] = ()
    station_reference: StationReference = IN_PROJECT
    differences: tuple[StationDifference, ...] = ()
    correlations: tuple[PointCorrelation, ...] = ()
    figure_points: tuple[FigurePoint, ...] = ()
    given_directions: tuple[GivenDirection, ...] = ()


class PreliminaryPoint(Struct, frozen=True):
    """One line of a .PRE file: preliminary coordinates and, if computed, their standard deviations."""

    name: str
    coordinates: tuple[float, float, float]
    deviations: tuple[float, float, float] | None = None
    line: int = 0
