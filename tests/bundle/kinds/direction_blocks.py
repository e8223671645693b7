"""Blocks with given directions between points, which are off the true ones by errors of the a-priori size."""

from __future__ import annotations

import numpy as np
from bundle.figure_blocks import figure_block
from support.synthetic_block import SyntheticBlock

from orip.records.control import GivenDirection
from orip.structs import replace

DIRECTION_ERROR = 0.01
PAIRS = (("N1", "N2"), ("N3", "N5"), ("N6", "N7"), ("N9", "N10"), ("N11", "N13"))


def direction_block(
    run: int = 1, wrong: float = 0.0, error: float = DIRECTION_ERROR, **settings: object
) -> SyntheticBlock:
    """Return the block of eight convergent photos with five directions; `wrong` (degrees) turns the first to a side."""
    made = figure_block(run, (), **settings)
    random = np.random.default_rng([5, run])
    place, lines = made.block.point_index(), []
    for number, (start, end) in enumerate(PAIRS):
        along = made.points[place[end]] - made.points[place[start]]
        unit = along / np.linalg.norm(along)
        off = np.radians(DIRECTION_ERROR) * random.normal(size=3)
        if number == 0:
            off = off + np.radians(wrong) * np.cross(unit, [0.0, 0.0, 1.0]) / np.linalg.norm(unit[:2])
        turned = unit + off - (off @ unit) * unit
        lines.append(GivenDirection(f"E{number}", start, end, tuple((7.0 * turned).tolist()), error))
    return replace(made, block=replace(made.block, given_directions=tuple(lines)))
