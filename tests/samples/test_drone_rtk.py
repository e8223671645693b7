"""The simulated flight with RTK: made again byte by byte, imported, adjusted, and back at its truth."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.command_line import orip
from workflow.small_projects import REPOSITORY

SAMPLE = REPOSITORY / "sample_projects" / "drone_rtk"
GENERATED = ("DRONE.MEA", "DRONE.PNT", "flight.pos", "flight_Timestamp.MRK", "orip.toml", "truth.json")
ELEMENTS = ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
SHIFTS = '\n[[antenna]]\nname = "RTK"\nshift = "strip"\nshift_error = [0.1, 0.1, 0.2]\n'


@pytest.fixture(scope="module")
def truth() -> dict[str, Any]:
    return json.loads((SAMPLE / "truth.json").read_text(encoding="utf-8"))


def copied(folder: Path, *left_out: str) -> Path:
    folder.mkdir()
    for name in (*GENERATED, "DRONE.STA"):
        if name not in left_out:
            shutil.copy(SAMPLE / name, folder)
    return folder


def stations(text: str) -> dict[str, np.ndarray]:
    rows = [line.split() for line in text.splitlines() if line[:1] not in "!#"]
    return {row[0]: np.array(row[1:4], dtype=float) for row in rows}


def test_made_again_the_files_are_the_same(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-B", SAMPLE / "simulate.py", tmp_path], check=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(GENERATED)
    for name in GENERATED:
        assert (tmp_path / name).read_bytes() == (SAMPLE / name).read_bytes(), name


def test_imported_again_the_stations_are_the_same(tmp_path: Path) -> None:
    folder = copied(tmp_path / "drone", "DRONE.STA")
    said = orip(folder, "stations", "import", "flight.pos", "--events", "flight_Timestamp.MRK")
    assert said.code == 0
    assert "warning: flight_Timestamp.MRK:1: no photo belongs to this event" in said.err
    assert "import   60 stations in 6 strips written to DRONE.STA" in said.err
    assert (folder / "DRONE.STA").read_bytes() == (SAMPLE / "DRONE.STA").read_bytes()
    again = orip(folder, "stations", "import", "flight.pos", "--events", "flight_Timestamp.MRK")
    assert again.code == 3
    assert "DRONE.STA:1: photo 'DJI_0001' has a station already; give --replace" in again.err
    assert (folder / "DRONE.STA").read_bytes() == (SAMPLE / "DRONE.STA").read_bytes()


@pytest.mark.parametrize(
    ("source", "factor"),
    [(["flight.pos", "--events", "flight_Timestamp.MRK"], 1.0), (["flight_Timestamp.MRK"], 1.5)],
)
def test_imported_stations_are_the_true_ones_except_for_what_is_wrong(
    tmp_path: Path, truth: dict[str, Any], source: list[str], factor: float
) -> None:
    folder = copied(tmp_path / "drone", "DRONE.STA")
    assert orip(folder, "stations", "import", *source).code == 0
    text = (folder / "DRONE.STA").read_text(encoding="utf-8")
    found = stations(text)
    shifted, bad = truth["shifted strip"], truth["bad fix"]
    differences = []
    for name, (x, y, z, *_) in truth["photos"].items():
        difference = found[name] - [x, y, z]
        difference -= shifted["east north up"] if truth["strips"][name] == shifted["strip"] else np.zeros(3)
        difference -= bad["east north up"] if name == bad["photo"] else np.zeros(3)
        differences.append(difference)
    # drawn with 0.010, 0.010, 0.018 m, in flight half as much more; the grid is turned by 0.75 degrees
    assert np.abs(differences).max() < 4 * 0.018 * factor
    np.testing.assert_allclose(np.std(differences, axis=0), np.array([0.010, 0.010, 0.018]) * factor, rtol=0.35)
    strips = {row.split()[0]: row.split()[14] for row in text.splitlines()}
    assert strips == truth["strips"]


def test_photos_that_the_project_lacks_are_added(tmp_path: Path) -> None:
    folder = copied(tmp_path / "drone", "DRONE.STA")
    toml = (folder / "orip.toml").read_text(encoding="utf-8")
    (folder / "orip.toml").write_text(toml[: toml.index("\n[[photo]]")], encoding="utf-8")
    arguments = ("stations", "import", "flight_Timestamp.MRK")
    refused = orip(folder, *arguments)
    assert refused.code == 3
    assert "give the pattern of the names with --names, such as 'DJI_{:04d}'" in refused.err
    planned = orip(folder, *arguments, "--names", "DJI_{:04d}", "--dry-run")
    assert "60 photos would be added to orip.toml" in planned.err
    assert not (folder / "DRONE.STA").exists()
    said = orip(folder, *arguments, "--names", "DJI_{:04d}")
    assert "60 photos added to orip.toml; 'orip init' takes them over" in said.err
    assert orip(folder, "init").code == 0
    assert "60 photos" in orip(folder, "status").out


def test_the_bad_fix_is_named_and_shifts_of_strips_are_found(tmp_path: Path, truth: dict[str, Any]) -> None:
    folder = copied(tmp_path / "drone")
    said = orip(folder, "run", "--no-report")
    assert said.code == 0
    assert "station DJI_0044" in said.err
    before = json.loads((folder / "result.json").read_text())
    (folder / "orip.toml").write_text((folder / "orip.toml").read_text() + SHIFTS)
    assert orip(folder, "run", "--no-report").code == 0
    after = json.loads((folder / "result.json").read_text())
    assert "the exposure stations of strip S3 are all off by X +0.13" in before["verdict"]
    assert "drift" not in before["verdict"]
    # redundancy 2118: sigma0 has a standard deviation of 0.015
    assert after["sigma0"] == pytest.approx(1.0, abs=0.05)
    shifts = after["antennas"]["RTK"]["strips"]
    for strip in ("S1", "S2", "S3", "S4", "S5", "S6"):
        expected = truth["shifted strip"]["east north up"] if strip == truth["shifted strip"]["strip"] else (0, 0, 0)
        for key, value in zip(("SX", "SY", "SZ"), expected, strict=True):
            # three standard deviations, and what the convergence makes of a shift to the east
            assert abs(shifts[strip][key]["value"] - value) < 3 * shifts[strip][key]["sd"] + 0.003
    height = {
        name: np.sqrt(np.mean([point["dZ"] ** 2 for point in result["check_points"]]))
        for name, result in (("before", before), ("after", after))
    }
    # the shifted strip has lost its weight as a whole
    assert height["before"] < 0.025
    assert height["after"] < 0.02
    differences = [
        [(after["photos"][name][key]["value"] - value) / after["photos"][name][key]["sd"] for key, value in
         zip(ELEMENTS, values, strict=True)] for name, values in truth["photos"].items()
    ]  # fmt: skip
    turned = np.array(differences)
    turned[np.abs(turned) > 1e3] = 0.0  # 180 and -180 degrees are the same
    # errors of neighbouring photos go together: a mean of squares far below 2 is all that can be asked for
    assert np.mean(turned**2) < 2.0
