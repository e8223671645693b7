"""Given orientations that are wrong: the block as if they had not been given, and how they differ from those found."""

from __future__ import annotations

import numpy as np

from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.after_adjustment.angle_unit import ANGLE_UNITS, angle_unit_text, is_nearer
from orip.mistakes.given_orientations import (
    ComparedOrientations,
    compared_orientations,
    misgiven_orientations,
)
from orip.records.block import Block
from orip.structs import replace


def without_orientations(block: Block) -> Block | None:
    """Return a block without its given orientations; None where none are given, or all are held."""
    given = np.isfinite(block.photo_orientation)
    held = np.array([bool(photo.constant) for photo in block.photos])
    if not given[~held].any():
        return None
    return replace(block, photo_orientation=np.where(held[:, None], block.photo_orientation, np.nan))


def misgiven(solved: SolvedBlock, block: Block) -> list[ProjectWarning]:
    """Return how a few of the orientations given in a block, or their unit, differ from those adjusted."""
    for factor in ANGLE_UNITS:
        if is_nearer(block.photo_orientation[:, 3:], factor, solved.state.rotations):
            return [ProjectWarning("angle-unit", "orip.toml", angle_unit_text(factor))]
    return misgiven_orientations(compared_with_adjusted(solved, block))


def compared_with_adjusted(solved: SolvedBlock, block: Block) -> ComparedOrientations:
    """Compare the orientations given in a block with those of an adjustment."""
    place = solved.block.point_index()
    points = solved.state.points[[place[name] for name in block.point_names]]
    return compared_orientations(block, solved.state.centres, solved.state.rotations, points)
