"""Dates of GPS time."""

from __future__ import annotations

from datetime import datetime, timedelta

from orip.records.epochs import GPS_START


def moment(time: float) -> str:
    """Return a time (seconds since 1980-01-06, GPS time) as ``2005-04-02 00:00:30``."""
    return str(GPS_START + timedelta(seconds=round(time)))[:19]


def seconds_of_date(parts: list[float]) -> float | None:
    """Return seconds since 1980-01-06 of year, month, day, hour, minute and second; None of what is no date."""
    year = int(parts[0])
    year += (1900 if year >= 80 else 2000) if year < 100 else 0
    month, day, hour, minute = (int(part) for part in parts[1:5])
    try:
        begin = datetime(year, month, day, hour, minute)
    except ValueError:
        return None
    return (begin - GPS_START).total_seconds() + parts[5] if parts[5] < 61.0 else None
