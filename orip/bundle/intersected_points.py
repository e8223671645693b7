"""Points placed anew where the rays of a state meet: where a step has gone too far, it is points that are worst off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orip.bundle.state import State
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rays import intersect_rays
from orip.interior.image_vectors import image_vectors
from orip.records.block import Block


def with_intersected_points(block: Block, state: State, unknowns: Unknowns) -> State:
    """Return a state with the points that photos alone determine at the intersection of their rays.

    The cameras are those that the block starts with: this is for states that are far from the solution.
    """
    points = block.photo_points
    directions = (state.rotations[points.photo] @ image_vectors(block)[:, :, None])[:, :, 0]
    seen = points.used.all(axis=1) & np.isfinite(directions).all(axis=1)
    found = intersect_rays(
        state.centres[points.photo[seen]], directions[seen], points.point[seen], len(block.point_names)
    )
    observed = {point.name for point in block.control_points}
    observed |= {each.name for each in block.elements if each.group == "POINT"}
    free = (unknowns.points >= unknowns.layout.reduced).all(axis=1) & (unknowns.points != CONSTANT).all(axis=1)
    free &= np.array([name not in observed for name in block.point_names], dtype=bool)
    free &= np.isfinite(found).all(axis=1)
    return replace(state, points=np.where(free[:, None], found, state.points))
