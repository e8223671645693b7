"""Logs of inertial units known by their content: units and times are theirs, axes those of the unit.

- NovAtel, RAWIMUX and RAWIMUSX in ASCII (OEM7 Commands and Logs Reference Manual; scale factors also in NovAtel's own
  driver, oem7_imu.cpp).
- Inertial Explorer, the generic raw format .imr (Waypoint Software 8.90 User Manual).
- ArduPilot, DataFlash in binary and as text (libraries/AP_Logger; AP_InertialSensor/LogStructure.h).
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Mapping

import numpy as np

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.records.epochs import SECONDS_PER_WEEK

Reader = Callable[[bytes, str], FloatArray | Complaint]


def logger_of(data: bytes) -> tuple[str, Reader] | None:
    """Return whose log it is, and what reads it to time (s), forces (m/s²), rates (rad/s), (n, 7); None: a table."""
    begin = data[:4096]
    if data.startswith(b"$IMURAW"):
        return "Inertial Explorer", read_imr
    if begin.startswith(_HEAD) or begin.lstrip().startswith(b"FMT,"):
        return "ArduPilot", read_dataflash
    if re.search(rb"(?m)^[%#](RAWIMU|BESTPOS|INS|RANGE|TIME)\w*A,", begin):
        return "NovAtel", read_novatel
    return None


# NovAtel: header;info,type,week,seconds,status,z,-y,x force,z,-y,x rate*check sum

_RAW_IMU = re.compile(rb"[%#](RAWIMUS?XA,[^;*\r\n]*;([^*\r\n]*))\*([0-9a-fA-F]{8})")
_FOOT, _DEGREE = 0.3048, np.pi / 180.0
_MILLI_G = 9.80665e-3
_ENCRYPTED = 2

_INCREMENTS: Mapping[int, tuple[float, float]] = {
    8: (2.0**-14, 2.0**-19),  # LN200
    **dict.fromkeys((1, 5, 11, 20, 27, 28), (_FOOT * 2.0**-27, 2.0**-33)),  # HG1700 AG11 and AG58, HG1900, HG1930
    **dict.fromkeys((4, 12), (_FOOT * 2.0**-26, 2.0**-33)),  # HG1700 AG17, AG62
    13: (0.05 * 2.0**-15, _DEGREE / 3600.0 * 0.1 * 2.0**-8),  # iMAR FSAS
    **dict.fromkeys((26, 52), (2e-8, 1e-9)),  # ISA-100C, Litef µIMU
    31: (200.0 * 2.0**-31, _DEGREE * 720.0 * 2.0**-31),  # ADIS16488
    **dict.fromkeys((32, 56), (2.0**-22, _DEGREE * 2.0**-21)),  # STIM300
    **dict.fromkeys((58, 68, 69), (2.0**-29, 2.0**-33)),  # HG4930
}
"""By the type of the unit: m/s and radians of an increment of 1."""

_RATES: Mapping[int, tuple[float, float]] = {
    **dict.fromkeys((41, 62), (_MILLI_G * 0.2 * 2.0**-16, _DEGREE * 0.008 * 2.0**-16)),  # Epson G320
    61: (_MILLI_G * 0.4 * 2.0**-16, _DEGREE * 0.0151515 * 2.0**-16),  # Epson G370
}
"""m/s² and rad/s of 1."""


def read_novatel(data: bytes, shown: str) -> FloatArray | Complaint:
    """Read messages RAWIMUXA and RAWIMUSXA; damaged ones are passed over."""
    rows, kinds = [], set[int]()
    for text, body, check in _RAW_IMU.findall(data):
        fields = body.split(b",")
        # CRC-32 that begins with 0 and is not complemented
        if len(fields) != 11 or zlib.crc32(text, 0xFFFFFFFF) ^ 0xFFFFFFFF != int(check, 16):
            continue
        if int(fields[0], 16) & _ENCRYPTED:
            return Complaint("the samples of this unit are encrypted; NovAtel's software alone can use them", shown)
        kinds.add(int(fields[1]))
        week, seconds, *counts = (float(fields[at]) for at in (2, 3, 7, 6, 5, 10, 9, 8))
        rows.append((week * SECONDS_PER_WEEK, seconds, *counts))
    if not rows:
        return Complaint("there are no samples (RAWIMUXA, RAWIMUSXA) in this log of NovAtel; log them ONNEW", shown)
    (kind, *others) = sorted(kinds)
    scales = _INCREMENTS.get(kind) or _RATES.get(kind)
    if others or scales is None:
        known = ", ".join(map(str, sorted({*_INCREMENTS, *_RATES})))
        found = ", ".join(map(str, sorted(kinds)))
        return Complaint(f"the type of the unit is {found}; scales are known of one of {known}", shown)
    table = np.array(rows)
    values = table[:, 2:] * [1.0, -1.0, 1.0, 1.0, -1.0, 1.0] * np.repeat(scales, 3)
    time, late = table[:, 0] + table[:, 1], 0.0
    if kind in _INCREMENTS:  # over the interval that ends at their time
        interval = float(np.median(np.diff(table[:, 1]))) if len(table) > 1 else 1.0
        values, late = values / interval, interval / 2.0
    return np.column_stack([time - late, values])


# Inertial Explorer: a header of 512 bytes, then records

_IMR_HEADER = 512
_UTC_OF_IMR, _UTC_BEHIND = 1, 18.0


def read_imr(data: bytes, shown: str) -> FloatArray | Complaint:
    """Read a generic raw file; times are seconds of the GPS week."""
    order = ">" if data[8:9] == b"\x01" else "<"
    header = np.dtype([
        ("name", "S8"), ("big", "i1"), ("version", f"{order}f8"), ("angles", f"{order}i4"), ("speeds", f"{order}i4"),
        ("rate", f"{order}f8"), ("gyro", f"{order}f8"), ("force", f"{order}f8"), ("utc", f"{order}i4"),
    ])  # fmt: skip
    record = np.dtype([("time", f"{order}f8"), ("gyro", f"{order}i4", 3), ("force", f"{order}i4", 3)])
    if len(data) < _IMR_HEADER or (len(data) - _IMR_HEADER) % record.itemsize:
        return Complaint("the file is cut off: .imr has a header of 512 bytes and records of 32", shown)
    head = np.frombuffer(data, header, 1)[0]
    rows = np.frombuffer(data, record, offset=_IMR_HEADER)
    scale = (float(head["gyro"]) * _DEGREE, float(head["force"]), float(head["rate"]))
    if not all(np.isfinite(scale)) or min(scale) <= 0.0:
        return Complaint("the header has no scales of gyroscopes and accelerometers, or no rate", shown)
    force, gyro = rows["force"] * scale[1], rows["gyro"] * scale[0]
    force, gyro = force * (scale[2] if head["speeds"] else 1.0), gyro * (scale[2] if head["angles"] else 1.0)
    time = rows["time"] + (_UTC_BEHIND if head["utc"] == _UTC_OF_IMR else 0.0)
    middle = 0.5 / scale[2] if head["speeds"] and head["angles"] else 0.0
    return np.column_stack([time - middle, force, gyro])


# ArduPilot: messages that other messages (FMT) describe; TimeUS are microseconds since the autopilot was started

_HEAD, _FMT = b"\xa3\x95\x80", 128
_TYPES: Mapping[str, str] = {
    "a": "(32,)<i2", "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4", "d": "<f8",
    "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "M": "u1",
    "q": "<i8", "Q": "<u8", "g": "<f2",
}  # fmt: skip
_WANTED = ("IMU", "GPS")
_SAMPLE = ("TimeUS", "AccX", "AccY", "AccZ", "GyrX", "GyrY", "GyrZ")
_PLACE = ("TimeUS", "GWk", "GMS")
_LEAST_STATUS = 3
"""Of GPS: a position in space."""

_PART = 60.0
"""Seconds in which the message of the receiver that was least late is looked for."""


def read_dataflash(data: bytes, shown: str) -> FloatArray | Complaint:
    """Read the first unit's samples (IMU), in GPS time by the messages of the receiver (GPS), which are late."""
    found = _binary_messages(data) if data.startswith(_HEAD) else _text_messages(data)
    imu, gps = found["IMU"], found["GPS"]
    if not len(imu.get("AccX", ())) or not set(_SAMPLE) <= imu.keys():
        return Complaint("there are no samples (IMU) in this log of ArduPilot; set LOG_BITMASK to log them", shown)
    first = imu["I"] == 0 if "I" in imu else np.ones(len(imu["TimeUS"]), dtype=bool)
    table = np.column_stack([imu[name][first] for name in _SAMPLE])
    known = np.zeros(0, dtype=bool)
    if {*_PLACE, "Status"} <= gps.keys():
        known = (gps["Status"] >= _LEAST_STATUS) & (gps["GWk"] > 0)
    if not known.any():
        text = "the log has no time of a receiver (GPS, Status 3): when samples were taken is not known"
        return Complaint(text, shown)
    started, week, milliseconds = (gps[name][known] for name in _PLACE)
    table[:, 0] = _gps_time(table[:, 0] * 1e-6, started * 1e-6, week * SECONDS_PER_WEEK + milliseconds * 1e-3)
    return table


def _gps_time(time: FloatArray, started: FloatArray, gps: FloatArray) -> FloatArray:
    """Return times of the autopilot as GPS time: by a line through the least late messages, one a minute."""
    late = started - gps
    part = ((started - started[0]) // _PART).astype(int)
    best = [rows[np.argmin(late[rows])] for rows in (np.flatnonzero(part == one) for one in np.unique(part))]
    origin = started[best].mean()
    degree = 1 if len(best) > 2 else 0
    line = np.polyfit(started[best] - origin, late[best] - late[best[0]], degree)
    return np.asarray(time - late[best[0]] - np.polyval(line, time - origin))


Messages = dict[str, dict[str, FloatArray]]


def _binary_messages(data: bytes) -> Messages:
    lengths, dtypes = {_FMT: 89}, dict[int, tuple[str, np.dtype[np.void]]]()
    at, rows = 0, dict[int, list[bytes]]()
    while 0 <= at < len(data) - 3:
        kind = data[at + 2]
        length = lengths.get(kind, 0)
        if data[at : at + 2] != _HEAD[:2] or not length:
            at = data.find(_HEAD[:2], at + 1)
            continue
        body = data[at + 3 : at + length]
        if kind == _FMT and len(body) == 86:
            name, form, labels = (part.rstrip(b"\0").decode("ascii", "replace") for part in
                                  (body[2:6], body[6:22], body[22:86]))  # fmt: skip
            lengths[body[0]] = body[1]
            names = labels.split(",")
            if name in _WANTED and len(names) == len(set(names)) == len(form) and set(form) <= _TYPES.keys():
                fields = [(label, _TYPES[letter]) for label, letter in zip(names, form, strict=True)]
                dtypes[body[0]] = (name, np.dtype(fields))
        elif kind in dtypes and len(body) == dtypes[kind][1].itemsize:
            rows.setdefault(kind, []).append(body)
        at += length
    found: Messages = {name: {} for name in _WANTED}
    for kind, (name, dtype) in dtypes.items():
        whole = np.frombuffer(b"".join(rows.get(kind, [])), dtype)
        numbers = [label for label in dtype.names or () if dtype[label].kind in "iuf"]
        found[name] = {label: whole[label].astype(float) for label in numbers}
    return found


def _text_messages(data: bytes) -> Messages:
    names: dict[str, list[str]] = {name: [] for name in _WANTED}
    rows: dict[str, list[list[float]]] = {name: [] for name in _WANTED}
    for line in data.decode("utf-8", "replace").splitlines():
        words = [word.strip() for word in line.split(",")]
        if words[0] == "FMT" and len(words) > 5 and words[3] in names:
            names[words[3]] = words[5:]
        elif words[0] in names and len(words) == len(names[words[0]]) + 1:
            try:
                rows[words[0]].append([float(word) for word in words[1:]])
            except ValueError:
                continue
    return {
        name: dict(zip(names[name], np.array(found).reshape(len(found), len(names[name])).T, strict=True))
        for name, found in rows.items()
    }
