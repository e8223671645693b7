"""`orip new`: what it writes for each kind of block, with options, by questions on a terminal, and when it refuses."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip

from orip.files.project.starting_texts import BLOCK_KINDS
from orip.workflow.sample_projects import STARTS

FURTHER = {"drone": {"STA", "MEA"}, "object": {"LEN", "MEA"}, "film": {"MEA"}}


@pytest.mark.parametrize("kind", BLOCK_KINDS)
def test_every_kind_is_a_project_that_waits_for_measurements(tmp_path: Path, kind: str) -> None:
    document = orip(tmp_path, "new", "QUARRY", "--kind", kind, "--json").document
    assert set(document["files"]) == {"orip.toml", "QUARRY.PNT", *(f"QUARRY.{ending}" for ending in FURTHER[kind])}
    folder = tmp_path / "QUARRY"
    assert sorted(path.name for path in folder.iterdir()) == sorted([".gitignore", *document["files"]])
    assert not orip(folder, "init").err.count("warning")
    ran = orip(folder, "run")
    assert ran.code == 3
    assert "bundle MAIN has no photo points; measure some" in ran.err
    # what is commented out is right, too: without the marks of comments the project is still one
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    uncommented = re.sub(r"^# (?=\[\[\w+\]\]$|\w+ = )", "", text, flags=re.MULTILINE)
    (folder / "orip.toml").write_text(uncommented, encoding="utf-8")
    for name in document["files"][1:]:
        lines = (folder / name).read_text(encoding="utf-8").splitlines(True)
        first = next(
            row for row, line in enumerate(lines) if line[2:8] in ("K1    ", "DJI_00", "B1    ", "POINTS", "PHOTO ")
        )
        (folder / name).write_text("".join(line[2:] for line in lines[first:]), encoding="utf-8")
    filled = orip(folder, "init")
    assert filled.code == 0, filled.err
    assert "1 photo added" in filled.err


def test_an_object_with_bars_alone_is_adjusted_as_it_was_written(tmp_path: Path) -> None:
    assert orip(tmp_path, "new", "GATE", "--kind", "object").code == 0
    folder, usual = tmp_path / "GATE", STARTS["object"]
    random = np.random.default_rng(4)
    points = random.uniform(-1.0, 1.0, (40, 3))
    size, c = usual.pixel / 1000.0, usual.focal_length
    photos, measured = [], []
    for number, azimuth in enumerate(np.radians(np.arange(0.0, 360.0, 45.0))):
        # every second photo turned by a quarter; the camera looks along -z of its photo
        away = np.array([np.cos(azimuth), np.sin(azimuth), 0.4])
        centre, back = 6.0 * away, away / np.linalg.norm(away)
        right = np.cross([0.0, 0.0, 1.0], back) / np.hypot(*back[:2])
        axes = np.array([right, np.cross(back, right), back])
        u = (points - centre) @ axes.T
        x, y = -c * u[:, 0] / u[:, 2], -c * u[:, 1] / u[:, 2]
        x, y = (-y, x) if number % 2 else (x, y)
        pixels = np.column_stack([x / size + usual.columns / 2.0, usual.rows / 2.0 - y / size])
        pixels += random.normal(0.0, usual.photo_error, pixels.shape)
        photos.append(f'[[photo]]\nname = "IMG_{number}"\ncamera = "{usual.camera}"\n')
        measured.append(f"POINTS MAIN IMG_{number}\n")
        measured += [f"  P{row} {column:.3f} {line:.3f}\n" for row, (column, line) in enumerate(pixels.tolist())]
    with (folder / "orip.toml").open("a", encoding="utf-8") as text:
        text.write("\n" + "\n".join(photos))
    (folder / "GATE.MEA").write_text("".join(measured), encoding="utf-8")
    bars = [np.linalg.norm(points[one] - points[other]) for one, other in ((0, 1), (2, 3))]
    lines = [f"B{row} P{2 * row} P{2 * row + 1} XYZ {length:.6f} 0.0001\n" for row, length in enumerate(bars)]
    (folder / "GATE.LEN").write_text("".join(lines), encoding="utf-8")
    ran = orip(folder, "run")
    assert ran.code == 0, ran.err
    assert "status   converged" in ran.out
    found = orip(folder, "results", "points", "--json").document["points"]
    place = {name: np.array([found[name][axis]["value"] for axis in "XYZ"]) for name in ("P4", "P5")}
    # a length that no bar gives: by half a pixel in eight photos points are known to about half a millimetre
    assert np.linalg.norm(place["P4"] - place["P5"]) == pytest.approx(np.linalg.norm(points[4] - points[5]), abs=5e-3)


def test_options_are_in_the_text(tmp_path: Path) -> None:
    said = orip(
        tmp_path, "new", "HILL", "here", "--kind", "drone", "--user", "K. Huber", "--camera", "M3E", "--c", "12.29",
        "--frame", "5280x3956", "--pixel", "3.3", "--crs", "EPSG:25832", "--photo-error", "0.4",
        "--control-error", "0.015", "--station-error", "0.025",
    )  # fmt: skip
    assert said.code == 0, said.err
    text = tomllib.loads((tmp_path / "here" / "orip.toml").read_text(encoding="utf-8"))
    assert text["project"] == {"name": "HILL", "user": "K. Huber", "crs": "EPSG:25832"}
    (camera,) = text["camera"]
    assert (camera["name"], camera["c"]) == ("M3E", 12.29)
    # 5280 and 3956 pixels of 3.3 micrometres
    assert camera["sensor"] == {"columns": 5280, "rows": 3956, "width": 17.424, "height": 13.0548}
    assert text["bundle"] == [{"name": "MAIN", "measurement_precision": "0.4px"}]
    assert "0.015  0.015  0.015" in (tmp_path / "here" / "HILL.PNT").read_text()
    assert "0.025  0.025  0.05" in (tmp_path / "here" / "HILL.STA").read_text()


def test_on_a_terminal_it_asks_for_what_no_option_says(tmp_path: Path) -> None:
    answers = ["hovercraft", "object", "NIKON", "-24", "35", "", "", "EPSG:2056", "", ""]
    front, back = pty.openpty()
    words = [sys.executable, "-m", "orip", "-C", str(tmp_path), "new", "GATE"]
    with subprocess.Popen(words, stdin=back, stdout=subprocess.DEVNULL, stderr=back) as process:
        os.write(front, "".join(f"{answer}\n" for answer in answers).encode())
        assert process.wait(timeout=60) == 0
    text = tomllib.loads((tmp_path / "GATE" / "orip.toml").read_text(encoding="utf-8"))
    usual = STARTS["object"]
    assert (text["camera"][0]["name"], text["camera"][0]["c"]) == ("NIKON", 35.0)
    assert text["camera"][0]["sensor"]["columns"] == usual.columns
    assert text["project"]["crs"] == "EPSG:2056"
    os.close(front)
    os.close(back)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--frame", "wide"], "--frame wide: write columns and rows, such as 5472x3648"),
        (["--c", "0"], "Principal distance (focal length), mm: 0.0 is not a number above 0"),
        (["--pixel", "nan"], "'nan' is not a number"),
        (["--crs", "EPSG:1"], "EPSG:1"),
        (["--camera", ""], "name"),
    ],
)
def test_what_is_impossible_is_refused_and_nothing_is_written(tmp_path: Path, options: list[str], message: str) -> None:
    said = orip(tmp_path, "new", "GATE", *options)
    assert said.code in {2, 3}
    assert message in said.err
    assert list(tmp_path.iterdir()) == []


def test_no_file_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "GATE").mkdir()
    (tmp_path / "GATE" / "GATE.PNT").write_text("1 1 2 3 0.1 0.1 0.1\n")
    said = orip(tmp_path, "new", "GATE")
    assert said.code == 2
    assert "has the file GATE.PNT already: name another folder" in said.err
    assert [path.name for path in (tmp_path / "GATE").iterdir()] == ["GATE.PNT"]
