"""Theodolite directions in gon."""

from __future__ import annotations

from collections.abc import Iterator

from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding
from orip.records.block import Block
from orip.records.observations.control import ControlDirection
from orip.structs import replace
from orip.units import DEGREES_PER_GON


def direction_units(block: Block) -> Iterator[Hypothesis]:
    """Yield the theodolite directions and zenith angles, with their a-priori errors, as values in gon."""
    if block.directions:
        changed = replace(block, directions=tuple(map(_from_gon, block.directions)))
        text = (
            "the theodolite directions fit when they are in gon; write degrees: multiply directions, zenith angles and "
            "their a-priori errors by 0.9"
        )
        yield Hypothesis(changed, finding("direction-unit", "control directions", text))


def _from_gon(observed: ControlDirection) -> ControlDirection:
    zenith, error = observed.zenith, observed.zenith_error
    return replace(
        observed,
        direction=observed.direction * DEGREES_PER_GON,
        direction_error=observed.direction_error * DEGREES_PER_GON,
        zenith=None if zenith is None else zenith * DEGREES_PER_GON,
        zenith_error=None if error is None else error * DEGREES_PER_GON,
    )
