"""Epochs of a GNSS or INS solution and their time: a trajectory, or the events at which photos were taken."""

from __future__ import annotations

import math
from datetime import datetime, timedelta
from typing import Literal, TypeAlias

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray

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
    place : array (n, 3)
        Longitude, latitude (radians) and height above the ellipsoid (m) if `is_geographic`, else X, Y, Z; NaN where
        none was given.
    covariance : array (n, 3, 3)
        Of the place along east, north and up, or X, Y, Z; m² or ground units squared; NaN where none was given.
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


GPS_START = datetime(1980, 1, 6)
"""Beginning of GPS time."""

_LEAP_DATES = (
    (1981, 7), (1982, 7), (1983, 7), (1985, 7), (1988, 1), (1990, 1), (1991, 1), (1992, 7), (1993, 7), (1994, 7),
    (1996, 1), (1997, 7), (1999, 1), (2006, 1), (2009, 1), (2012, 7), (2015, 7), (2017, 1),
)  # fmt: skip
"""Year and month at whose beginning UTC fell behind by one more second (IERS Bulletin C; none since 2017)."""

_JST = timedelta(hours=9)


def seconds_of_week_time(week: float, seconds: float) -> float:
    """Return the seconds of a GPS week and its seconds; NaN where they are none."""
    if not (0 <= week < 10_000 and week == int(week) and 0.0 <= seconds <= SECONDS_PER_WEEK):
        return math.nan
    return week * SECONDS_PER_WEEK + seconds


def seconds_of_date(date: str, clock: str, system: str = "GPST") -> float:
    """Return the seconds of ``yyyy/mm/dd`` (or with - or :) and ``hh:mm:ss.sss`` in GPST, UTC or JST.

    Raises
    ------
    ValueError
        If they are no date and time after 1980-01-06.
    """
    year, month, day = (int(part) for part in date.replace("-", "/").replace(":", "/").split("/"))
    hour, minute, second = clock.split(":")
    moment = datetime(year, month, day, int(hour), int(minute)) - (_JST if system == "JST" else timedelta())
    seconds = (moment - GPS_START).total_seconds() + float(second)
    if not (seconds >= 0.0 and 0.0 <= float(second) < 61.0):
        message = "no time of the GPS era"
        raise ValueError(message)
    return seconds if system == "GPST" else seconds + leap_seconds(moment)


def leap_seconds(utc: datetime) -> int:
    """Return by how many seconds GPS time is ahead of UTC."""
    return sum((utc.year, utc.month) >= date for date in _LEAP_DATES)
