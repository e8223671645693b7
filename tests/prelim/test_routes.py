"""Ways through a block: they end, whatever becomes of what they begin with."""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.prelim.growing.block_grower import BlockGrower
from orip.prelim.growing.growing_block import empty_growing_block
from orip.prelim.rays.image_rays import ImageRays, image_rays
from orip.prelim.rays.photo_index import photo_index
from orip.prelim.relative.pair_selection import common_point_counts
from orip.prelim.routes import by_pairs


def grower(rays: ImageRays) -> BlockGrower:
    """Return what grows with nothing held."""
    nothing = np.full((len(rays.points), 3), np.nan)
    everyone = np.ones(len(rays.photos), dtype=bool)
    return BlockGrower(rays, photo_index(rays), common_point_counts(rays), nothing, everyone)


def test_a_pair_that_was_taken_out_of_its_own_system_does_not_begin_another_one(monkeypatch: pytest.MonkeyPatch):
    rays = image_rays(synthetic_block("convergent", "routes").block)
    # as if no photo fitted its points
    monkeypatch.setattr(BlockGrower, "grow", lambda self, *_: empty_growing_block(self.rays))
    found = by_pairs(grower(rays), 0)
    begun = [{model.left, model.right} for model in found.relative]
    assert len(begun) == len(rays.photos) // 2
    assert len(set.union(*begun)) == 2 * len(begun)
    assert not any(system.oriented.any() for system in found.systems)
