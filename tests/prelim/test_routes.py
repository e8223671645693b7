"""Ways through a block: they end, whatever becomes of what they begin with."""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.prelim.block_grower import BlockGrower
from orip.prelim.growing_block import empty_growing_block
from orip.prelim.rays import ImageRays, image_rays, photo_index
from orip.prelim.relative.orientation import common_point_counts
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


def test_routes_from_other_pairs_use_the_parts_that_have_grown_before(monkeypatch: pytest.MonkeyPatch):
    rays = image_rays(synthetic_block("convergent", "routes").block)
    shared = grower(rays)
    grown = []
    grow = BlockGrower.grow
    monkeypatch.setattr(BlockGrower, "grow", lambda self, *given: grown.append(self) or grow(self, *given))
    first, again = by_pairs(shared, 0), by_pairs(shared, 0)
    assert len(grown) == len(first.systems) > 0
    for one, other in zip(first.systems, again.systems, strict=True):
        assert one is other
    # another pair begins a block of its own
    another = by_pairs(shared, 1)
    assert another.relative[0].left + another.relative[0].right != first.relative[0].left + first.relative[0].right
    assert len(grown) > len(first.systems)
    # what does not share the parts comes to the same
    alone = by_pairs(grower(rays), 1)
    assert alone.systems[0].centres.tolist() == another.systems[0].centres.tolist()
