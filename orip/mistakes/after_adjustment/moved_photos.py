"""Photos found far from where they were given by an adjustment that fits: two exchanged, or one given wrong."""

from __future__ import annotations

import numpy as np

from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.fit_comparison import Fit, is_good
from orip.mistakes.given_orientations import compared_orientations, misgiven_orientations
from orip.records.block import Block


def moved_photos(block: Block, solved: SolvedBlock, fit: Fit) -> list[ProjectWarning]:
    """Return a warning for each photo given far from where the adjustment puts it; none if the adjustment fits badly.

    Parameters
    ----------
    block : Block
        As gathered.
    solved : SolvedBlock
    fit : Fit
        Of the adjustment.
    """
    if not np.isfinite(block.photo_orientation).any() or not is_good(fit):
        return []
    state, points = solved.state, solved.state.points
    if solved.block.point_names != block.point_names:
        place = solved.block.point_index()
        points = points[[place[name] for name in block.point_names]]
    return misgiven_orientations(compared_orientations(block, state.centres, state.rotations, points))
