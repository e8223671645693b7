"""Two scale bars that contradict each other in a free network: the one that is wrong is named, and how to mend it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.command_line import Said, orip
from mistakes.small_folders import Folder, aerial

from orip.structs import replace

MADE = aerial()
ENDS = {"A": ("21", "53"), "B": ("22", "71"), "C": ("11", "63")}


def length(start: str, end: str) -> float:
    return float(np.linalg.norm(MADE.points[start] - MADE.points[end]))


LENGTHS = {name: length(*ends) for name, ends in ENDS.items()}
Bars = dict[str, tuple[str, str, float]]


def bars(names: str = "AB", error: float = 0.01, **changed: tuple[str, str, float]) -> str:
    """Return lines of a .LEN file."""
    given: Bars = {**{name: (*ENDS[name], LENGTHS[name]) for name in names}, **changed}
    return "".join(f"{name} {start} {end} XYZ {value:.4f} {error}\n" for name, (start, end, value) in given.items())


def run(folder: Path, text: str) -> Said:
    made: Folder = replace(MADE, control=["! none"])
    made.write(folder)
    toml = folder / "orip.toml"
    toml.write_text(f'{toml.read_text()}datum = "free"\n')
    (folder / "T.LEN").write_text(text)
    return orip(folder, "run", "--no-report")


def exchanged_digits(value: float) -> float:
    """Return a length with the first two unlike digits that stand side by side exchanged."""
    text = f"{value:.4f}"
    place = next(row for row in range(1, 3) if text[row] != text[row + 1])
    return float(text[:place] + text[place + 1] + text[place] + text[place + 2 :])


DIGITS = exchanged_digits(LENGTHS["B"])

WRONG = {
    "digits exchanged": (bars(B=(*ENDS["B"], DIGITS)), "distance B", "two digits are exchanged"),
    "lengths exchanged": (
        bars("AC", A=(*ENDS["A"], LENGTHS["C"]), C=(*ENDS["C"], LENGTHS["A"])),
        "distances A and C",
        "fit when they are exchanged",
    ),
    "another point": (bars("AC", A=("21", "54", LENGTHS["A"])), "distance A", "from 21 to 53"),
    "errors in millimetres": (bars(error=100.0), "distances", "seem to be in mm"),
}


@pytest.mark.parametrize("name", WRONG)
def test_the_wrong_bar_is_named_and_nothing_else_accused(tmp_path: Path, name: str) -> None:
    text, where, words = WRONG[name]
    told = run(tmp_path / "folder", text).told
    line = next(line for line in told.splitlines() if line.startswith("warning: dist"))
    assert where in line, told
    assert words in line, told
    status = next(line for line in told.splitlines() if line.startswith("status"))
    assert "is off by" not in status, told


@pytest.mark.parametrize("text", [bars(), bars("ABC"), bars("AB", 0.3)])
def test_bars_that_fit_are_not_accused(tmp_path: Path, text: str) -> None:
    told = run(tmp_path / "folder", text).told
    assert "warning: dist" not in told, told
    assert "converged" in told


def test_of_two_bars_that_contradict_each_other_without_a_slip_neither_is_accused(tmp_path: Path) -> None:
    told = run(tmp_path / "folder", bars(B=(*ENDS["B"], 1.0371 * LENGTHS["B"]))).told
    assert "warning: distances A and B: they contradict each other by 3.7 %" in told or "by 3.6 %" in told, told
    assert "is off by" not in told


def test_of_three_bars_the_one_is_named_that_the_others_contradict(tmp_path: Path) -> None:
    told = run(tmp_path / "folder", bars("ABC", B=(*ENDS["B"], 1.0371 * LENGTHS["B"]))).told
    assert "warning: distance B: " in told, told
