"""Events that a receiver recorded: epochs of RINEX with the flag 5, time marks of u-blox; and stations by them."""

from __future__ import annotations

import gzip
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from reference.published_data import REFERENCE_DATA
from trajectory.receiver_streams import ubx, ubx_message

from orip.errors import Complaint
from orip.files.control.stations_text import read_stations
from orip.stations.gnss.raw_files import time_marks
from orip.stations.gnss.receiver_data import is_receiver_file, read_events

GNSS = REFERENCE_DATA / "gnss"
ROVER, BASE, ORBITS = "07590920.05o", "30400920.05o", "30400920.05n"
WEEK = 604_800.0
DAY = 1316 * WEEK + 6 * 86_400.0
EVENTS = DAY + np.array([610.25, 645.5, 688.125, 701.0, 777.7625])

GLONASS = """\
     3.04           OBSERVATION DATA    R (GLONASS)         RINEX VERSION / TYPE
                                                            END OF HEADER
> 2024 05 06 07 08 10.0000000  5  0
"""


def mark(rise: float | None, fall: float | None, base: int = 1, valid: bool = True) -> bytes:
    """Return a message UBX-TIM-TM2 with the edges of a pulse."""
    fields, flags = [], base << 3 | (0x40 if valid else 0)
    for time, flag in ((rise, 0x80), (fall, 0x04)):
        week, seconds = divmod(time or 0.0, WEEK)
        milliseconds, rest = divmod(round(seconds * 1e9), 1_000_000)
        fields.append((int(week), milliseconds, rest))
        flags |= flag if time is not None else 0
    (rw, rm, rn), (fw, fm, fn) = fields
    return ubx_message(0x0D, 0x03, struct.pack("<BBHHHIIIII", 0, flags, 7, rw, fw, rm, rn, fm, fn, 50))


def with_events(text: str) -> str:
    """Return RINEX 2 with records of events where their time comes."""
    lines = text.splitlines(keepends=True)
    for time in EVENTS:
        minutes, seconds = divmod(time - DAY, 60.0)
        rows = [at for at, line in enumerate(lines) if line.startswith(" 05  4  2")]
        at = next(at for at in rows if 60.0 * float(lines[at][12:15]) + float(lines[at][15:26]) > time - DAY)
        lines.insert(at, f" 05  4  2  0 {minutes:2.0f}{seconds:11.7f}  5  0\n")
    return "".join(lines)


def read(folder: Path, data: bytes, name: str = "a") -> np.ndarray | Complaint:
    (folder / name).write_bytes(data)
    assert is_receiver_file(folder / name)
    return read_events(folder / name, name)


@pytest.mark.parametrize("first", ["rise", "fall"])
def test_the_edge_that_begins_a_pulse(tmp_path, first):
    """A contact pulls the input down, others raise it; the pulse ends 20 ms later."""
    pulses = [(time, time + 0.02) if first == "rise" else (time + 0.02, time) for time in EVENTS]
    together = b"".join(mark(*pulse) for pulse in pulses)
    np.testing.assert_allclose(read(tmp_path, together), EVENTS, atol=1e-6)
    apart = b"".join(mark(rise, None) + mark(None, fall) for rise, fall in pulses)
    np.testing.assert_allclose(time_marks(b"$GPGGA\r\n" + apart), EVENTS, atol=1e-6)
    one = b"".join(mark(None, time) if first == "fall" else mark(time, None) for time in EVENTS)
    np.testing.assert_allclose(time_marks(one), EVENTS, atol=1e-6)


def test_marks_in_utc_without_time_and_damaged():
    now = 2300 * WEEK + 5.0
    np.testing.assert_allclose(time_marks(mark(now - 18.0, None, base=2)), [now], atol=1e-6)
    assert not len(time_marks(mark(now, None, valid=False)))
    assert not len(time_marks(mark(now, None)[:-1] + b"\x00"))
    assert not len(time_marks(mark(now, None)[:20]))


def test_events_in_the_time_of_glonass_are_taken_to_gps_time(tmp_path):
    utc, gps = (read(tmp_path, text.encode()) for text in (GLONASS, GLONASS.replace("R (GLONASS)", "M (MIXED)  ")))
    assert utc - gps == 18.0
    said = f"{'':48}GLO         TIME OF FIRST OBS\n{'':60}END OF HEADER"
    assert (
        read(tmp_path, GLONASS.replace("R (GLONASS)", "M (MIXED)  ").replace(f"{'':60}END OF HEADER", said).encode())
        == utc
    )


def test_a_file_without_events_says_what_is_missing(tmp_path):
    small = GLONASS.replace("5  0\n", "0  0\n").encode()
    for data, what in ((small, "epochs with the flag 5"), (mark(None, None), "UBX-TIM-TM2")):
        fault = read(tmp_path, data)
        assert isinstance(fault, Complaint)
        assert what in str(fault)
    assert isinstance(read(tmp_path, gzip.compress(b"nothing")), Complaint)


@pytest.mark.parametrize("form", ["rinex", "ubx"])
def test_photos_get_the_places_of_the_receivers_events(tmp_path, form):
    """Two permanent stations for receivers, events between their epochs; the clock of the camera is 5.3 s late."""
    if not GNSS.exists():
        pytest.skip("the folder gnss is not in ../shared/reference-data beside the repository")
    pytest.importorskip("pyrtklib5", reason="pip install 'orip[gnss]'")
    for name in (BASE, ORBITS):
        shutil.copy(GNSS / name, tmp_path)
    text = (GNSS / ROVER).read_text()
    if form == "rinex":
        (tmp_path / "flight.obs").write_text(with_events(text))
    elif shutil.which("convbin") is None:
        pytest.skip("convbin is not on PATH")
    else:
        (tmp_path / "flight.obs").write_bytes(ubx(text) + b"".join(mark(time + 0.01, time) for time in EVENTS))
    (tmp_path / "orip.toml").write_text(
        'project = { name = "F", crs = "EPSG:32654" }\ncamera = [{ name = "C", c = 35.0 }]\n'
    )
    rows = "".join(f"P{row},{time - 5.3:.3f}\n" for row, time in enumerate(EVENTS))
    (tmp_path / "photos.csv").write_text("photo,time\n" + rows)
    said = orip(tmp_path, "gnss", "flight.obs", BASE, ORBITS)
    assert said.code == 0, said.err
    assert "5 of the receiver's event input" in said.err
    assert "orip stations import flight.pos --events flight.obs" in said.err
    said = orip(tmp_path, "stations", "import", "flight.pos", "--events", "flight.obs", "--photos", "photos.csv")
    assert said.code == 0, said.err
    found = read_stations(tmp_path / "F.STA", "S").value
    assert [station.photo for station in found] == [f"P{row}" for row in range(5)]
    np.testing.assert_allclose([station.time for station in found], EVENTS, atol=2e-3)
    from pyproj import Transformer

    place = Transformer.from_crs(4978, 32654, always_xy=True).transform(-3976219.6636, 3382372.5411, 3652513.0541)
    np.testing.assert_allclose([station.position for station in found], [place] * 5, atol=0.03)
