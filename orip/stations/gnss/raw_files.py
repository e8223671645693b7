"""Logs of receivers that are no RINEX (UBX, RTCM 3), taken to RINEX by RTKLIB's converter; dates of GPS time."""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
import tempfile
from datetime import datetime, timedelta
from pathlib import Path
from typing import Literal

import numpy as np

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.files.text.shown import shown_token
from orip.records.epochs import GPS_START, leap_seconds, seconds_of_week_time


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


Log = Literal["ubx", "rtcm3"]

_NAMES: dict[Log, str] = {"ubx": "u-blox (UBX)", "rtcm3": "RTCM 3"}
_UBX, _RTCM = b"\xb5\x62", 0xD3
LOOKED_AT = 65_536
"""Bytes in which the first whole message has to be."""

_TIME_LIMIT_S = 1800.0


def log_of(data: bytes) -> Log | None:
    """Return what kind of log it is by its first messages whose check sums are right; None: none of these."""
    begin = data[:LOOKED_AT]
    at = begin.find(_UBX)
    while at >= 0:
        if _is_ubx(begin, at):
            return "ubx"
        at = begin.find(_UBX, at + 1)
    at = begin.find(_RTCM)
    while at >= 0:
        if _is_rtcm(begin, at):
            return "rtcm3"
        at = begin.find(_RTCM, at + 1)
    return None


def _is_ubx(data: bytes, at: int) -> bool:
    """Return whether a message with Fletcher's check sum is there."""
    length = int.from_bytes(data[at + 4 : at + 6], "little")
    body, given = data[at + 2 : at + 6 + length], data[at + 6 + length : at + 8 + length]
    first = second = 0
    for byte in body:
        first = (first + byte) & 255
        second = (second + first) & 255
    return len(given) == 2 and given == bytes([first, second])


def _is_rtcm(data: bytes, at: int) -> bool:
    """Return whether a message with the check sum CRC-24Q is there."""
    length = int.from_bytes(data[at + 1 : at + 3], "big")
    frame, given = data[at : at + 3 + length], data[at + 3 + length : at + 6 + length]
    if length > 1023 or length < 2 or len(given) != 3:
        return False
    crc = 0
    for byte in frame:
        crc ^= byte << 16
        for _ in range(8):
            crc = (crc << 1) ^ (0x1864CFB if crc & 0x800000 else 0)
    return crc & 0xFFFFFF == int.from_bytes(given, "big")


_TIME_MARK = re.compile(re.escape(b"\xb5\x62\x0d\x03\x1c\x00"))
"""Begins a message UBX-TIM-TM2: two edges of a pulse at the event input (interface description, UBX-22008968)."""

_RISING, _FALLING, _KNOWN, _IN_UTC = 0x80, 0x04, 0x40, 2


def time_marks(data: bytes) -> FloatArray:
    """Return the beginnings of the pulses at a u-blox receiver's event input, seconds since 1980-01-06, array (n,).

    The edge that begins a pulse is the one after which the other edge comes sooner, in the median.
    """
    edges: dict[int, list[float]] = {_RISING: [], _FALLING: []}
    for found in _TIME_MARK.finditer(data):
        if not _is_ubx(data, found.start()):
            continue
        flags, rising_week, falling_week, *times = struct.unpack_from("<xBxxHHIIII", data, found.end())
        if not flags & _KNOWN:
            continue
        for edge, week, (milliseconds, nanoseconds) in (
            (_RISING, rising_week, times[:2]), (_FALLING, falling_week, times[2:]),
        ):  # fmt: skip
            time = seconds_of_week_time(week, milliseconds / 1e3 + nanoseconds / 1e9)
            if flags & edge and np.isfinite(time):
                edges[edge].append(_gps_time(time) if flags >> 3 & 3 == _IN_UTC else time)
    rising, falling = (np.unique(times) for times in edges.values())
    if len(rising) and len(falling):
        return falling if _until_next(falling, rising) < _until_next(rising, falling) else rising
    return rising if len(rising) else falling


def _gps_time(utc: float) -> float:
    return utc + leap_seconds(GPS_START + timedelta(seconds=utc))


def _until_next(times: FloatArray, others: FloatArray) -> float:
    """Return the median of the times until the next of the others; infinite where there is none."""
    place = np.searchsorted(others, times)
    followed = place < len(others)
    waits = others[place[followed]] - times[followed]
    return float(np.median(waits)) if len(waits) else np.inf


def rinex_of_log(data: bytes, log: Log, kind: str, near: float | None, shown: str) -> bytes | Complaint:
    """Return observations (kind O) or orbits (N) of a log as RINEX 3.

    Parameters
    ----------
    log : {"ubx", "rtcm3"}
    kind : {"O", "N"}
    near : float or None
        A time within half a week, seconds since 1980-01-06: RTCM 3 has seconds of the week alone.
    shown : str
        As messages name the file.
    """
    program = shutil.which("convbin")
    name = _NAMES[log]
    if program is None:
        text = (
            f"this is a log in the form of {name}, which RTKLIB's converter takes to RINEX: put convbin on PATH "
            "(packages of RTKLIB have it), or give RINEX"
        )
        return Complaint(text, shown)
    if log == "rtcm3" and near is None:
        return Complaint(
            "RTCM 3 does not say the week; give orbits or the other receiver's observations as RINEX", shown
        )
    with tempfile.TemporaryDirectory(prefix="orip-convbin-") as folder:
        source, found = Path(folder, f"log.{log}"), {"O": Path(folder, "log.obs"), "N": Path(folder, "log.nav")}
        source.write_bytes(data)
        when = [] if near is None else ["-tr", *moment(near).replace("-", "/").split(" ")]
        words = [program, "-r", log, *when, "-v", "3.04", "-o", str(found["O"]), "-n", str(found["N"]), str(source)]
        try:
            done = subprocess.run(words, capture_output=True, check=False, timeout=_TIME_LIMIT_S)
        except subprocess.TimeoutExpired:
            return Complaint(f"convbin has not ended after {_TIME_LIMIT_S / 60:.0f} minutes; give RINEX", shown)
        if found[kind].is_file() and found[kind].stat().st_size:
            return found[kind].read_bytes()
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["nothing"]
        what = "observations (RXM-RAWX, 1002, 1004, MSM)" if kind == "O" else "orbits (RXM-SFRBX, 1019 and others)"
        return Complaint(f"convbin finds no {what} in this log of {name}; it said: {shown_token(last[0])}", shown)
