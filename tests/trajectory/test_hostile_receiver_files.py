"""Files of receivers and inertial units that are cut, exchanged, mutated or of others: one message with the cause.

After each of them the folder has what it had before.
"""

from __future__ import annotations

import gzip
import random
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import Said, orip
from reference.published_data import REFERENCE_DATA
from support.long_cases import every
from trajectory.inertial_flight import LEVER, MEMS, flight, observed, written
from trajectory.receiver_streams import ubx

GNSS = REFERENCE_DATA / "gnss"
ROVER, BASE, ORBITS = "07590920.05o", "30400920.05o", "30400920.05n"
MOST_LINES = 60
"""Of a message: 20 complaints of three lines."""


@pytest.fixture(scope="module")
def receivers(tmp_path_factory) -> Path:
    if not GNSS.exists():
        pytest.skip("the folder gnss is not in ../shared/reference-data beside the repository")
    pytest.importorskip("pyrtklib5", reason="pip install 'orip[gnss]'")
    folder = tmp_path_factory.mktemp("receivers")
    for name in (ROVER, BASE):  # ten minutes
        lines = (GNSS / name).read_text().splitlines(keepends=True)
        last = [at for at, line in enumerate(lines) if line.startswith(" 05  4  2")][20]
        (folder / name).write_text("".join(lines[:last]))
    shutil.copy(GNSS / ORBITS, folder)
    return folder


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> Path:
    pytest.importorskip("gtsam", reason="pip install 'orip[ins]'")
    folder = tmp_path_factory.mktemp("flown")
    truth = flight(strips=1, straight=12.0, rate=50.0)
    written(folder, truth, *observed(truth, MEMS, np.random.default_rng(1)))
    (folder / "imu.csv").write_bytes(gzip.decompress((folder / "imu.csv.gz").read_bytes()))
    (folder / "imu.csv.gz").unlink()
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def is_one_answer(said: Said, folder: Path, before: dict[str, bytes]) -> None:
    """A command either does what it is for, or says in some lines what is wrong, and writes nothing."""
    assert "internal error" not in said.err, said.err
    assert "Traceback" not in said.err, said.err
    assert len(said.err.splitlines()) <= MOST_LINES, said.err[:3000]
    if said.code != 0:
        assert "error" in said.err
        assert content(folder) == before
    for name in set(content(folder)) - set(before):
        (folder / name).unlink()


def mutated(data: bytes, draw: random.Random) -> bytes:
    """Return a text with one to eight bytes changed, lines lost, doubled or exchanged, or cut off."""
    kind = draw.randrange(6)
    lines = data.splitlines(keepends=True)
    at, other = draw.randrange(len(lines)), draw.randrange(len(lines))
    if kind == 0:
        return data[: draw.randrange(len(data))]
    if kind == 1:
        del lines[at]
    elif kind == 2:
        lines.insert(at, lines[at])
    elif kind == 3:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 4:  # columns shifted
        begin = draw.randrange(max(len(lines[at]), 1))
        lines[at] = lines[at][:begin] + b" " * draw.randrange(1, 4) + lines[at][begin:]
    else:
        changed = bytearray(data)
        for _ in range(draw.randrange(1, 9)):
            changed[draw.randrange(len(changed))] = draw.choice(b"0123456789.-+ eED\n\x00\xff>GR")
        return bytes(changed)
    return b"".join(lines)


@pytest.mark.parametrize("begin", every(20, range(0, 200, 10)))
def test_mutations(begin: int, receivers: Path, flown: Path, tmp_path: Path) -> None:
    """Of receivers' files half, of inertial units' files half."""
    for seed in range(begin, begin + 10):
        draw = random.Random(seed)
        is_gnss = seed % 2 == 0
        source = receivers if is_gnss else flown
        folder = tmp_path / str(seed)
        shutil.copytree(source, folder)
        name = draw.choice((ROVER, BASE, ORBITS) if is_gnss else ("imu.csv", "flight.pos"))
        data = (source / name).read_bytes()
        (folder / name).write_bytes(mutated(data, draw))
        before = content(folder)
        words = ("gnss", ROVER, BASE, ORBITS) if is_gnss else ("imu", "imu.csv", "flight.pos", LEVER)
        is_one_answer(orip(folder, *words), folder, before)


def refused(folder: Path, cause: str, *words: str) -> None:
    before = content(folder)
    said = orip(folder, *words)
    assert said.code != 0
    assert cause in said.err, said.err
    is_one_answer(said, folder, before)


def test_receivers_of_another_century_sky_or_kind(receivers, tmp_path):
    folder = Path(shutil.copytree(receivers, tmp_path / "f"))
    rover = (receivers / ROVER).read_text()
    (folder / "old.obs").write_text(rover.replace("\n 05  4  2", "\n 85  4  2"))
    refused(folder, "rover and base have no epoch in common: 1985-04-02", "gnss", "old.obs", BASE, ORBITS)
    head, end, body = rover.partition("END OF HEADER\n")
    other = body
    for number, new in zip((3, 7, 8, 11, 15, 19, 20, 24, 27, 28, 16, 1, 4, 13, 23), range(40, 55), strict=True):
        other = other.replace(f"G{number:2d}", f"G{new:2d}")
    (folder / "sky.obs").write_text(head + end + other)
    refused(folder, "no satellite of the systems GREJC in common", "gnss", "sky.obs", BASE, ORBITS)
    refused(folder, "this file has orbits where observations are needed", "gnss", ORBITS, BASE, ROVER)
    refused(folder, "rover and base are the same file", "gnss", ROVER, ROVER, ORBITS)
    refused(folder, "a baseline that stands needs many" if one_epoch(folder) else "", "gnss", "one.obs", BASE, ORBITS,
            "--way", "static")  # fmt: skip
    (folder / "cut.obs").write_text(rover[:700])
    refused(folder, "END OF HEADER; the file is cut off", "gnss", "cut.obs", BASE, ORBITS)
    (folder / "cut.gz").write_bytes(gzip.compress(rover.encode())[:-100])
    refused(folder, "cut off", "gnss", "cut.gz", BASE, ORBITS)
    (folder / "cut.ubx").write_bytes(ubx(rover)[:50])
    refused(folder, "this is no RINEX file", "gnss", "cut.ubx", BASE, ORBITS)
    place = "--base=-3976219.5082,3382372.5671,3652512.9849"
    refused(folder, "are rover and base exchanged?", "gnss", ROVER, BASE, ORBITS, place)
    before = content(folder)
    is_one_answer(orip(folder, "gnss", BASE, ROVER, ORBITS), folder, before)  # a baseline the other way round


def test_a_solution_without_positions(flown, tmp_path):
    folder = Path(shutil.copytree(flown, tmp_path / "f"))
    (folder / "flight.pos").write_text((flown / "flight.pos").read_text()[:51])
    refused(folder, "there are no positions in this file", "imu", "imu.csv", "flight.pos", LEVER)


def one_epoch(folder: Path) -> bool:
    lines = (folder / ROVER).read_text().splitlines(keepends=True)
    second = [at for at, line in enumerate(lines) if line.startswith(" 05  4  2")][1]
    (folder / "one.obs").write_text("".join(lines[:second]))
    return True


def test_inertial_files_that_are_exchanged_or_of_others(flown, tmp_path):
    folder = Path(shutil.copytree(flown, tmp_path / "f"))
    samples = (flown / "imu.csv").read_text()
    rows = [[float(word) for word in line.split(",")] for line in samples.splitlines()[1:]]
    table = np.array(rows)

    def scaled(name: str, force: float, rate: float, time: float = 0.0) -> None:
        new = np.column_stack([table[:, :1] + time, table[:, 1:4] * force, table[:, 4:7] * rate])
        text = "\n".join(
            ",".join(f"{value:.9g}" if at else f"{value:.6f}" for at, value in enumerate(row)) for row in new
        )
        (folder / name).write_text(text + "\n")

    scaled("g.csv", 1.0 / 9.80665, 1.0)
    scaled("century.csv", 1.0, 1.0, time=100 * 365.25 * 86_400.0)
    refused(folder, "are probably in g: --force-unit g", "imu", "g.csv", "flight.pos", LEVER)
    refused(folder, "0 s in common", "imu", "century.csv", "flight.pos", LEVER)
    (folder / "short.csv").write_text("\n".join(samples.splitlines()[:50]))
    refused(folder, "samples; at least 100 are needed", "imu", "short.csv", "flight.pos", LEVER)
    positions = (flown / "flight.pos").read_text().splitlines()
    (folder / "one.pos").write_text("\n".join(positions[:2]) + "\n")
    refused(folder, "are needed", "imu", "imu.csv", "one.pos", LEVER)
    (folder / "imu.gz.pos").write_bytes(gzip.compress(samples.encode()))
    refused(folder, "imu.gz.pos: this is no text", "imu", "imu.csv", "imu.gz.pos", LEVER)
    before = content(folder)
    for words in (("flight.pos", "imu.csv"), ("imu.csv", "imu.gz.pos"), ("imu.csv", "imu.csv")):
        said = orip(folder, "imu", *words, LEVER)
        assert said.code != 0
        is_one_answer(said, folder, before)
    scaled("degrees.csv", 1.0, 180.0 / np.pi)
    said = orip(folder, "imu", "degrees.csv", "flight.pos", LEVER)
    assert "--rate-unit deg/s" in said.err, said.err
    is_one_answer(said, folder, before | {"degrees.csv": (folder / "degrees.csv").read_bytes()})


def test_a_sample_that_was_misread_is_named(tmp_path, flown):
    folder = Path(shutil.copytree(flown, tmp_path / "f"))
    rows = (flown / "imu.csv").read_text().splitlines()
    for line, column, wrong in ((1114, 4, "5"), (602, 2, "-180")):
        words = rows[line].split(",")
        rows[line] = ",".join([*words[:column], wrong, *words[column + 1 :]])
    (folder / "imu.csv").write_text("\n".join(rows) + "\n")
    said = orip(folder, "imu", "imu.csv", "flight.pos", LEVER)
    assert "were probably misread: 602 (" in said.err, said.err
    assert "), 1114 (" in said.err, said.err
