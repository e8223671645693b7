"""Blocks with blunders of the kinds that hide, adjusted from three starts: where does the Danish method end?

Up to 8 % of the photo points are wrong: one coordinate by 10 to 60 a-priori errors; a neighbour measured in place of
the point; two to four neighbours in a photo wrong by the same amount; both coordinates of a point with the fewest rays.
Or 8 % of them are, all in points of few rays.
Nothing is asked of the redundancy numbers.
"""

from __future__ import annotations

import numpy as np
from bundle.aerial_block import Flight, aerial_block
from monte_carlo.simulated_blocks import design, random_numbers, solved, started_off, with_noise
from msgspec import Struct

from orip.records.block import Block
from orip.structs import replace

STARTS = (0.0, 0.0015, 0.0075)
"""Errors of the starting values, as a part of the distance to the object, and in radians."""

MOST_ITERATIONS = 60
"""As where nothing is said."""

_SAME_COST = 1e-4

FEW_RAYS, _FEW = "few rays", 3
"""Aerial blocks with 8 % of the photo points wrong, all of them in points of two and three rays."""

FLIGHTS = tuple(
    Flight(strips, photos, 0.6, 0.3, 2) for strips, photos in ((1, 5), (2, 3), (2, 4), (3, 4), (2, 8), (4, 5))
)
_KINDS = ("size", "size", "misidentified", "clustered", "leverage")


class StartsRun(Struct, frozen=True):
    """What one block ended in from each of the three starts.

    Attributes
    ----------
    down_weighted : tuple of frozenset
        Rows with a weight factor below 1.
    costs : tuple of float
        Robust costs.
    iterations : tuple of int
    converged : tuple of bool
    """

    down_weighted: tuple[frozenset[int], ...]
    costs: tuple[float, ...]
    iterations: tuple[int, ...]
    converged: tuple[bool, ...]

    @property
    def same_set(self) -> bool:
        return len(set(self.down_weighted)) == 1

    @property
    def same_cost(self) -> bool:
        return max(self.costs) <= (1.0 + _SAME_COST) * min(self.costs)


def starts_run(case: tuple[str, int]) -> StartsRun:
    scene, run = case
    random = random_numbers(f"starts {scene}", run)
    settings = {"max_iterations": MOST_ITERATIONS, "start_down_weight": 2}
    if scene == FEW_RAYS:
        made = aerial_block(f"starts {run}", 10, FLIGHTS[run % len(FLIGHTS)], **settings)
        block = with_hidden_blunders(with_noise(made, random), random, 0.08, _FEW)
    else:
        made = design(scene, f"starts {run}", **settings)
        block = with_hidden_blunders(with_noise(made, random), random, random.uniform(0.01, 0.08))
    ends = [solved(started_off(block, made, relative, random)) for relative in STARTS]
    return StartsRun(
        down_weighted=tuple(frozenset(np.flatnonzero(end.weight_factors < 1.0).tolist()) for end in ends),
        costs=tuple(end.robust_cost for end in ends),
        iterations=tuple(len(end.iterations) for end in ends),
        converged=tuple(end.converged for end in ends),
    )


def with_hidden_blunders(
    block: Block, random: np.random.Generator, share: float, most_rays: int | None = None
) -> Block:
    """Return the block with a share of its photo points wrong; `most_rays` are those of the points they are in."""
    points = block.photo_points
    xy, wrong = points.xy.copy(), np.zeros(len(points.photo), dtype=bool)
    wanted = max(1, round(share * len(wrong)))
    rays = np.bincount(points.point)[points.point]
    hidden = np.ones(len(wrong), dtype=bool) if most_rays is None else rays <= most_rays
    while np.count_nonzero(wrong) < wanted and (hidden & ~wrong).any():
        kind = random.choice(_KINDS)
        free = np.flatnonzero(~wrong & hidden)
        row = int(random.choice(free))
        size = random.uniform(10.0, 60.0) * points.error[row]
        neighbours = _neighbours(points.photo, xy, row)
        if kind == "size":
            axis = random.integers(2)
            xy[row, axis] += size[axis] * random.choice([-1.0, 1.0])
        elif kind == "misidentified":
            xy[row] = xy[neighbours[0]] + points.error[row] * random.normal(size=2)
        elif kind == "clustered":
            row = [*neighbours[: random.integers(1, 4)].tolist(), row]
            direction = random.uniform(0.0, 2.0 * np.pi)
            xy[row] += size * [np.cos(direction), np.sin(direction)]
        else:
            row = int(random.choice(free[rays[free] == rays[free].min()]))
            xy[row] += size * random.choice([-1.0, 1.0], 2)
        wrong[row] = True
    return replace(block, photo_points=replace(points, xy=xy))


def _neighbours(photo: np.ndarray, xy: np.ndarray, row: int) -> np.ndarray:
    """Return the other points of a photo, the nearest first."""
    others = np.flatnonzero((photo == photo[row]) & (np.arange(len(photo)) != row))
    return others[np.argsort(np.linalg.norm(xy[others] - xy[row], axis=1))]
