"""Vertical photos of nearly flat ground, from nothing but control: what fits nevertheless is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from mistakes.first_line import first_line
from mistakes.flat_block import FOOT, PIXELS, SIZE, FlatBlock
from support.long_cases import in_turn


def multiplied(block: FlatBlock, by: np.ndarray, photos: tuple[str, ...] = ()) -> None:
    for photo in photos or block.measured:
        block.measured[photo] = {name: xy * by for name, xy in block.measured[photo].items()}


def rows_up(block: FlatBlock) -> None:
    for points in block.measured.values():
        for xy in points.values():
            xy[1] = PIXELS[1] - xy[1]


def north_east(block: FlatBlock) -> None:
    block.control = {name: xyz[[1, 0, 2]] for name, xyz in block.control.items()}


def one_mirrored(block: FlatBlock) -> None:
    for xy in block.measured["P2"].values():
        xy[0] = PIXELS[0] - xy[0]


def millimetres(block: FlatBlock) -> None:
    multiplied(block, SIZE / PIXELS)


def parts_of_the_picture(block: FlatBlock) -> None:
    multiplied(block, 1.0 / PIXELS)


def from_the_centre(block: FlatBlock) -> None:
    for points in block.measured.values():
        for xy in points.values():
            xy[:] = xy - PIXELS / 2


def half_resolution(block: FlatBlock) -> None:
    multiplied(block, np.array([0.5, 0.5]), ("P3",))


def heights_in_feet(block: FlatBlock) -> None:
    block.control = {name: xyz / [1, 1, FOOT] for name, xyz in block.control.items()}


def two_numbers(block: FlatBlock) -> None:
    of_photo = block.measured["P1"]
    of_photo["221x"] = of_photo.pop("221")


SIDES = ("X and Y of the control are exchanged", "mirror")
NAMED: dict[str, tuple[Callable[[FlatBlock], None], tuple[str, ...]]] = {
    "rows upwards": (rows_up, SIDES),
    "north, east": (north_east, SIDES),
    "one photo mirrored": (one_mirrored, ("photo P2", "mirror image", "rows seem to count upwards")),
    "mm for pixels": (millimetres, ("camera CAM", "they seem to be mm from the upper left corner")),
    "parts of the picture": (parts_of_the_picture, ("camera CAM", "they seem to be parts of the picture")),
    "from the centre": (from_the_centre, ("camera CAM", "pixels from the centre", "add 4429 and 6498")),
    "half the resolution": (half_resolution, ("photo P3", "at a lower resolution", "multiply columns and rows by 2")),
    "heights in feet": (heights_in_feet, ("Z seems to be in feet",)),
    "two numbers": (two_numbers, ("points 221 and 221x", "one point under two numbers")),
}


@pytest.mark.parametrize(("mistake", "relief"), in_turn(NAMED, [0.6, 2.0, 5.0]))
def test_the_cause_is_named_first(tmp_path: Path, mistake: str, relief: float) -> None:
    change, words = NAMED[mistake]
    block = FlatBlock(relief)
    change(block)
    said = orip(block.write(tmp_path / "folder"), "run", "--no-report")
    line = first_line([said])
    assert [word for word in words if word not in line] == [], line
    if change is not two_numbers:
        assert "status   converged" not in said.out + said.err


@pytest.mark.parametrize(("relief", "seed"), [(0.3, 11), (0.4, 1)])
def test_heights_in_feet_of_hardly_any_relief_accuse_no_lens(tmp_path: Path, relief: float, seed: int) -> None:
    """A lens of 30 mm in place of 124 mm explains them as well: C was said to be off by -94 ± 27 mm."""
    block = FlatBlock(relief, seed)
    heights_in_feet(block)
    said = orip(block.write(tmp_path / "folder"), "run", "--no-report")
    assert "Z seems to be in feet" in first_line([said])
    assert "C of camera" not in said.out + said.err


@pytest.mark.parametrize(("seed", "relief"), in_turn([1, 2, 3], [0.6, 2.0, 5.0]))
def test_nothing_is_said_where_nothing_is_wrong(tmp_path: Path, seed: int, relief: float) -> None:
    said = orip(FlatBlock(relief, seed).write(tmp_path / "folder"), "run", "--no-report")
    assert "status   converged" in said.out + said.err
    assert not any(word in said.out + said.err for word in ("mirror", "resolution", "feet", "two numbers"))


def test_points_of_matching_that_were_lost_and_found_again_are_not_complained_about(tmp_path: Path) -> None:
    block = FlatBlock(2.0)
    two_numbers(block)
    block.matched = True
    said = orip(block.write(tmp_path / "folder"), "run", "--no-report")
    assert "status   converged" in said.out + said.err
    assert "two numbers" not in said.out + said.err


@pytest.mark.parametrize("relief", [2.0, 200.0])
def test_a_ceiling_is_photographed_from_below(tmp_path: Path, relief: float) -> None:
    block = FlatBlock(relief, scale=1e-3, from_below=True)
    said = orip(block.write(tmp_path / "folder"), "run", "--no-report")
    assert "status   converged" in said.out + said.err
    assert "mirror" not in said.out + said.err


def test_a_mirrored_block_of_a_table_is_named_by_its_relief(tmp_path: Path) -> None:
    block = FlatBlock(5.0, scale=1e-3)
    block.errors = np.array([2e-5, 2e-5, 4e-5])
    rows_up(block)
    line = first_line([orip(block.write(tmp_path / "folder"), "run", "--no-report")])
    assert "mirror" in line
