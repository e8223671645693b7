"""Preliminary rotations in gon or radians."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from orip.arrays import FloatArray
from orip.bundle.solve import SolvedBlock
from orip.mistakes.after_adjustment.angle_unit import ANGLE_UNITS, angle_unit_text, is_nearer
from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding
from orip.records.block import Block
from orip.structs import replace


def angle_units(block: Block) -> Iterator[Hypothesis]:
    """Yield the preliminary rotations as angles in other units than degrees."""
    for factor in ANGLE_UNITS:
        orientation = block.photo_orientation * [1.0, 1.0, 1.0, factor, factor, factor]
        changed = replace(block, photo_orientation=orientation)
        near = partial(_is_near, given=block.photo_orientation[:, 3:], factor=factor)
        found = finding("angle-unit", "orip.toml", angle_unit_text(factor))
        yield Hypothesis(changed, found, near, concerns_start=True)


def _is_near(solved: SolvedBlock, given: FloatArray, factor: float) -> bool:
    return is_nearer(given, factor, solved.state.rotations)
