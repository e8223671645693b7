"""Each of the likeliest mistakes is named by the first line that orip says, and the documentation has that line."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.command_line import orip
from mistakes.catalogue import CLIFF, DCS, MISTAKES, ZURICH
from mistakes.edits import sample
from mistakes.first_line import BEGIN, DOCUMENT, END, first_line, row, said_of
from support.long_cases import with_long

LONG = (
    "directions_in_gon", "rows_upwards", "sensor_size", "equivalent_focal_length", "feet_against_orientations",
    "wrong_camera", "distortion_sign", "exchanged_photos", "other_lens",
    "north_east_against_orientations", "orientations_in_radians",
)  # fmt: skip
"""Mistakes whose explanation takes seconds, as all others are tried before; each has a planted sibling."""


@pytest.mark.parametrize("name", with_long(LONG, MISTAKES))
def test_the_first_line_says_what_is_wrong(tmp_path: Path, name: str) -> None:
    mistake = MISTAKES[name]
    line = first_line(said_of(mistake, tmp_path / name))
    for words in mistake.tells:
        assert words in line
    assert not mistake.listed or row(mistake, line) in DOCUMENT.read_text(encoding="utf-8"), (
        "docs/mistakes.md has another line; PYTHONPATH=tests python -m mistakes.first_line writes its table again"
    )


def test_the_table_has_each_mistake_once_and_nothing_else() -> None:
    table = DOCUMENT.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]
    titles = [line.split(" | ")[0].removeprefix("| ") for line in table.splitlines()[2:]]
    assert titles == [mistake.title for mistake in MISTAKES.values() if mistake.listed]
    assert len(titles) == len(set(titles)) >= 20


@pytest.mark.parametrize("name", [CLIFF, ZURICH, DCS])
def test_of_a_sample_without_mistakes_nothing_is_said(tmp_path: Path, name: str) -> None:
    folder = sample(name, tmp_path / name)
    assert first_line([orip(folder, "run", "--no-report")]).startswith("status   converged")
