"""Positions of photos that are all off by the same, against a block that fits without them."""

from __future__ import annotations

import numpy as np
import pytest
from monte_carlo.grouped_blocks import grouped_block
from monte_carlo.simulated_blocks import solved

from orip.bundle.results.solution import solution_of
from orip.mistakes.stations.contradicting_positions import ALL_ALIKE, OFF_ALIKE, alike_elsewhere
from orip.mistakes.stations.doubted_camera import without_positions
from orip.records.block import Block
from orip.structs import replace

BY = {"X0": 2.4, "Y0": -1.1, "Z0": 0.9}
"""Metres, as a base station in another system."""


def shifted(without: str = "") -> Block:
    """Return a block with positions that are all off, but for a photo that has none."""
    block = grouped_block("none", 1).block
    elements = (replace(one, value=one.value + BY.get(one.kind, 0.0)) for one in block.elements)
    return replace(block, elements=tuple(one for one in elements if one.name != without))


@pytest.mark.parametrize("lacks_one", [False, True])
def test_the_shift_of_all_is_named_even_where_a_photo_has_no_position(lacks_one: bool) -> None:
    block = shifted(grouped_block("none", 1).block.photos[0].name if lacks_one else "")
    solution = solution_of(solved(without_positions(block)))
    (found,) = alike_elsewhere(solution, block, solution.photos.names)
    assert (found.code, found.where) == (ALL_ALIKE, "exposure stations")
    told = dict(word.rstrip(",").split(" ") for word in found.text.split("off by ")[1].split(" m:")[0].split(", "))
    # the block without positions is known to a decimetre or two
    np.testing.assert_allclose([float(told[kind]) for kind in BY], list(BY.values()), atol=0.5)


def test_a_part_of_the_photos_keeps_a_setting_of_its_own() -> None:
    block = shifted()
    solution = solution_of(solved(without_positions(block)))
    (found,) = alike_elsewhere(solution, block, solution.photos.names[:5])
    assert found.code == OFF_ALIKE
    assert block.photos[0].name in found.where
