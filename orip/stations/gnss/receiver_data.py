"""Observation and navigation files of receivers (RINEX 2 to 4): what is in them, before anything is computed of them.

The forms are those of RINEX 2.11, 3.05 and 4.01 (IGS/RTCM); a compressed file is unpacked first.
"""

from __future__ import annotations

import gzip
import re
import zlib
from datetime import timedelta
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.files.text.lines import read_bytes
from orip.files.text.regular_file import LARGEST_FILE
from orip.files.text.shown import shown_token
from orip.records.epochs import GPS_START, leap_seconds
from orip.stations.gnss.raw_files import LOOKED_AT, log_of, moment, rinex_of_log, seconds_of_date, time_marks

_GZIP = b"\x1f\x8b"
_COMPRESSED = ((b"\x1f\x9d", "compressed by compress (.Z)"), (b"PK\x03\x04", "a ZIP archive"))
_COMPACT = "COMPACT RINEX FORMAT"
_LABEL = 60
"""Column where the label of a line of the header begins."""

_EPOCH_2 = re.compile(r"^ ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d) ?([ \d]{1,2}\.\d+) {1,2}(\d)([ \d]{3})")
_EPOCH_3 = re.compile(r"^> (\d{4}) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d) ?([ \d]{1,2}\.\d+) {1,2}(\d)([ \d]{3})")
_SATELLITE = re.compile(r"([GRECJSI ])([ \d]\d)")
_OBSERVED = (0, 1)
"""Flags of an epoch with observations: all is well; the power failed before it."""

_EXTERNAL_EVENT = 5
_LARGEST_HEIGHT = 100.0
"""Metres of an antenna above its mark: of a mast, not of a mistake."""


class ReceiverFile(Struct, frozen=True):
    """What an observation or navigation file has.

    Parameters
    ----------
    path : Path
    shown : str
        As messages name it.
    kind : {"O", "N"}
        Observations of a receiver, or orbits of satellites.
    version : float
        Of RINEX.
    marker : str
        Name of the station; empty: none.
    place : array (3,)
        Approximate geocentric coordinates, m; NaN where there are none.
    antenna : array (3,)
        Of the antenna's reference point above the mark: east, north, up, m.
    antenna_type : str
    time : array (n,)
        Of the epochs with observations, or of orbits, seconds since 1980-01-06 GPS time; ascending.
    events : array (m,)
        Times of external events, ascending.
    satellites : frozenset of str
        ``G07``.
    data : bytes
        The text, unpacked.
    """

    path: Path
    shown: str
    kind: str
    version: float
    marker: str
    place: FloatArray
    antenna: FloatArray
    antenna_type: str
    time: FloatArray
    events: FloatArray
    satellites: frozenset[str]
    data: bytes

    @property
    def span(self) -> str:
        """Return its first and last epoch for messages."""
        if not len(self.time):
            return "no epochs"
        return f"{moment(self.time[0])} to {moment(self.time[-1])}"


def read_receiver_file(
    path: Path, shown: str, kind: str = "O", near: float | None = None
) -> ReceiverFile | list[Complaint]:
    """Read what is in a file, or say what is wrong with it.

    Parameters
    ----------
    kind : {"O", "N"}
        What is wanted of a log that has observations and orbits.
    near : float, optional
        A time within half a week of those of the file, as of `rinex_of_log`.
    """
    data, marks = unpacked(path, shown), None
    log = None if isinstance(data, Complaint) else log_of(data)
    if log is not None and not isinstance(data, Complaint):
        marks = time_marks(data)
        data = rinex_of_log(data, log, kind, near, shown)
    if isinstance(data, Complaint):
        return [data]
    lines = data.decode("ascii", errors="replace").splitlines()
    header = _Header.of(lines, shown)
    if isinstance(header, Complaint):
        return [header]
    body = lines[header.length :]
    times, events, satellites = _epochs(body, header) if header.kind == "O" else _orbits(body, header)
    complaints = list(header.complaints)
    if not len(times):
        what = "observations" if header.kind == "O" else "orbits"
        complaints.append(Complaint(f"there are no {what} after the header; give the whole file", shown))
    if complaints:
        return complaints
    return ReceiverFile(
        path, shown, header.kind, header.version, header.marker, header.place, header.antenna, header.antenna_type,
        times, events if marks is None else marks, satellites, data,
    )  # fmt: skip


def read_events(path: Path, shown: str) -> FloatArray | Complaint:
    """Return the times (n,) of the events that a receiver recorded, as of `ReceiverFile`; or what is wrong."""
    data = unpacked(path, shown)
    if isinstance(data, Complaint):
        return data
    log = log_of(data)
    if log is not None:
        times = time_marks(data)
    else:
        lines = data.decode("ascii", errors="replace").splitlines()
        header = _Header.of(lines, shown)
        if isinstance(header, Complaint):
            return header
        times = _epochs(lines[header.length :], header)[1]
    if len(times):
        return times
    what = "epochs with the flag 5" if log is None else "UBX-TIM-TM2" if log == "ubx" else "RTCM 3 carries none"
    return Complaint(f"there are no events of the receiver in this file ({what}); was the camera connected?", shown)


def is_receiver_file(path: Path) -> bool:
    """Return whether a file is one of observations: RINEX, also compressed, or a log of u-blox or RTCM 3."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        begin = file.read(LOOKED_AT)
    return begin.startswith(_GZIP) or b"RINEX VERSION" in begin[:200] or log_of(begin) is not None


def unpacked(path: Path, shown: str) -> bytes | Complaint:
    """Return what is in a file, without gzip and Hatanaka's compression; or what is wrong with it."""
    data, faults = read_bytes(path, shown)
    if data is None:
        return faults[0]
    if data.startswith(_GZIP):
        try:
            data = gunzip(data)
        except (EOFError, zlib.error, OSError) as error:
            return Complaint(f"the file cannot be unpacked ({error}); give the whole file", shown)
    for begin, what in _COMPRESSED:
        if data.startswith(begin):
            return Complaint(f"the file is {what}; unpack it first", shown)
    return _without_compact_form(data, shown)


def gunzip(data: bytes) -> bytes:
    """Return what is in a gzip; raises zlib.error or gzip.BadGzipFile where it is damaged, cut off or too large."""
    decompressor = zlib.decompressobj(wbits=31)
    text = decompressor.decompress(data, LARGEST_FILE)
    if not decompressor.eof:
        message = "the compressed file is cut off, or too large"
        raise gzip.BadGzipFile(message)
    return text


def _without_compact_form(data: bytes, shown: str) -> bytes | Complaint:
    """Return a file without Hatanaka's compression; as it is where it has none."""
    if _COMPACT.encode() not in data[:2000]:
        return data
    try:
        from hatanaka import HatanakaException, decompress
    except ImportError:
        return Complaint(
            "the file is compact RINEX (Hatanaka): pip install 'orip[gnss]', or unpack it (crx2rnx)", shown
        )
    try:
        return bytes(decompress(data))
    except (HatanakaException, ValueError) as error:
        return Complaint(f"the compact RINEX cannot be unpacked ({error}); was it cut off?", shown)


class _Header(Struct):
    """Lines before END OF HEADER, as they are understood."""

    kind: str
    version: float
    length: int
    marker: str
    place: FloatArray
    antenna: FloatArray
    antenna_type: str
    system: str
    time_system: str
    complaints: list[Complaint]

    @classmethod
    def of(cls, lines: list[str], shown: str) -> _Header | Complaint:
        """Return the header of a file, or what is wrong with it."""
        first = lines[0] if lines else ""
        version = _numbers(first[:20], 1)
        kind = first[20:21].upper()
        if not first[_LABEL:].startswith("RINEX VERSION") or version is None or not 2.0 <= version[0] < 5.0:
            found = shown_token(first[:40].strip()) or "nothing"
            return Complaint(f"this is no RINEX file (version 2 to 4): it begins with '{found}'", shown, 1)
        end = next((at for at, line in enumerate(lines) if line[_LABEL:].startswith("END OF HEADER")), None)
        if end is None:
            return Complaint("the header has no END OF HEADER; the file is cut off", shown, len(lines))
        kinds = {"O": "O", "N": "N", "G": "N", "H": "N", "L": "N"}
        if kind not in kinds:
            message = f"a RINEX file of the kind '{shown_token(kind)}'; needed are O (observations) or N (orbits)"
            return Complaint(message, shown, 1, 21)
        header = cls(
            kinds[kind], version[0], end + 1, "", np.full(3, np.nan), np.zeros(3), "",
            "R" if kind == "G" else first[40:41].strip() or "G", {"R": "GLO", "C": "BDT"}.get(first[40:41], ""), [],
        )  # fmt: skip
        for number, line in enumerate(lines[:end], 1):
            header.hear(line, shown, number)
        return header

    def hear(self, line: str, shown: str, number: int) -> None:
        """Take in a line."""
        label = line[_LABEL:].strip()
        if label == "MARKER NAME":
            self.marker = line[:_LABEL].strip()
        elif label == "ANT # / TYPE":
            self.antenna_type = line[20:40].strip()
        elif label == "TIME OF FIRST OBS":
            self.time_system = line[48:51].strip() or self.time_system
        elif label == "APPROX POSITION XYZ":
            place = _numbers(line[:_LABEL], 3)
            if place is None:
                self.complaints.append(Complaint("three coordinates in metres are needed", shown, number))
            elif any(place):
                self.place = np.array(place)
        elif label == "ANTENNA: DELTA H/E/N":
            delta = _numbers(line[:_LABEL], 3)
            if delta is None or max(map(abs, delta)) > _LARGEST_HEIGHT:
                limit = f"height, east, north in metres, each below {_LARGEST_HEIGHT:g}"
                self.complaints.append(Complaint(f"the antenna above its mark is needed: {limit}", shown, number))
            else:
                self.antenna = np.array([delta[1], delta[2], delta[0]])


def _numbers(text: str, count: int) -> list[float] | None:
    """Return the first numbers of a text; None: there are fewer, or one is none."""
    words = text.replace("D", "E").split()[:count]
    try:
        values = [float(word) for word in words]
    except ValueError:
        return None
    return values if len(values) == count and all(np.isfinite(values)) else None


_BEIDOU_BEHIND = 14.0
"""Seconds of BeiDou time behind GPS time."""


def _epochs(lines: list[str], header: _Header) -> tuple[FloatArray, FloatArray, frozenset[str]]:
    """Return times of epochs and of external events, and the satellites observed."""
    version = header.version
    pattern = _EPOCH_3 if version >= 3.0 else _EPOCH_2
    times, events, satellites = [], [], set[str]()
    named = 0
    """Satellites of the epoch that lines to come name."""
    for line in lines:
        found = pattern.match(line)
        if found is None:
            if version >= 3.0 and line[:1].isalpha():
                satellites.update(_satellites(line[:3]))
            elif named > 0 and version < 3.0 and not line[:32].strip():
                satellites.update(_satellites(line[32:68]))
                named -= 12
            continue
        flag, count = int(found[7]), int(found[8] or 0)
        time = seconds_of_date([float(part) for part in found.groups()[:6]])
        if time is not None and flag in _OBSERVED:
            times.append(time)
            if version < 3.0:
                satellites.update(_satellites(line[32:68]))
                named = count - 12
        elif time is not None and flag == _EXTERNAL_EVENT:
            events.append(time)
    first = (times or events or [0.0])[0]
    behind = {"GLO": leap_seconds(GPS_START + timedelta(seconds=first)), "BDT": _BEIDOU_BEHIND}
    late = behind.get(header.time_system, 0.0)
    return np.unique(times) + late, np.unique(events) + late, frozenset(satellites)


def _satellites(text: str) -> set[str]:
    return {f"{(system.strip() or 'G')}{int(number):02d}" for system, number in _SATELLITE.findall(text) if int(number)}


def _orbits(lines: list[str], header: _Header) -> tuple[FloatArray, FloatArray, frozenset[str]]:
    """Return the times of broadcast orbits and their satellites."""
    times, satellites = [], set[str]()
    for line in lines:
        if header.version >= 3.0:
            name, words = line[:3], line[4:23].split()
        else:
            name, words = f"{header.system}{line[:2]}", line[2:22].split()
        found = _satellites(name) if name[:1].strip() and len(words) == 6 else set()
        time = seconds_of_date([float(word) for word in words]) if found and all(map(_is_plain, words)) else None
        if time is not None:
            times.append(time)
            satellites |= found
    return np.unique(times), np.zeros(0), frozenset(satellites)


def _is_plain(word: str) -> bool:
    return re.fullmatch(r"\d+(\.\d*)?", word) is not None
