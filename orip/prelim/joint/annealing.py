"""Adjustment of a block whose parts are still far out of place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.prelim.growing.block_grower import BlockGrower
from orip.prelim.growing.growing_block import GrowingBlock, growing_block_of
from orip.prelim.growing.misplaced_photos import residual_lengths
from orip.prelim.joint.placing import place_parts
from orip.prelim.similarity.partial_blocks import assembled
from orip.records.results.preliminary import PartialBlock
from orip.structs import replace

_NARROWER = 10.0
"""Ratio of the limits for blunders from one adjustment to the next."""


def placed_together(
    held: BlockGrower, parts: Sequence[PartialBlock], known: FloatArray, wanted: BoolArray, how: str
) -> GrowingBlock | None:
    """Return levelled parts as one block on the ground, adjusted; None where they do not determine each other.

    Parameters
    ----------
    held : BlockGrower
        With the control that holds the block.
    parts : sequence of PartialBlock
    known : array (number of points, 3)
        Control, also that known in part; NaN where not known.
    wanted : array (number of photos,) of bool
        Other photos help to place the parts, and are left out then.
    how : str
        How the photos were oriented.
    """
    placed = place_parts(parts, known)
    if placed is None:
        return None
    start = growing_block_of(held.rays, assembled(placed), how)
    start = replace(start, coordinates=np.where(held.held_points[:, None], held.held, start.coordinates))
    return _annealed(held, start.without_photos(~wanted))


def _annealed(held: BlockGrower, start: GrowingBlock) -> GrowingBlock:
    """Return a block after adjustments in which no ray is a blunder at first.

    Parts fit in themselves, so that the few points that tie them would lose their weight while the parts are still out
    of place (graduated non-convexity, Blake and Zisserman 1987).
    """
    lengths = residual_lengths(held.seen(start), start)
    finite = lengths[np.isfinite(lengths)]
    factor = float(finite.max(initial=0.0))
    while factor > 1.0:
        rays = replace(held.rays, error=factor * held.rays.error)
        start = replace(held, rays=rays).refined(start, 0.0)
        factor /= _NARROWER
    return held.refined(start, 0.0)
