"""Exposure stations: where a photo was taken, observed by GNSS, and how it was turned, observed by INS."""

from __future__ import annotations

import math

from msgspec import Struct

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
