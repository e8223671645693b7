"""Ways through a block: they end, whatever becomes of what they begin with."""

from __future__ import annotations

import numpy as np
from support.synthetic_block import synthetic_block

from orip.model.preliminary import ImageRays
from orip.prelim.growing import Growth
from orip.prelim.image_rays import image_rays
from orip.prelim.pair_selection import common_point_counts
from orip.prelim.photo_index import photo_index
from orip.prelim.placed import Placed, nothing_placed
from orip.prelim.routes import by_pairs


class LosingGrowth(Growth):
    """Takes out all photos of a system again, as if none fitted its points."""

    def grown(self, start: Placed, enough: float = 0.0) -> Placed:
        """Return a system without photos."""
        return nothing_placed(self.rays)


def losing_growth(rays: ImageRays) -> Growth:
    nothing = np.full((len(rays.points), 3), np.nan)
    everyone = np.ones(len(rays.photos), dtype=bool)
    return LosingGrowth(rays, photo_index(rays), common_point_counts(rays), nothing, everyone)


def test_a_pair_that_was_taken_out_of_its_own_system_does_not_begin_another_one():
    rays = image_rays(synthetic_block("convergent", "routes").block)
    found = by_pairs(losing_growth(rays), 0)
    begun = [{each.left, each.right} for each in found.relative]
    assert len(begun) == len(rays.photos) // 2
    assert len(set.union(*begun)) == 2 * len(begun)
    assert not any(system.oriented.any() for system in found.systems)
