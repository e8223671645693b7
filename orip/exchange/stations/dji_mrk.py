"""Image logs of DJI drones (``_Timestamp.MRK``): time, position and offset of the camera for each photo.

A line is: number of the photo, seconds of the GPS week, [week], offset from the antenna to the camera ``…,N`` ``…,E``
``…,V`` (mm, V downwards), position of the camera ``…,Lat`` ``…,Lon`` ``…,Ellh``, standard deviations north, east, up
(m), and the kind of position ``50,Q`` (50 fixed, 34 float, 16 code). The position has the offset in it already
(user manual of the Matrice 4 series, 2025, p. 92); the offset serves positions of the antenna that were computed
afterwards.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.exchange.stations.gps_time import seconds_of_week_time
from orip.exchange.stations.rows import LARGEST_PLACE, Row, RowReader, text_rows
from orip.files.text.shown import Parsed, shown_token
from orip.records.observations.epochs import Epochs, Quality, epochs
from orip.units import RADIANS_PER_DEGREE

_TAGS = ("N", "E", "V", "LAT", "LON", "ELLH")
_FORM = "number seconds [week] mm,N mm,E mm,V degrees,Lat degrees,Lon metres,Ellh sN, sE, sU code,Q"
_FIXED, _FLOAT = 50, range(32, 50)


def read_dji_mrk(path: Path, shown: str) -> Parsed[Epochs]:
    """Read an image log: the events at which photos were taken, with their numbers and positions."""
    reader = RowReader(shown)
    rows: list[tuple[float, ...]] = []
    for row in text_rows(path, reader, r"\s,"):
        if reader.is_full:
            break
        found = _read_row(reader, row)
        if found is not None:
            rows.append(found)
    return Parsed(_epochs(shown, np.array(rows, dtype=np.float64).reshape(len(rows), 13)), tuple(reader.complaints))


def _read_row(reader: RowReader, row: Row) -> tuple[float, ...] | None:
    """Return line, number, time, E, N, up, longitude, latitude, height, sE, sN, sU, flag."""
    before = len(reader.complaints)
    tags = {field.upper(): index for index, field in reversed(list(enumerate(row.fields)))}
    missing = [tag for tag in (*_TAGS, "Q") if tag not in tags]
    if missing or len(row.fields) < 4:
        reader.complain(f"{', '.join(missing) or 'fields'} missing; a line of an image log (.MRK) is: {_FORM}", row)
        return None
    number = reader.number(row, 0, 0.0, 1e9)
    week = re.fullmatch(r"\[(\d{1,5})\]", row.fields[2])
    seconds = reader.number(row, 1)
    time = seconds_of_week_time(float(week[1]), seconds) if week else math.nan
    if math.isnan(time) and not math.isnan(seconds):
        reader.complain(
            f"'{shown_token(row.fields[1])} {shown_token(row.fields[2])}' is not a time; write seconds and [GPS week]",
            row, 1,
        )  # fmt: skip
    north, east, down = (reader.number(row, tags[tag] - 1, -1e5, 1e5) / 1000.0 for tag in "NEV")
    latitude = reader.number(row, tags["LAT"] - 1, -90.0, 90.0) * RADIANS_PER_DEGREE
    longitude = reader.number(row, tags["LON"] - 1, -360.0, 360.0) * RADIANS_PER_DEGREE
    height = reader.number(row, tags["ELLH"] - 1, -LARGEST_PLACE, LARGEST_PLACE)
    start, end = tags["ELLH"] + 1, tags["Q"] - 1
    errors = reader.numbers(row, range(start, end)) if end - start == 3 else [math.nan] * 3
    flag = reader.number(row, end)
    if len(reader.complaints) > before:
        return None
    deviations = (errors[1], errors[0], errors[2])
    return (row.number, number, time, east, north, -down, longitude, latitude, height, *deviations, flag)


def _epochs(shown: str, rows: FloatArray) -> Epochs:
    flags = rows[:, 12].tolist()
    covariance = np.zeros((len(rows), 3, 3))
    covariance[:, range(3), range(3)] = rows[:, 9:12] ** 2
    return epochs(
        shown,
        rows[:, 0].astype(np.int64),
        number=rows[:, 1].astype(np.int64),
        time=rows[:, 2],
        to_camera=rows[:, 3:6],
        place=rows[:, 6:9],
        covariance=covariance,
        quality=tuple(_quality(flag) for flag in flags),
    )


def _quality(flag: float) -> Quality:
    return "fixed" if flag == _FIXED else "float" if int(flag) in _FLOAT else "code"
