"""Precise orbits and clocks (SP3, RINEX clocks) and antenna calibrations (ANTEX): what is in them before they are used.

SP3-c and d (NOAA, Hilla 2016), RINEX clock 3.00 and ANTEX 1.4 (IGS).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.stations.gnss.raw_files import moment, seconds_of_date
from orip.stations.gnss.receiver_data import unpacked

PRECISE = (".sp3", ".eph", ".clk")
_SP3 = re.compile(r"^#[a-d][PV]")
_EPOCH = re.compile(r"^(?:\*  |AS \S+ +)(\d{4}) +(\d{1,2}) +(\d{1,2}) +(\d{1,2}) +(\d{1,2}) +(\d{1,2}\.\d+)")
_LABEL = 60
_SOME = 5


class PreciseFile(Struct, frozen=True):
    """Its ending by which RTKLIB knows it, its text, and the times (n,) in it, seconds since 1980-01-06."""

    shown: str
    ending: str
    data: bytes
    time: FloatArray

    @property
    def span(self) -> str:
        """Return its first and last epoch for messages."""
        return f"{moment(self.time[0])} to {moment(self.time[-1])}"


def is_precise(path: Path) -> bool:
    """Return whether a name is that of precise orbits or clocks."""
    return _ending(path) in PRECISE


def _ending(path: Path) -> str:
    return Path(path.name.lower().removesuffix(".gz")).suffix


def read_precise(path: Path) -> PreciseFile | Complaint:
    """Read orbits or clocks, or say what is wrong with them."""
    data, shown = unpacked(path, path.name), path.name
    if isinstance(data, Complaint):
        return data
    lines, ending = data.decode("ascii", errors="replace").splitlines(), _ending(path)
    first = lines[0] if lines else ""
    if ending == ".clk":
        if not first[_LABEL:].startswith("RINEX VERSION") or first[20:21] != "C":
            return Complaint("these are no clocks in RINEX: line 1 has no 'C' for the kind of file", shown, 1)
    elif not _SP3.match(first):
        return Complaint("these are no orbits in SP3: line 1 begins with '#cP' or the like", shown, 1)
    found = (match for match in map(_EPOCH.match, lines) if match is not None)
    times = {seconds_of_date([float(part) for part in match.groups()]) for match in found}
    time = np.array(sorted(one for one in times if one is not None))
    if not len(time):
        return Complaint("there are no epochs in this file; give the whole file", shown)
    return PreciseFile(shown, ending, data, time)


class Antex(Struct, frozen=True):
    """Antenna calibrations: the text, and the types of antennas with their radomes."""

    shown: str
    data: bytes
    types: frozenset[str]

    def known(self, antenna: str) -> str | None:
        """Return the type of an antenna as the file has it: with its radome, else without one; None: it has not."""
        words = antenna.split()
        wanted = [f"{words[0]:<16}{words[1] if len(words) > 1 else 'NONE'}", f"{words[0]:<16}NONE"] if words else []
        return next((name for name in wanted if name in self.types), None)

    def alike(self, antenna: str) -> str:
        """Return some types of the file that are most like one, for messages."""
        begin = antenna[:3]
        return ", ".join(sorted(name for name in self.types if name.startswith(begin))[:_SOME]) or _shown(self.types)


def _shown(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)[:_SOME])


def read_antex(path: Path) -> Antex | Complaint:
    """Read antenna calibrations, or say what is wrong with them."""
    data, shown = unpacked(path, path.name), path.name
    if isinstance(data, Complaint):
        return data
    lines = data.decode("ascii", errors="replace").splitlines()
    if not lines or not lines[0][_LABEL:].startswith("ANTEX VERSION"):
        return Complaint("this is no ANTEX file: line 1 has no ANTEX VERSION", shown, 1)
    types = {f"{line[:16].rstrip():<16}{line[16:20].strip() or 'NONE'}" for line in lines
             if line[_LABEL:].startswith("TYPE / SERIAL NO")}  # fmt: skip
    opened, closed = (sum(line[_LABEL:].startswith(word) for line in lines) for word in ("START OF ANT", "END OF ANT"))
    if not types or opened != closed:
        return Complaint(f"{opened} antennas begin and {closed} end; the file is cut off or damaged", shown)
    return Antex(shown, data, frozenset(types))
