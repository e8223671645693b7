"""Preliminary rotations in gon or radians: in the right unit they are near those of the adjustment."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_between, rotation_from_angles
from orip.records.block import Block
from orip.records.results.solution import Solution
from orip.units import DEGREES_PER_GON, DEGREES_PER_RADIAN, RADIANS_PER_DEGREE

ANGLE_UNITS = {DEGREES_PER_GON: "gon", DEGREES_PER_RADIAN: "radians"}
"""Names of units by their size in degrees."""

_CLEARLY = 0.5
"""The right unit leaves less than this part of the rotations between preliminary and adjusted photos."""

_FEWEST = 4
"""Number of photos that a unit has to bring nearer, and as many more for each photo that it takes farther away."""


def angles_in_another_unit(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning if the preliminary rotations are near the adjusted ones in gon or radians, and not in degrees.

    Parameters
    ----------
    block : Block
        As gathered: with the rotations that were given, NaN where none were.
    solution : Solution
    """
    centres = solution.photos.values[:, :3]
    adjusted = rotation_from_angles(solution.photos.values[:, 3:] * RADIANS_PER_DEGREE)
    in_frame = np.swapaxes(block.ground.axes_at(centres), 1, 2) @ adjusted
    return [
        ProjectWarning("angle-unit", "orip.toml", angle_unit_text(factor))
        for factor in ANGLE_UNITS
        if is_nearer(block.photo_orientation[:, 3:], factor, in_frame)
    ]


def angle_unit_text(factor: float) -> str:
    """Return what to say of preliminary rotations that are in another unit."""
    return (
        f"the preliminary OMEGA, PHI and KAPPA of the photos fit when they are in {ANGLE_UNITS[factor]}, but angles "
        f"have to be in degrees; multiply them by {factor:.6g}"
    )


def is_nearer(given: FloatArray, factor: float, adjusted: FloatArray) -> bool:
    """Tell whether angles (n, 3), NaN where not given, are near rotations (n, 3, 3) when multiplied by a factor."""
    known = np.isfinite(given).all(axis=1)
    as_given, scaled = (
        angles_between(rotation_from_angles(given[known] * unit), adjusted[known]) for unit in (1.0, factor)
    )
    # of photos that were given roughly, or with small angles, either may be nearer by chance
    clear = np.abs(scaled - as_given) > _CLEARLY * np.minimum(scaled, as_given)
    nearer, farther = np.count_nonzero(clear & (scaled < as_given)), np.count_nonzero(clear & (scaled > as_given))
    if nearer < _FEWEST * (1 + farther):
        return False
    return bool(np.median(scaled[clear]) < _CLEARLY * np.median(as_given[clear]))
