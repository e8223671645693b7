"""Preliminary rotations and theodolite directions in gon or radians."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_between, rotation_from_angles
from orip.mistakes.hypothesis import Hypothesis, finding
from orip.records.block import Block
from orip.records.observations.control import ControlDirection
from orip.records.results.solution import Solution
from orip.structs import replace
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


def angle_units(block: Block) -> Iterator[Hypothesis]:
    """Yield the preliminary rotations as angles in other units than degrees."""
    for factor in ANGLE_UNITS:
        orientation = block.photo_orientation * [1.0, 1.0, 1.0, factor, factor, factor]
        changed = replace(block, photo_orientation=orientation)
        near = partial(_is_near, given=block.photo_orientation[:, 3:], factor=factor)
        found = finding("angle-unit", "orip.toml", angle_unit_text(factor))
        yield Hypothesis(changed, found, near, concerns_start=True)


def _is_near(solved: SolvedBlock, given: FloatArray, factor: float) -> bool:
    return is_nearer(given, factor, solved.state.rotations)


def direction_units(block: Block) -> Iterator[Hypothesis]:
    """Yield the theodolite directions and zenith angles, with their a-priori errors, as values in gon."""
    if block.directions:
        changed = replace(block, directions=tuple(map(_from_gon, block.directions)))
        text = (
            "the theodolite directions fit when they are in gon; write degrees: multiply directions, zenith angles and "
            "their a-priori errors by 0.9"
        )
        yield Hypothesis(changed, finding("direction-unit", "control directions", text))


def _from_gon(observed: ControlDirection) -> ControlDirection:
    zenith, error = observed.zenith, observed.zenith_error
    return replace(
        observed,
        direction=observed.direction * DEGREES_PER_GON,
        direction_error=observed.direction_error * DEGREES_PER_GON,
        zenith=None if zenith is None else zenith * DEGREES_PER_GON,
        zenith_error=None if error is None else error * DEGREES_PER_GON,
    )
