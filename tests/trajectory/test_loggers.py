"""Logs of inertial units that are known by their content: published lines, and flights written as each of them."""

from __future__ import annotations

import gzip
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from trajectory.inertial_flight import LEVER, MEMS, START, flight, observed, written

from orip.errors import Complaint
from orip.records.epochs import SECONDS_PER_WEEK
from orip.stations.inertial.files import ImuForm, read_imu
from orip.stations.inertial.loggers import logger_of, read_dataflash, read_imr, read_novatel
from orip.stations.inertial.samples import ImuSamples

HG1700 = (
    b"%RAWIMUSXA,1692,484620.664;00,11,1692,484620.664389000,00801503,"
    b"43110635,-817242,-202184,-215194,-41188,-9895*a5db8c7b"
)
"""From the manual of OEM7 (RAWIMUSX), as NovAtel's decoder of messages (novatel_edie) has it too."""

FORMATS = {
    129: ("IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    130: ("GPS", "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
}
PACKED = {"c": "h", "L": "i", "e": "i"}


def novatel(time: float, counts: tuple[int, ...], kind: int = 58, info: str = "00") -> bytes:
    """Return a message: counts of forces x, y, z and rates x, y, z."""
    week, seconds = divmod(time, SECONDS_PER_WEEK)
    fx, fy, fz, wx, wy, wz = counts
    text = (
        f"RAWIMUSXA,{week:.0f},{seconds:.3f};{info},{kind},{week:.0f},{seconds:.9f},00000000,"
        f"{fz},{-fy},{fx},{wz},{-wy},{wx}"
    ).encode()
    return b"%" + text + b"*%08x\r\n" % (zlib.crc32(text, 0xFFFFFFFF) ^ 0xFFFFFFFF)


def message(kind: int, form: str, *values: object) -> bytes:
    return b"\xa3\x95" + bytes([kind]) + struct.pack("<" + "".join(PACKED.get(one, one) for one in form), *values)


def dataflash(imu: ImuSamples, delay: np.ndarray, drift: float, *, text: bool = False) -> bytes:
    """Return a log whose clock began 100 s before, and drifts; GPS, five times a second, is late by a delay."""
    rows: list[tuple[float, int, tuple[object, ...]]] = []
    own = (imu.time + 100.0) * (1.0 + drift)
    for at, (force, rate) in enumerate(zip(imu.force, imu.rate, strict=True)):
        micros = round(own[at] * 1e6)
        rows.append((own[at], 129, (micros, 0, *rate, *force, 0, 0, 20.0, 1, 1, 400, 400)))
        rows.append((own[at], 129, (micros, 1, *(rate + 9.0), *(force + 9.0), 0, 0, 20.0, 1, 1, 400, 400)))
    for time, late in zip(np.arange(0.0, imu.time[-1], 0.2), delay, strict=False):
        week, seconds = divmod(time + START, SECONDS_PER_WEEK)
        heard, place = (time + late + 100.0) * (1.0 + drift), (14, 80, 5, 6, 7, 1.0, 2.0, 0.0, 0.0, 1)
        rows.append((heard, 130, (round(heard * 1e6), 0, 4, round(seconds * 1e3), int(week), *place)))
    rows.sort(key=lambda row: row[0])
    return _as_text(rows) if text else _as_binary(rows)


def _written(value: object) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _as_text(rows: list[tuple[float, int, tuple[object, ...]]]) -> bytes:
    heads = [f"FMT, {kind}, 60, {name}, {form}, {labels}" for kind, (name, form, labels) in FORMATS.items()]
    lines = [", ".join([FORMATS[kind][0], *(_written(value) for value in row)])
             for _, kind, row in rows]  # fmt: skip
    return "\n".join([*heads, "MSG, 5, ArduCopter", *lines]).encode()


def _as_binary(rows: list[tuple[float, int, tuple[object, ...]]]) -> bytes:
    sizes = {128: 89} | {kind: len(message(kind, FORMATS[kind][1], *row)) for _, kind, row in rows}
    heads = [
        b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, sizes.get(kind, 5), *(part.encode() for part in parts))
        for kind, parts in {128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns"), **FORMATS}.items()
    ]
    return b"".join([*heads, *(message(kind, FORMATS[kind][1], *row) for _, kind, row in rows)])


def imr(imu: ImuSamples, order: str = "<", increments: bool = True) -> bytes:
    """Return a file of Inertial Explorer: increments of the interval before, or rates."""
    rate, scales = 200.0, (1e-7, 1e-6)
    head = struct.pack(
        f"{order}8sbdiidddiid", b"$IMURAW\0", order == ">", 8.9, increments, increments, rate, *scales, 2, 0, 0.0
    )
    step = rate if increments else 1.0
    time = np.mod(imu.time + START, SECONDS_PER_WEEK) + (0.5 / rate if increments else 0.0)
    rows = np.empty(len(imu.time), [("t", f"{order}f8"), ("w", f"{order}i4", 3), ("f", f"{order}i4", 3)])
    rows["t"] = time
    rows["w"], rows["f"] = np.round(np.degrees(imu.rate) / step / scales[0]), np.round(imu.force / step / scales[1])
    return head.ljust(512, b"\0") + rows.tobytes()


def as_novatel(imu: ImuSamples) -> bytes:
    """Return increments of the interval of 5 ms before, of an HG4930."""
    counts = np.hstack([np.round(imu.force / 200.0 * 2**29), np.round(imu.rate / 200.0 * 2**33)]).astype(int)
    return b"".join(
        novatel(time + START + 0.0025, tuple(row)) for time, row in zip(imu.time, counts.tolist(), strict=True)
    )


@pytest.fixture(scope="module")
def imu() -> ImuSamples:
    truth = flight(strips=1, straight=10.0)
    return observed(truth, MEMS, np.random.default_rng(2))[0]


def test_a_published_line_of_novatel_has_gravity():
    """A standing unit, 100 times a second: 9.79 m/s² upwards along z, and the rotation of the Earth at most."""
    table = read_novatel(HG1700, "a")
    np.testing.assert_allclose(table[0, 0], 1692 * SECONDS_PER_WEEK + 484620.664389 - 0.5)  # one line has no interval
    assert np.linalg.norm(table[0, 1:4]) * 100.0 == pytest.approx(9.79, abs=0.02)
    assert table[0, 3] > 0.0
    assert table[0, 2] > 0.0  # the field is -y
    assert np.linalg.norm(table[0, 4:]) * 100.0 < 0.003


@pytest.mark.parametrize(
    ("made", "week"),
    [
        (as_novatel, True), (imr, False), (lambda one: imr(one, ">"), False),
        (lambda one: imr(one, increments=False), False),
    ],
)  # fmt: skip
def test_samples_are_read_back(tmp_path: Path, imu, made, week):
    (tmp_path / "a.log").write_bytes(gzip.compress(made(imu)))
    found = read_imu(tmp_path / "a.log", "a.log", ImuForm())
    assert found.complaints == ()
    time = imu.time + (START if week else np.mod(START, SECONDS_PER_WEEK))
    np.testing.assert_allclose(found.value.time, time, atol=1e-6)
    np.testing.assert_allclose(found.value.force, imu.force, atol=2e-4)
    np.testing.assert_allclose(found.value.rate, imu.rate, rtol=3e-6, atol=4e-7)  # times have 0.1 µs


@pytest.mark.parametrize("text", [False, True])
def test_a_log_of_ardupilot_has_gps_time(tmp_path: Path, imu, text):
    """Its clock gains 40 µs a second; the receiver's messages are 0.11 s late, and up to 0.1 s more."""
    delay = 0.11 + 0.1 * np.random.default_rng(3).random(1000) ** 2
    (tmp_path / "a.bin").write_bytes(dataflash(imu, delay, 4e-5, text=text))
    found = read_imu(tmp_path / "a.bin", "a.bin", ImuForm())
    assert found.complaints == ()
    np.testing.assert_allclose(found.value.time, imu.time + START - 0.11, atol=0.004)
    np.testing.assert_allclose(found.value.force, imu.force, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.value.rate, imu.rate, rtol=1e-6, atol=1e-6)


def test_a_log_is_smoothed_like_a_table(tmp_path: Path):
    pytest.importorskip("gtsam", reason="pip install 'orip[ins]'")
    truth = flight(strips=1, straight=20.0, rate=100.0)
    imu, fixes = observed(truth, MEMS, np.random.default_rng(4))
    written(tmp_path, truth, imu, fixes)
    (tmp_path / "log.bin").write_bytes(dataflash(imu, np.full(1000, 0.1), 0.0))
    said = orip(tmp_path, "imu", "log.bin", "flight.pos", LEVER, "--as-given", "--json")
    assert said.code == 0, said.err
    (warning,) = [one for one in said.document["warnings"] if one["code"] == "time-offset"]
    assert "--shift 0.1" in warning["text"] or "--shift 0.09" in warning["text"]
    said = orip(tmp_path, "imu", "log.bin", "flight.pos", LEVER, "--as-given", "--shift", "0.1", "--json")
    assert said.document["warnings"] == []
    assert said.document["time_system"] == "gps"


def test_columns_may_be_named_by_the_heading(tmp_path: Path, imu):
    table = np.column_stack([imu.rate, imu.time, imu.force, imu.time * 0.0])
    text = "wx;wy;wz;Time;fx;fy;fz;temperature\n" + "\n".join(";".join(map(repr, row)) for row in table.tolist())
    (tmp_path / "a.csv").write_text(text)
    found = read_imu(tmp_path / "a.csv", "a.csv", ImuForm())
    assert found.complaints == ()
    np.testing.assert_array_equal(found.value.force, imu.force)


def test_what_is_wrong_with_a_log_is_said(tmp_path: Path, imu):
    lines = as_novatel(imu)
    short = ImuSamples(imu.time[:300], imu.force[:300], imu.rate[:300])
    flown = dataflash(short, np.full(9, 0.1), 0.0)
    for read, data, words in (
        (read_novatel, b"#BESTPOSA,1*00000000\n", "no samples (RAWIMUXA, RAWIMUSXA)"),
        (read_novatel, lines.replace(b",58,", b",16,"), "no samples"),  # the check sums are wrong now
        (read_novatel, novatel(START, (1, 2, 3, 4, 5, 6), kind=16), "the type of the unit is 16"),
        (read_novatel, novatel(START, (1, 2, 3, 4, 5, 6), info="02"), "are encrypted"),
        (read_imr, imr(short)[:-5], "the file is cut off"),
        (read_imr, b"$IMURAW\0" + bytes(600 - 8 - 56), "no scales"),
        (read_dataflash, flown[: flown.index(b"\xa3\x95\x81")], "no samples (IMU)"),
        (read_dataflash, flown.replace(b"\xa3\x95\x82", b"\xa3\x95\x83"), "no time of a receiver"),
    ):  # fmt: skip
        found = read(data, "a")
        assert isinstance(found, Complaint)
        assert words in str(found)
    (tmp_path / "a.imr").write_bytes(imr(short))
    (fault,) = read_imu(tmp_path / "a.imr", "a.imr", ImuForm(force="g")).complaints
    assert "a log of Inertial Explorer, which has its own columns and units" in str(fault)
    assert logger_of(b"time,fx\n") is None


def test_mutated_logs_are_read_or_complained_of(tmp_path: Path, imu):
    from exchange.mutated_files import use_mutated_files

    short = ImuSamples(imu.time[:40], imu.force[:40], imu.rate[:40])
    sound = [
        (tmp_path / "a.log", as_novatel(short)), (tmp_path / "a.imr", imr(short)),
        (tmp_path / "a.bin", dataflash(short, np.full(3, 0.1), 0.0)),
        (tmp_path / "b.log", dataflash(short, np.full(3, 0.1), 0.0, text=True)),
    ]  # fmt: skip
    use_mutated_files(sound, 300, 5, lambda path: read_imu(path, path.name, ImuForm()))
