"""A lever arm in millimetres or with the wrong sign, and stations that are late: named, and clean after the advice."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import Said, orip
from mistakes.small_folders import aerial, images, known

from orip.structs import replace

SPREAD = ("00", "04", "40", "44", "80", "84", "42")
SECONDS, LATE, ARM = 10.0, 0.5, 0.3
PHOTOS = {
    f"P{4 * row + column + 1}": (1000.0 + 900.0 * column, 1500.0 + 500.0 * row, 1600.0 + 7.0 * column, 0.4, 0.5, 1.0)
    for row in range(3)
    for column in range(4)
}


def told(folder: Path, antenna: str, late: float = 0.0) -> Said:
    made = aerial(photos=PHOTOS)
    measured = images(PHOTOS, made.points, 150.0, 115.0, 0.004)
    replace(made, measured=measured, control=known(made.points, 0.02, SPREAD)).write(folder)
    random, lines = np.random.default_rng(5), []
    for place, (name, values) in enumerate(PHOTOS.items()):
        row, column = divmod(place, 4)
        moved = (
            late / SECONDS * np.array([900.0, 0.0, 7.0]) + np.array([0.0, 0.0, ARM]) + random.normal(scale=0.03, size=3)
        )
        xyz = " ".join(f"{value:.4f}" for value in np.array(values[:3]) + moved)
        time = 1000.0 * row + SECONDS * column
        lines.append(f"{name} {xyz} 0.05 0.05 0.05 - - - - - - {time:.3f} S{row}\n")
    (folder / "T.STA").write_text("".join(lines))
    toml = folder / "orip.toml"
    toml.write_text(f'{toml.read_text()}\n[[antenna]]\nname = "GNSS"\n{antenna}\n')
    return orip(folder, "run", "--no-report")


WRONG = {
    "millimetres": (f"lever_arm = [0.0, 0.0, {1e3 * ARM}]", 0.0, "lever_arm = [0, 0, 0.3]: it seems to be in millim"),
    "sign": (f"lever_arm = [0.0, 0.0, {-ARM}]", 0.0, "lever_arm = [0, 0, 0.3]: its sign is wrong"),
    "late": (f"lever_arm = [0.0, 0.0, {ARM}]", LATE, 's late, as all are off by about 45.'),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_the_antenna_is_named_and_the_advice_leaves_nothing(tmp_path: Path, name: str) -> None:
    antenna, late, words = WRONG[name]
    said = told(tmp_path / "wrong", antenna, late).told
    assert words in said or words.replace("45.", "44.") in said, said
    advised = re.search(r"(lever_arm|unknown) = \[[^]]*\]", said.partition("warning: ")[2])
    assert advised is not None
    mended = f"{antenna}\n{advised[0]}" if name == "late" else advised[0]
    after = told(tmp_path / "mended", mended, late).told
    assert "status   converged" in after, after
    assert "exposure stations: they are" not in after
    assert "fit with lever_arm" not in after


def test_stations_that_are_late_by_one_exposure_may_have_the_names_of_others(tmp_path: Path) -> None:
    said = told(tmp_path / "shifted", f"lever_arm = [0.0, 0.0, {ARM}]", SECONDS).told
    assert "as much as from one exposure to the next: the names of photos are probably shifted by one" in said, said
    assert "as much as" not in told(tmp_path / "late", f"lever_arm = [0.0, 0.0, {ARM}]", LATE).told


def test_an_antenna_as_it_is_says_nothing(tmp_path: Path) -> None:
    said = told(tmp_path / "clean", f"lever_arm = [0.0, 0.0, {ARM}]").told
    assert "status   converged" in said, said
    assert "lever_arm" not in said
