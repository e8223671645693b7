"""One mistake in the control: it is named first, with and without positions; and what else is said of control."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from mistakes.advice import Project, follow, is_well, said_first, sound
from support.long_cases import every, in_turn


def exchanged(made: Project) -> None:
    made.control["14"], made.control["40"] = made.control["40"], made.control["14"]


def one_height(made: Project) -> None:
    made.control["44"] = made.control["44"] + [0.0, 0.0, 1.3]


def decimal_point(made: Project) -> None:
    made.control["44"] = made.control["44"] * [1.0, 1.0, 10.0]


def one_northing_first(made: Project) -> None:
    made.control["14"] = made.control["14"][[1, 0, 2]]


def heights_reversed(made: Project) -> None:
    made.control = {name: xyz * [1.0, 1.0, -1.0] for name, xyz in made.control.items()}


MISTAKES = {
    "two exchanged": (exchanged, r"control points 14 and 40 fit when they are exchanged"),
    "one height": (one_height, r"control point 44: its coordinates contradict the photos: they are off by Z \+1\.[23]"),
    "decimal point": (decimal_point, r"control point 44: Z = .* its decimal point is displaced"),
    "axes of one": (one_northing_first, r"control point 14: the photos see it where it would be with X and Y"),
    "sign of heights": (heights_reversed, r"Z (fits with|has) the opposite sign"),
}


@pytest.mark.parametrize(("mistake", "ending"), in_turn(MISTAKES, ["", "STA", "ELE"]))
def test_what_changes_least_and_fits_is_named_and_can_be_followed(tmp_path: Path, mistake: str, ending: str) -> None:
    change, words = MISTAKES[mistake]
    made, truth = sound(ending, 2), sound(ending, 2)
    change(made)
    line = said_first(said := orip(made.write(tmp_path / "before"), "run", "--no-report"))
    assert re.search(words, line), said.told
    assert follow(made, truth, line)
    after = orip(made.write(tmp_path / "after"), "run", "--no-report")
    assert is_well(after), after.told


def test_errors_that_a_free_network_ignores_are_named(tmp_path: Path) -> None:
    folder = sound("", 2).write(tmp_path / "folder")
    toml = folder / "orip.toml"
    toml.write_text(f'{toml.read_text()}datum = "free"\n')
    assert 'datum = "free" takes all weight from the 7 control points' in orip(folder, "run", "--no-report").told


@pytest.mark.parametrize("factor", every(2, [10.0, 0.1, 0.25]))
def test_a_wrong_precision_is_said_with_what_to_write(tmp_path: Path, factor: float) -> None:
    folder = sound("STA", 2).write(tmp_path / "folder")
    toml = folder / "orip.toml"
    (given,) = re.findall("measurement_precision = ([0-9.]+)", toml.read_text())
    toml.write_text(toml.read_text().replace(given, f"{float(given) * factor:.6g}"))
    line = said_first(said := orip(folder, "run", "--no-report"))
    assert "measurement_precision" in line
    assert "may be at another place" not in said.told
    (meant,) = re.findall(r"write ([0-9.]+) mm", line)
    assert 0.5 * float(given) < float(meant) < 1.5 * float(given)  # the photos are 0.003 mm good


def test_a_control_point_under_two_numbers_is_named(tmp_path: Path) -> None:
    made = sound("", 2)
    photos = [photo for photo, points in made.measured.items() if "42" in points]
    for photo in photos[::2]:
        made.measured[photo]["4201"] = made.measured[photo].pop("42")
    told = orip(made.write(tmp_path / "folder"), "run", "--no-report").told
    assert "points 42 and 4201: their rays meet in one place" in told


@pytest.mark.parametrize("seed", every(5, [6, 0, 3, 4, 7]))
def test_control_with_errors_that_are_too_small_accuses_no_point(tmp_path: Path, seed: int) -> None:
    made, random = sound("", seed), np.random.default_rng(seed)
    made.control = {name: xyz + random.normal(scale=0.3, size=3) for name, xyz in made.control.items()}
    made.control_errors = {name: np.full(3, 0.1) for name in made.control}
    line = said_first(orip(made.write(tmp_path / "folder"), "run", "--no-report"))
    assert re.search(r"residuals of the (?:[XYZ] of the )?control points are \d\.\d times their a-priori errors", line)
