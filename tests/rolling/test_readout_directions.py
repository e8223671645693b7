"""Shutters that run along the columns, as in portrait pictures: recognised, and a direction that is wrong is told."""

from __future__ import annotations

import pytest
from support.long_cases import every

from orip.mistakes.stations.rolling_shutters import READOUT_TIME, ROLLING_SHUTTER
from orip.records.camera import READOUT, ReadoutDirection
from orip.solving.solve import solve
from orip.structs import replace
from rolling.rolling_flights import flown


def said(truth: ReadoutDirection, given: float, direction: ReadoutDirection, code: str) -> list[str]:
    """Return what is said of a readout of 40 ms where the block has another one."""
    block = flown(5, 0.04, 10.0, direction=truth).block
    (camera,) = block.cameras
    parameters = (*camera.parameters[:READOUT], given)
    cameras = (replace(camera, parameters=parameters, readout_direction=direction, unknown=("C",)),)
    found, _ = solve(replace(block, cameras=cameras))
    return [text for one, _, text in found.warnings if one == code]


@pytest.mark.parametrize(("truth", "first"), [("right", "left column"), ("left", "right column"), ("up", "lower row")])
def test_a_shutter_that_nothing_is_said_of_is_named_with_its_direction(truth: ReadoutDirection, first: str) -> None:
    (text,) = said(truth, 0.0, "down", ROLLING_SHUTTER)
    assert f"({first} first)" in text
    keys = "readout = -0.04" if truth == "up" else "readout = 0.04"
    assert keys in text
    assert (f'readout_direction = "{truth}"' in text) == (truth != "up")


@pytest.mark.parametrize(
    ("truth", "given"), every(2, [("right", "down"), ("left", "down"), ("up", "left"), ("down", "right")])
)
def test_a_direction_that_is_wrong_is_told(truth: ReadoutDirection, given: ReadoutDirection) -> None:
    (text,) = said(truth, 0.04, given, READOUT_TIME)
    assert "readout = 0.04 does not fit the photos" in text
    (readout, direction) = text.split("write readout = ")[1].split(" and unknown")[0].split(", readout_direction = ")
    assert 0.037 < float(readout) < 0.043
    assert direction == f'"{truth}"'


@pytest.mark.parametrize("direction", ["right", "left"])
def test_a_direction_that_is_right_is_not_accused(direction: ReadoutDirection) -> None:
    assert not said(direction, 0.04, direction, READOUT_TIME)
