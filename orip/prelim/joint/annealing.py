"""Adjustment of a block whose parts are still far out of place."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray
from orip.prelim.growing.block_grower import BlockGrower
from orip.prelim.growing.growing_block import GrowingBlock, growing_block_of
from orip.prelim.growing.misplaced_photos import residual_lengths
from orip.prelim.refinement.refinement import ROUGH
from orip.records.results.preliminary import PartialBlock
from orip.structs import replace

_NARROWER = 10.0
"""Ratio of the limits for blunders from one adjustment to the next."""


def annealed(held: BlockGrower, placed: PartialBlock, wanted: BoolArray, how: str) -> GrowingBlock:
    """Return a block that is roughly placed after adjustments in which no ray is a blunder at first.

    Parts fit in themselves, so that the few points that tie them would lose their weight while the parts are still out
    of place (graduated non-convexity, Blake and Zisserman 1987). The adjustment by the a-priori errors comes when the
    block grows.

    Parameters
    ----------
    held : BlockGrower
        With the control that holds the block.
    placed : PartialBlock
        On the ground.
    wanted : array (number of photos,) of bool
        Other photos have helped to place the block, and are left out now.
    how : str
        How the photos were oriented.
    """
    start = growing_block_of(held.rays, placed, how)
    start = replace(start, coordinates=np.where(held.held_points[:, None], held.held, start.coordinates))
    start = start.without_photos(~wanted)
    lengths = residual_lengths(held.seen(start), start)
    factor = float(lengths[np.isfinite(lengths)].max(initial=0.0))
    while factor > 1.0:
        rays = replace(held.rays, error=factor * held.rays.error)
        start = replace(held, rays=rays).refined(start, ROUGH)
        factor /= _NARROWER
    return start
