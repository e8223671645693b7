"""Dates and weeks to seconds of GPS time since 1980-01-06."""

from __future__ import annotations

import math
from datetime import datetime, timedelta

from orip.records.observations.epochs import SECONDS_PER_WEEK

_START = datetime(1980, 1, 6)

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
    seconds = (moment - _START).total_seconds() + float(second)
    if not (seconds >= 0.0 and 0.0 <= float(second) < 61.0):
        message = "no time of the GPS era"
        raise ValueError(message)
    return seconds if system == "GPST" else seconds + leap_seconds(moment)


def leap_seconds(utc: datetime) -> int:
    """Return by how many seconds GPS time is ahead of UTC."""
    return sum((utc.year, utc.month) >= date for date in _LEAP_DATES)
