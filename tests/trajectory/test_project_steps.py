"""`orip run` and `orip status` with files of receivers and inertial units: only what is out of date is computed."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from reference.published_data import REFERENCE_DATA
from trajectory.inertial_flight import LEVER_ARM, MEMS, START, flight, observed, written

from orip.files.control.stations_text import read_differences, read_stations
from orip.records.epochs import SECONDS_PER_WEEK

OFF = (-3978242.4348, 3382841.1715, 3650002.7667)
"""100 m from the base."""

pytest.importorskip("gtsam", reason="pip install 'orip[ins]'")

TEXT = """project = {{ name = "F", crs = "EPSG:25832" }}
imu = {{ samples = "imu.csv.gz", positions = "flight.pos", lever_arm = {arm}, events = "events.csv", as_given = true }}
[[camera]]
name = "C35"
c = 35.0
sensor = {{ columns = 6000, rows = 4000, width = 36.0, height = 24.0 }}
[[bundle]]
name = "MAIN"
measurement_precision = "0.5px"
"""


def text(arm: object = None) -> str:
    return TEXT.format(arm=LEVER_ARM.tolist() if arm is None else arm)


@pytest.fixture(scope="module")
def computed(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("computed")
    truth = flight(strips=1, straight=20.0, rate=100.0)
    written(folder, truth, *observed(truth, MEMS, np.random.default_rng(4)))
    rows = "".join(f"P{row},{time + START:.4f}\n" for row, time in enumerate(np.arange(18.05, 40.0, 2.0)))
    (folder / "events.csv").write_text("photo,time\n" + rows)
    (folder / "orip.toml").write_text(text())
    before = steps(folder)
    assert before[0] == ("orip imu", "missing")
    said = orip(folder, "run")
    assert "stations 11 in F.STA, with the differences between them" in said.err, said.err
    return folder


def steps(folder: Path) -> list[tuple[str, str]]:
    return [(step["command"], step["state"]) for step in orip(folder, "status", "--json").document["steps"]]


def test_stations_and_new_photos_are_written(computed):
    stations, differences = read_stations(computed / "F.STA", "S"), read_differences(computed / "F.REL", "R")
    assert stations.complaints == differences.complaints == ()
    assert (len(stations.value), len(differences.value)) == (11, 10)
    assert all(station.has_joint_covariance for station in stations.value)
    assert (computed / "orip.toml").read_text().count("[[photo]]") == 11


def test_only_what_is_out_of_date_is_computed(computed, tmp_path):
    folder = Path(shutil.copytree(computed, tmp_path / "again"))
    assert steps(folder)[0] == ("orip imu", "up to date")
    before = (folder / "F.STA").read_text()
    assert "stations" not in orip(folder, "run").err
    assert (folder / "F.STA").read_text() == before
    given = (folder / "orip.toml").read_text()
    (folder / "orip.toml").write_text(given.replace("as_given = true", "as_given = true, shift = 0.0001"))
    assert steps(folder)[0] == ("orip imu", "out of date")
    assert "stations 11 in F.STA" in orip(folder, "run").err
    assert steps(folder)[0] == ("orip imu", "up to date")
    assert len(read_stations(folder / "F.STA", "S").value) == 11
    events = (folder / "events.csv").read_text().splitlines(keepends=True)
    (folder / "events.csv").write_text("".join(events[:-1]))
    said = orip(folder, "run")
    assert "stations 10 in F.STA" in said.err
    assert "F.STA: P10 has a station from an earlier run or from elsewhere; take out" in said.err
    (folder / "F.STA").unlink()
    assert steps(folder)[0] == ("orip imu", "missing")


def test_what_is_doubtful_of_a_trajectory_is_said(computed, tmp_path):
    folder = Path(shutil.copytree(computed, tmp_path / "doubtful"))
    for change, words in (
        ('lever_arm = [-0.4, 0.2, 1.1]', "the positions fit best with --lever-arm="), ("shift = 0.2", "a time offset"),
    ):  # fmt: skip
        given = text([-0.4, 0.2, 1.1]) if "lever" in change else text().replace("as_given", f"{change}, as_given")
        (folder / "orip.toml").write_text(
            given + "".join(f'[[photo]]\nname = "P{n}"\ncamera = "C35"\n' for n in range(11))
        )
        said = orip(folder, "run")
        assert "stations 11 in F.STA" in said.err, said.err
        assert words in said.err


def test_what_is_wrong_is_said_and_nothing_is_written(computed, tmp_path):
    folder = Path(shutil.copytree(computed, tmp_path / "wrong"))
    (folder / "imu.csv.gz").unlink()
    given = (folder / "orip.toml").read_text()
    found = orip(folder, "status", "--json").document["steps"][0]
    assert found["text"] == "imu.csv.gz is not there; copy it, or correct orip.toml"
    before = (folder / "F.STA").read_bytes()
    said = orip(folder, "run")
    assert said.code != 0
    assert "imu.csv.gz" in said.err
    assert (folder / "F.STA").read_bytes() == before
    for wrong, words in (
        ('force_unit = "lb"', "force_unit"), ("columns = ['time', 'fx']", "columns of [imu] name each of time, fx"),
        ("rate = 9", "rate"), ("mount = [0.0, 0.0, 900.0]", "mount number 3 of [imu] is 900"),
    ):  # fmt: skip
        shutil.copy(computed / "imu.csv.gz", folder / "imu.csv.gz")
        (folder / "orip.toml").write_text(given.replace("as_given = true", f"as_given = true, {wrong}"))
        said = orip(folder, "run")
        assert said.code != 0
        assert words in said.err
        assert (folder / "F.STA").read_bytes() == before


def test_positions_of_a_receiver_become_stations(tmp_path):
    """The hour of two permanent stations; the photos are three epochs of it."""
    data = REFERENCE_DATA / "gnss"
    if not data.exists():
        pytest.skip("the folder gnss is not in ../shared/reference-data beside the repository")
    pytest.importorskip("pyrtklib5", reason="pip install 'orip[gnss]'")
    names = ("07590920.05o", "30400920.05o", "30400920.05n")
    for name in names:
        shutil.copy(data / name, tmp_path)
    rover, base, orbits = names
    table = f'gnss = {{ rover = "{rover}", base = "{base}", orbits = ["{orbits}"], events = "events.csv" }}\n'
    lines = text().splitlines(keepends=True)
    (tmp_path / "orip.toml").write_text(lines[0].replace("25832", "32654") + table + "".join(lines[2:]))
    begin = 1316 * SECONDS_PER_WEEK + 6 * 86400.0
    rows = "".join(f"P{row},{begin + 600.0 * (row + 1):.1f}\n" for row in range(3))
    (tmp_path / "events.csv").write_text("photo,time\n" + rows)
    assert [state for _, state in steps(tmp_path)[:2]] == ["missing", "missing"]
    said = orip(tmp_path, "run")
    assert "stations 3 in F.STA" in said.err, said.err
    assert [state for _, state in steps(tmp_path)[:2]] == ["up to date", "up to date"]
    place = np.array([station.position for station in read_stations(tmp_path / "F.STA", "S").value])
    from pyproj import Transformer

    # in the coordinates of the project; RTKLIB's own static solution
    expected = Transformer.from_crs(4978, 32654, always_xy=True).transform(-3976219.6649, 3382372.5435, 3652513.0563)
    np.testing.assert_allclose(place, [expected] * 3, atol=0.03)
    given = (tmp_path / "orip.toml").read_text()
    for old, new, words in (
        (f'["{orbits}"]', "[]", "no orbits are given"),
        ("gnss = { ", "gnss = { base_place = [35.2, 139.6, 70.0], ", "the place of the base is 35.2, 139.6, 70; geo"),
        ("gnss = { ", "gnss = { base_height = 1520.0, ", "a number of at most 100 is required"),
        ("gnss = { ", f"gnss = {{ base_place = {[*OFF]}, ", "the base is 100 m from the place in its header"),
    ):
        (tmp_path / "orip.toml").write_text(given.replace(old, new))
        assert words in orip(tmp_path, "run").err
    (tmp_path / "orip.toml").write_text(given)
    assert "stations 3 in F.STA" in orip(tmp_path, "run").err
    (tmp_path / base).write_bytes((tmp_path / base).read_bytes() + b"\n")
    # positions are to be computed again, and stations follow
    assert steps(tmp_path)[0] == ("orip gnss", "out of date")
