"""Exposure stations observed by GNSS and INS, and the epochs of the solution that they are taken from."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray

NOT_GIVEN = (math.nan, math.nan, math.nan)
"""Position or angles of a station that has none; their errors are these too."""


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
    covariance : tuple of 3 tuples of 3 float, or None
        Of the position, ground unit squared; positive definite, its diagonal the squares of `position_error`. None:
        the errors of X, Y and Z are independent.
    time : float
        Of the exposure, seconds; NaN where it is not known.
    strip : str
        Empty where it is not known.
    line : int
        Line of the file.
    """

    photo: str
    position: tuple[float, float, float]
    position_error: tuple[float, float, float]
    angles: tuple[float, float, float] = NOT_GIVEN
    angle_error: tuple[float, float, float] = NOT_GIVEN
    covariance: tuple[tuple[float, float, float], ...] | None = None
    time: float = math.nan
    strip: str = ""
    line: int = 0

    @property
    def has_position(self) -> bool:
        """Return whether a position was observed."""
        return not math.isnan(self.position[0])

    @property
    def has_angles(self) -> bool:
        """Return whether an attitude was observed."""
        return not math.isnan(self.angles[0])


Quality: TypeAlias = Literal["fixed", "float", "code", ""]
"""Of a position: ambiguities fixed; float; from code measurements alone; not said."""

Mount: TypeAlias = Literal["body", "gimbal", "photo"]
"""What three angles turn: the vehicle (roll, pitch, heading; the top of the picture is forward, the camera looks down),
the camera itself (roll, pitch, heading; it looks forward at pitch 0), the photo (omega, phi, kappa)."""

SECONDS_PER_WEEK = 604_800.0


class Epochs(Struct, frozen=True):
    """n epochs in the order of the file.

    Parameters
    ----------
    shown : str
        The file as messages name it.
    line : array (n,) of int
        Line, or number of the record in a binary file, from 1.
    photo : tuple of n str
        Photos that the file names; empty: it does not.
    number : array (n,) of int
        Of the photo that the file counts; 0: it does not.
    time : array (n,)
        Seconds since 1980-01-06 00:00 GPS time, or of the GPS week if `has_week` is False; NaN where it is not known.
    has_week : bool
    place : array (n, 3)
        Longitude, latitude (radians) and height above the ellipsoid (m) if `is_geographic`, else X, Y, Z; NaN where
        none was given.
    is_geographic : bool
    covariance : array (n, 3, 3)
        Of the place along east, north and up, or X, Y, Z; m² or ground units squared; NaN where none was given.
    quality : tuple of n Quality
    velocity : array (n, 3)
        East, north, up, m/s; NaN where it was not given.
    angles : array (n, 3)
        Roll, pitch and heading, or omega, phi and kappa, radians; NaN where they were not given.
    angle_error : array (n, 3)
        Standard deviations, radians; NaN where they were not given.
    mount : Mount
        What the angles turn.
    to_camera : array (n, 3)
        From the antenna to the camera, east, north, up, m; zero where that is not known.
    strip : tuple of n str
        Empty: the file names none.
    """

    shown: str
    line: IntArray
    photo: tuple[str, ...]
    number: IntArray
    time: FloatArray
    has_week: bool
    place: FloatArray
    is_geographic: bool
    covariance: FloatArray
    quality: tuple[Quality, ...]
    velocity: FloatArray
    angles: FloatArray
    angle_error: FloatArray
    mount: Mount
    to_camera: FloatArray
    strip: tuple[str, ...]

    def __len__(self) -> int:
        """Return the number of epochs."""
        return len(self.line)


def epochs(shown: str, line: IntArray, **known: object) -> Epochs:
    """Return epochs of which some properties are known; see `Epochs`."""
    count = len(line)
    unknown = np.full((count, 3), np.nan)
    values: dict[str, object] = {
        "photo": ("",) * count,
        "number": np.zeros(count, dtype=np.int64),
        "time": np.full(count, np.nan),
        "has_week": True,
        "place": unknown,
        "is_geographic": True,
        "covariance": np.full((count, 3, 3), np.nan),
        "quality": ("",) * count,
        "velocity": unknown,
        "angles": unknown,
        "angle_error": unknown,
        "mount": "body",
        "to_camera": np.zeros((count, 3)),
        "strip": ("",) * count,
    }
    return Epochs(shown=shown, line=line, **{**values, **known})  # type: ignore[arg-type]
