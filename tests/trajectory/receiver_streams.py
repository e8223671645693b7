"""Binary logs of receivers made from observations in RINEX 2: u-blox RXM-RAWX, RTCM 3 message 1004 with 1005.

After u-blox F9 HPG 1.32 interface description (UBX-22008968) and RTCM 10403.3; nothing of RTKLIB is used.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

LIGHT = 299_792_458.0
L1, L2 = 1575.42e6, 1227.60e6
GPS_START = datetime(1980, 1, 6)


@dataclass(frozen=True)
class Epoch:
    """Week and its seconds; of each GPS satellite C1, L1, L2, P2 (m, cycles); 0: not observed."""

    week: int
    seconds: float
    satellites: dict[int, tuple[float, float, float, float]]


def epochs_of(text: str) -> Iterator[Epoch]:
    """Yield the epochs of a RINEX 2 file with up to five kinds of observations."""
    header, _, body = text.partition("END OF HEADER")
    kinds = next(line for line in header.splitlines() if "# / TYPES OF OBSERV" in line)[:60].split()[1:]
    lines = iter(body.splitlines()[1:])
    for line in lines:
        if not re.match(r" \d\d [ \d]\d [ \d]\d [ \d]\d [ \d]\d .{10}  [01]", line):
            continue  # comments between epochs
        year, month, day, hour, minute = (int(line[at : at + 3]) for at in range(0, 15, 3))
        names = re.findall(r"[G ][ \d]\d", line[32:68])[: int(line[29:32])]
        rows = {int(name[1:]): next(lines) for name in names}
        time = (datetime(2000 + year, month, day, hour, minute) - GPS_START).total_seconds() + float(line[15:26])
        week, seconds = divmod(time, 604_800.0)
        found = {}
        for number, row in rows.items():
            values = dict(zip(kinds, (float(row[at : at + 14].strip() or 0) for at in range(0, 80, 16)), strict=False))
            found[number] = (values["C1"], values["L1"], values["L2"], values["P2"])
        yield Epoch(int(week), seconds, found)


def ubx(text: str) -> bytes:
    """Return observations as messages RXM-RAWX."""
    return b"".join(_rawx(epoch) for epoch in epochs_of(text))


def _rawx(epoch: Epoch) -> bytes:
    rows = []
    for number, (c1, l1, l2, p2) in epoch.satellites.items():
        for code, phase, signal in ((c1, l1, 0), (p2, l2, 3)):
            if code and phase:
                rows.append(
                    struct.pack("<ddfBBBBHBBBBBB", code, phase, 0.0, 0, number, signal, 0, 64500, 45, 3, 1, 3, 7, 0)
                )
    body = struct.pack("<dHbBBBH", epoch.seconds, epoch.week, 13, len(rows), 0, 1, 0) + b"".join(rows)
    return ubx_message(0x02, 0x15, body)


def ubx_message(group: int, kind: int, body: bytes) -> bytes:
    """Return a message of u-blox with its check sum."""
    head = struct.pack("<BBH", group, kind, len(body))
    a = b = 0
    for byte in head + body:
        a = (a + byte) & 255
        b = (b + a) & 255
    return b"\xb5\x62" + head + body + bytes([a, b])


class _Bits:
    def __init__(self) -> None:
        self.value = self.length = 0

    def add(self, width: int, number: int) -> None:
        self.value = (self.value << width) | (number & ((1 << width) - 1))
        self.length += width

    def message(self) -> bytes:
        pad = -self.length % 8
        body = (self.value << pad).to_bytes((self.length + pad) // 8, "big")
        frame = b"\xd3" + struct.pack(">H", len(body)) + body
        return frame + crc24q(frame).to_bytes(3, "big")


def crc24q(data: bytes) -> int:
    """Return Qualcomm's check sum of 24 bits."""
    crc = 0
    for byte in data:
        crc ^= byte << 16
        for _ in range(8):
            crc = (crc << 1) ^ (0x1864CFB if crc & 0x800000 else 0)
    return crc & 0xFFFFFF


def rtcm3(text: str) -> bytes:
    """Return observations as messages 1004, with the station of the header (1005) at the beginning."""
    place = next(line for line in text.splitlines() if "APPROX POSITION XYZ" in line)[:60].split()
    station = _Bits()
    for width, number in ((12, 1005), (12, 1), (6, 0), (4, 8)):
        station.add(width, number)
    for at, word in enumerate(place):
        station.add(38, round(float(word) * 1e4))
        if at < 2:
            station.add(2, 0)
    ambiguities: dict[tuple[int, int], float] = {}
    return station.message() + b"".join(_1004(epoch, ambiguities) for epoch in epochs_of(text))


def _1004(epoch: Epoch, ambiguities: dict[tuple[int, int], float]) -> bytes:
    found = _Bits()
    whole = {number: row for number, row in epoch.satellites.items() if all(row)}
    for width, number in (
        (12, 1004),
        (12, 1),
        (30, round(epoch.seconds * 1000)),
        (1, 0),
        (5, len(whole)),
        (1, 0),
        (3, 0),
    ):
        found.add(width, number)
    for number, (c1, l1, l2, p2) in whole.items():
        turns = int(c1 // (LIGHT / 1000.0))
        code = round((c1 - turns * LIGHT / 1000.0) / 0.02)
        rounded = code * 0.02 + turns * LIGHT / 1000.0
        phases = []
        for cycles, frequency in ((l1, L1), (l2, L2)):
            length = LIGHT / frequency
            off = cycles * length - rounded
            # phases count from any whole number of cycles, here from one near the code
            start = ambiguities.setdefault((number, int(frequency)), round(off / length) * length)
            phases.append(round((off - start) / 0.0005))
        fields = (
            (6, number), (1, 0), (24, code), (20, phases[0]), (7, 127), (8, turns), (8, 180), (2, 1),
            (14, round((p2 - rounded) / 0.02)), (20, phases[1]), (7, 127), (8, 180),
        )  # fmt: skip
        for width, value in fields:
            found.add(width, value)
    return found.message()
