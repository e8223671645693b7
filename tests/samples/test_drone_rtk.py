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
SHIFT = '\n[[antenna]]\nname = "RTK"\nshift = "strip"\nstrips = ["S3"]\n'


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


def test_strip_and_fix_are_named_and_the_setting_that_is_named_helps(tmp_path: Path, truth: dict[str, Any]) -> None:
    folder = copied(tmp_path / "drone")
    said = orip(folder, "run", "--no-report")
    assert said.code == 0
    (status,) = [line for line in said.out.splitlines() if line.startswith("status")]
    assert "the exposure stations of strip S3 are all off by X" in status
    assert 'set shift = "strip" and strips = ["S3"] in [[antenna]] of orip.toml' in said.out
    assert "station DJI_0044" in said.out
    # stations of the strip lost weight one by one: what is said of the strip is said of them; a wrong fix is its own
    named = [line.split(":")[1] for line in said.err.splitlines() if line.startswith("warning: exposure station")]
    assert named == [" exposure station DJI_0044"]
    before = json.loads((folder / "result.json").read_text())
    (folder / "orip.toml").write_text((folder / "orip.toml").read_text() + SHIFT)
    assert orip(folder, "run", "--no-report").code == 0
    after = json.loads((folder / "result.json").read_text())
    assert "drift" not in before["verdict"]
    # redundancy 2115: sigma0 has a standard deviation of 0.015
    assert after["sigma0"] == pytest.approx(1.0, abs=0.05)
    assert orip(folder, "report").code == 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Exposure stations: residuals of positions" in page
    assert all(f"Residuals of stations in {axis} over time" in page for axis in "XYZ")
    shift = after["antennas"]["RTK"]["strips"]["S3"]
    for key, value in zip(("SX", "SY", "SZ"), truth["shifted strip"]["east north up"], strict=True):
        # three standard deviations, and what the convergence of 0.75 degrees makes of a shift to the east
        assert abs(shift[key]["value"] - value) < 3 * shift[key]["sd"] + 0.002
    # the shifted strip has lost its weight, each of its stations as a whole
    assert heights(before) < 0.025
    # the survey has 0.012 m, the points 0.014 m
    assert heights(after) < 2 * np.hypot(0.012, 0.014)
    differences = np.array(
        [
            [after["photos"][name][key]["value"] - value for key, value in zip(ELEMENTS, values, strict=True)]
            for name, values in truth["photos"].items()
        ]
    )
    differences[:, 3:] = (differences[:, 3:] + 180.0) % 360.0 - 180.0
    deviations = np.array([[after["photos"][name][key]["sd"] for key in ELEMENTS] for name in truth["photos"]])
    # errors of neighbouring photos go together, so that the mean square is far less certain than that of 360 numbers
    assert np.mean((differences / deviations) ** 2) == pytest.approx(1.0, abs=0.6)


def heights(result: dict[str, Any]) -> float:
    return float(np.sqrt(np.mean([point["dZ"] ** 2 for point in result["check_points"]])))


@pytest.mark.parametrize(("first", "last", "fits"), [(1, 8, True), (37, 48, False)])
def test_one_strip_of_stations_and_control_beside_it_suffice(tmp_path: Path, first: int, last: int, fits: bool) -> None:
    """Stations nearly on a line leave the turn about it to the control; the second strip has the bad fix."""
    folder = copied(tmp_path / "drone")
    rows = (folder / "DRONE.STA").read_text(encoding="utf-8").splitlines(keepends=True)
    (folder / "DRONE.STA").write_text("".join(rows[first - 1 : last]), encoding="utf-8")
    said = orip(folder, "run", "--no-report")
    assert "status   converged" in said.out
    assert ("its position contradicts the block" not in said.err) == fits
    result = json.loads((folder / "result.json").read_text())
    # the turn about the strip is as certain as 0.012 m of the survey beside it, and all points 0.03 m
    assert np.abs([[point["dX"], point["dY"], point["dZ"]] for point in result["check_points"]]).max() < 0.1


@pytest.mark.parametrize("rows", [[0, 1, 2], [0, 5, 11]])
def test_stations_on_a_line_alone_are_said_to_leave_the_turn_about_it(tmp_path: Path, rows: list[int]) -> None:
    folder = copied(tmp_path / "drone")
    stations_of_all = (folder / "DRONE.STA").read_text(encoding="utf-8").splitlines(keepends=True)
    (folder / "DRONE.STA").write_text("".join(stations_of_all[row] for row in rows), encoding="utf-8")
    points = (folder / "DRONE.PNT").read_text(encoding="utf-8").replace("0.008 0.008 0.012", "-0.008 -0.008 -0.012")
    (folder / "DRONE.PNT").write_text(points.replace("--", "-"), encoding="utf-8")
    said = orip(folder, "run", "--no-report")
    assert said.code != 0
    assert "the exposure stations lie on one line" in said.err
    assert "they do not fix the rotation about it; give a control point off the line" in said.err
    assert "all 5 points of the .PNT file have negative errors" in said.err


def test_events_without_names_are_matched_by_the_times_of_photos(tmp_path: Path) -> None:
    folder = copied(tmp_path / "drone", "DRONE.STA")
    head = "".join((SAMPLE / "flight.pos").read_text().splitlines(keepends=True)[:4])
    times, rows = [], []
    for number, line in enumerate((SAMPLE / "flight_Timestamp.MRK").read_text().splitlines()):
        fields = line.replace(",", " ").split()
        rows.append(
            f"2315 {fields[1]} {fields[9]} {fields[11]} {fields[13]} {1 if number != 5 else 2} 17 {'0.01 ' * 6}0 9\n"
        )
        if number:  # the first is a test release; the clock of the camera has whole seconds, and is an hour late
            times.append(f"DJI_{number:04d}.JPG,{int(float(fields[1])) + 3600}\n")
    (folder / "flight_events.pos").write_text(head + "".join(rows))
    (folder / "times.csv").write_text("photo,time\n" + "".join(times))
    refused = orip(folder, "stations", "import", "flight_events.pos")
    assert refused.code == 3
    assert "the order alone is no proof" in refused.err
    assert not (folder / "DRONE.STA").exists()
    said = orip(folder, "stations", "import", "flight_events.pos", "--photos", "times.csv", "--json")
    assert said.code == 0
    assert len(said.document["stations"]) == 60
    warned = {warning["code"]: warning for warning in said.document["warnings"]}
    assert warned["event-without-photo"]["where"] == "flight_events.pos:5"
    assert warned["not-fixed"]["where"] == "flight_events.pos:10"
    by_time = stations((folder / "DRONE.STA").read_text())
    assert orip(folder, "stations", "import", "flight_Timestamp.MRK", "--replace").code == 0
    by_number = stations((folder / "DRONE.STA").read_text())
    for name, place in by_number.items():
        np.testing.assert_allclose(by_time[name], place, atol=2e-4)


def test_a_table_of_stations(tmp_path: Path) -> None:
    folder = copied(tmp_path / "drone", "DRONE.STA")
    rows = [line.split() for line in (SAMPLE / "DRONE.STA").read_text().splitlines()]
    table = "Image,E,N,Height,std_x,std_y,std_z,om,ph,ka\n"
    table += "".join(",".join([f"{row[0]}.JPG", *row[1:7], "0.5", "-0.5", "90"]) + "\n" for row in rows)
    (folder / "stations.csv").write_text(table)
    assert orip(folder, "stations", "import", "stations.csv", "--angle-error", "0.3").code == 0
    again = [line.split() for line in (folder / "DRONE.STA").read_text().splitlines()]
    assert [row[:7] for row in again] == [row[:7] for row in rows]
    assert again[0][7:13] == ["0.500000", "-0.500000", "90.000000", "0.300000", "0.300000", "0.300000"]


@pytest.mark.parametrize("heading", ["photo,X,Y,Z", "photo,lon,lat,Z"])
def test_photos_without_a_fix_have_no_station(tmp_path: Path, heading: str) -> None:
    folder = copied(tmp_path / "drone", "DRONE.STA")
    place = "561957.5,5934109.3,142" if "X" in heading else "9.935,53.552,142"
    (folder / "GPS.csv").write_text(f"{heading}\nDJI_0001,{place}\nDJI_0002,0.0,0,0\nDJI_0003,{place}\n")
    said = orip(folder, "stations", "import", "GPS.csv")
    assert "warning: GPS.csv:3: has no position; 0, 0 counts as none" in said.err
    assert [line.split()[0] for line in (folder / "DRONE.STA").read_text().splitlines()] == ["DJI_0001", "DJI_0003"]


def test_stations_none_of_whose_photos_is_known_are_told(tmp_path: Path) -> None:
    folder = copied(tmp_path / "drone", "DRONE.STA")
    (folder / "GPS.csv").write_text("photo,X,Y,Z\nIMG_1,561957.5,5934109.3,142\nIMG_2,561981.5,5934109.3,142\n")
    said = orip(folder, "stations", "import", "GPS.csv").err
    assert "photos IMG_1 and IMG_2 are not in the project, which has DJI_0001, DJI_0002 and 58 more" in said


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["nothing.pos"], 3, "nothing.pos: there is no such file"),
        (["flight.pos", "--events", "DRONE.PNT"], 3, "DRONE.PNT:2: the first line is no heading, but has numbers"),
        (["flight.pos", "--accept", "good"], 2, "--accept good: write one of fixed, float, all"),
        (["flight.pos", "--error", "0.1"], 2, "--error 0.1: write three numbers above 0"),
        (["flight.pos", "--column", "place=X"], 2, "--column place=X: write KEY=HEADING; keys are: photo, time"),
        (["flight.pos", "--mount", "wing"], 2, "--mount wing: write body or gimbal"),
    ],
)
def test_what_is_refused_writes_nothing(tmp_path: Path, arguments: list[str], code: int, words: str) -> None:
    folder = copied(tmp_path / "drone", "DRONE.STA")
    said = orip(folder, "stations", "import", *arguments)
    assert said.code == code
    assert words in said.err
    assert sorted(path.name for path in folder.iterdir()) == sorted(GENERATED)
