"""A photo is only said to contradict the others where it has enough of their points to do so."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from cli.command_line import orip
from support.long_cases import every

SAMPLE = Path(__file__).parents[2] / "sample_projects" / "small_frame_block"
GIVEN = ("orip.toml", "CLIFF.LEN", "CLIFF.PNT", "DAY1.MEA", "DAY2.MEA")


def without_most_points(text: str, photo: str, left: int) -> str:
    """Return measurements in which a photo keeps its first points alone."""
    lines, seen, inside = [], 0, False
    for line in text.splitlines():
        if re.match(r"\S", line):
            inside = line.split()[:1] == ["POINTS"] and photo in line.split()
        elif inside and line.strip() and not line.strip().startswith("!"):
            seen += 1
            if seen > left:
                continue
        lines.append(line)
    assert seen > left
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("left", every(2, [4, 2]))
def test_a_photo_left_out_for_want_of_points_is_not_accused(left: int, tmp_path: Path) -> None:
    for name in GIVEN:
        shutil.copy(SAMPLE / name, tmp_path / name)
    day = tmp_path / "DAY2.MEA"
    day.write_text(without_most_points(day.read_text(encoding="ascii"), "206", left), encoding="ascii")
    said = orip(tmp_path, "run")
    assert "it does not fit them" not in said.told
    assert "photo 206" not in said.told or "photo 206 is left out, since it could not be oriented" in said.told
