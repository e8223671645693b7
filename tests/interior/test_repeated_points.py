"""Points that are measured in a photo more than once: the later measurement, the mean, or both; and a warning."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip as orip_command
from support.synthetic_block import synthetic_block
from workflow.commands import initialise, measure

import orip
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.records.block import IndexedPhotoPoints
from orip.structs import replace

PROJECT = """
project = {{ name = "T" }}
[[camera]]
name = "C"
c = 50.0
{sensor}
[[photo]]
name = "P"
camera = "C"
X0 = 0.0
Y0 = 0.0
Z0 = 100.0
OMEGA = 0.0
PHI = 0.0
KAPPA = 0.0
[[bundle]]
name = "MAIN"
measurement_precision = 0.01
{setting}
"""
CONTROL = "".join(
    f"{name} {x} {y} 0 0.02 0.02 0.02\n" for name, x, y in (("1", -20, -20), ("2", 20, -20), ("3", 0, 20))
)
SENSOR = "sensor = { columns = 1000, rows = 1000, width = 50.0, height = 50.0 }"


FRAME = "frame = [50.0, 50.0]"


def written(folder: Path, log: str, setting: str = "", sensor: str = FRAME) -> Path:
    (folder / "orip.toml").write_text(PROJECT.format(sensor=sensor, setting=setting))
    (folder / "T.PNT").write_text(CONTROL)
    (folder / "T.MEA").write_text(log)
    return folder


def solved(folder: Path, log: str, setting: str = "") -> orip.Solution:
    return orip.open_project(written(folder, log, setting)).solve()


def warned(folder: Path) -> list[str]:
    initialise(folder)
    found = measure(folder).outcome.warnings
    return [warning.text for warning in found if warning.code == "measured-again-elsewhere"]


def observed(solution: orip.Solution, point: str) -> np.ndarray:
    """Return the photo coordinates of a point that were adjusted."""
    residuals = solution.residuals
    chosen = (np.array(residuals.kind) == "photo") & (np.array(residuals.point) == point)
    return np.array(residuals.observed)[chosen]


def log(x: float, further: str = "") -> str:
    return f"POINTS MAIN P\n1 -10 -10\n2 10 -10\n3 0 10\n{further}POINTS MAIN P\n1 {x} -10\n"


def test_the_later_measurement_replaces_the_earlier_one(tmp_path):
    found = solved(tmp_path, log(-10.02))
    assert observed(found, "1") == pytest.approx([-10.02, -10.0])
    assert warned(tmp_path) == []


def test_the_mean_of_all_measurements(tmp_path):
    found = solved(tmp_path, log(-10.02, "POINTS MAIN P\n1 -10.01 -10.03\n"), 'repeated_points = "mean"')
    assert observed(found, "1") == pytest.approx([-10.01, -10.01])
    assert observed(found, "2") == pytest.approx([10.0, -10.0])
    assert len(observed(found, "3")) == 2


def test_a_disregarded_measurement_has_no_part_in_the_mean(tmp_path):
    found = solved(tmp_path, log(-10.02, "POINTS MAIN P\n1 -10.3 -10 -\n"), 'repeated_points = "mean"')
    assert observed(found, "1") == pytest.approx([-10.01, -10.0])


@pytest.mark.parametrize(
    ("setting", "does"),
    [
        ("", "replaces the earlier"),
        ('repeated_points = "mean"', "mean of both"),
        ('repeated_points = "both"', "both count as observations"),
    ],
)
def test_a_measurement_at_another_place_is_told(tmp_path, setting, does):
    (text,) = warned(written(tmp_path, log(-5.0), setting))
    assert re.search(r"point 1 of photo P was measured before, 5 mm from here", text)
    assert does in text


def test_a_measurement_in_pixels_at_another_place_is_told(tmp_path):
    text = "POINTS MAIN P\n1 300 700\n2 700 700\n3 500 300\nPOINTS MAIN P\n1 300.5 700\n2 710 700\n"
    (told,) = warned(written(tmp_path, text, sensor=SENSOR))
    assert "point 2 of photo P was measured before, 10 px from here" in told


def test_another_word_is_refused(tmp_path):
    with pytest.raises(orip.InputError, match="repeated_points"):
        solved(tmp_path, log(-10.0), 'repeated_points = "twice"')


BOTH = 'repeated_points = "both"'


def test_both_measurements_are_observations(tmp_path):
    found = solved(tmp_path, log(-10.02), BOTH)
    assert observed(found, "1") == pytest.approx([-10.0, -10.0])
    assert observed(found, "1 (2)") == pytest.approx([-10.02, -10.0])
    assert found.redundancy == solved(tmp_path, log(-10.02)).redundancy + 2
    residuals = found.residuals
    of_x = {
        name: residual
        for name, component, residual in zip(residuals.point, residuals.component, residuals.residual, strict=True)
        if component == "x" and name.startswith("1")
    }
    assert of_x["1 (2)"] - of_x["1"] == pytest.approx(0.02)


def test_a_point_that_one_photo_shows_twice_has_one_ray(tmp_path):
    text = log(-10.0, "POINTS MAIN P\n7 3 4\n") + "7 3.001 4\n"
    found = solved(tmp_path, text, BOTH)
    assert found.points["7"].rays == 1
    assert np.isinf(found.points["7"].deviations).all()


def test_files_tell_the_measurements_apart(tmp_path):
    written(tmp_path, log(-10.02), BOTH)
    assert orip_command(tmp_path, "run").code == 0
    rows = list(csv.DictReader((tmp_path / "residuals.csv").read_text().splitlines()))
    assert [row["point"] for row in rows if row["kind"] == "photo"] == [*"112233", "1 (2)", "1 (2)"]
    (line,) = (
        line for line in (tmp_path / "BUNDLE_RESULT.OUT").read_text().splitlines() if line.startswith("  1 (2) ")
    )
    assert line.split()[2:4] == ["-10.0200", "-10.0000"]
    listed = orip_command(tmp_path, "observations", "list", "--all").out
    assert re.search(r"^\s+1\s+P\s+-10\.0000", listed, re.MULTILINE)
    assert re.search(r"^\s+1 \(2\)\s+P\s+-10\.0200", listed, re.MULTILINE)


def test_a_dump_brings_both_measurements_back(tmp_path):
    initialise(written(tmp_path, log(-10.02), BOTH))
    measure(tmp_path)
    dumped = orip_command(tmp_path, "dump", "MAIN.EXO").out
    (tmp_path / "dump.txt").write_text(dumped)
    assert orip_command(tmp_path, "load", "MAIN.EXO", "dump.txt").code == 0
    assert orip_command(tmp_path, "dump", "MAIN.EXO").out == dumped
    assert [line.count('"P", "1"') for line in dumped.splitlines()].count(1) == 2


def test_snooping_leaves_one_measurement_out_and_keeps_the_other():
    block = synthetic_block("convergent", "measured twice", noise_mm=0.003).block
    points = block.photo_points
    rows = np.append(np.arange(len(points.photo)), 4)
    xy = points.xy[rows].copy()
    xy[-1, 0] += 0.2
    again = IndexedPhotoPoints(points.photo[rows], points.point[rows], xy, points.error[rows], points.used[rows])
    doubled = replace(block, photo_points=again, definition=replace(block.definition, repeated_points="both"))
    found = snoop(doubled, SnoopingSettings("apriori", 1e-6), lambda _: None, lambda: False)
    (blunder,) = found.blunders
    assert blunder.point == f"{block.point_names[points.point[4]]} (2)"
    assert blunder.size == pytest.approx(0.2, abs=4.0 * blunder.sd)
