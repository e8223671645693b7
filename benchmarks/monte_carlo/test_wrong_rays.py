"""Two wrong rays at one point: both lose weight, or the point is named as one of two places that fit alike."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from monte_carlo.simulated_blocks import design, in_parallel, random_numbers, with_noise
from monte_carlo.starts_study import FLIGHTS

from orip.bundle.methods import adjust_block
from orip.bundle.verdict import TWO_PLACES
from orip.records.block import Block
from orip.solving.solve import PLAIN
from orip.structs import replace

LOG = logging.getLogger(__name__)
WRONG = ("each by itself", "by the same amount", "one coordinate each")
_LEAST_RAYS = 4
_SIZES = 15.0, 60.0
"""Standard errors."""


def simulated(scene: str, run: int, random: np.random.Generator) -> Block:
    if scene == "aerial":
        return with_noise(aerial_block(f"two {run}", 10, FLIGHTS[run % len(FLIGHTS)]), random)
    return with_noise(design(scene, f"two {run}"), random)


def is_named(case: tuple[str, int]) -> bool | None:
    """Return whether the rays, or their point, are named; None where no point of the block has enough rays."""
    scene, run = case
    random = random_numbers(f"two wrong rays {scene}", run)
    block = simulated(scene, run, random)
    points = block.photo_points
    control = {point.name for point in block.control_points}
    rays = np.bincount(points.point)
    many = [k for k, name in enumerate(block.point_names) if rays[k] >= _LEAST_RAYS and name not in control]
    if not many:
        return None
    point = int(random.choice(many))
    wrong = random.choice(np.flatnonzero(points.point == point), 2, replace=False)
    off = points.error[wrong] * random.uniform(*_SIZES, (2, 1))
    kind = WRONG[run % len(WRONG)]
    angle = random.integers(4, size=2) * np.pi / 2.0 if kind == "one coordinate each" else random.uniform(0.0, 7.0, 2)
    off = off * np.column_stack([np.cos(angle), np.sin(angle)])
    if kind == "by the same amount":
        off[1] = off[0]
    xy = points.xy.copy()
    xy[wrong] += off
    solution, solved = adjust_block(
        replace(block, photo_points=replace(points, xy=xy)), PLAIN, lambda _: None, lambda: False
    )
    factors = solved.weight_factors[: xy.size].reshape(-1, 2).min(axis=1)
    places = [one.where for one in solution.diagnosis if one.code == TWO_PLACES]
    return bool((factors[wrong] < 1.0).all()) or places == [f"point {block.point_names[point]}"]


def named(scene: str, runs: int, processes: int) -> tuple[int, int]:
    """Return in how many blocks they are named, and in how many they could be."""
    found = [one for one in in_parallel(is_named, [(scene, run) for run in range(runs)], processes) if one is not None]
    LOG.info("%s: named in %d of %d", scene, sum(found), len(found))
    return sum(found), len(found)


@pytest.mark.parametrize("scene", ["aerial", "convergent"])
def test_two_wrong_rays_are_named(scene: str) -> None:
    found, blocks = named(scene, 6, 1)
    assert found == blocks > 0


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("scene", ["aerial", "convergent"])
def test_two_wrong_rays_are_named_as_often_as_documented(scene: str) -> None:
    found, blocks = named(scene, 170, 2)
    # 137 of 141, and 170 of 170: a right coordinate less may fit as well by chance
    assert found >= 0.96 * blocks
