"""Blocks with heights from a terrain model: their standard deviations, and points that do not lie on it."""

from __future__ import annotations

import numpy as np
from bundle.kinds.terrain_blocks import terrain_block
from monte_carlo.simulated_blocks import NO_DOWN_WEIGHTING, random_numbers, solved
from msgspec import Struct

from orip.bundle.results.reliability import NON_CENTRALITY
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.bundle.solve import SolvedBlock

LEAST_REDUNDANCY, MINIMAL_SIZES = 0.3, 2.0


class TerrainRun(Struct, frozen=True):
    """Square sums of the residuals of the heights and of all, their redundancies, and normalised differences."""

    square: float
    redundancy: float
    sigma0: float
    differences: np.ndarray


def _heights(found: SolvedBlock) -> slice:
    """Return the rows of the heights on terrain."""
    names = [kind.rows.kind.name for kind in found.problem.observations]
    ends = np.cumsum([0, *(len(kind.rows.error) for kind in found.problem.observations)])
    place = names.index("terrain")
    return slice(int(ends[place]), int(ends[place + 1]))


def terrain_run(run: int) -> TerrainRun:
    """Adjust a block with errors of its own."""
    made = terrain_block(run, **NO_DOWN_WEIGHTING)
    found = solved(made.block)
    rows, columns = _heights(found), found.problem.unknowns.points
    return TerrainRun(
        float(np.sum(found.equations.residual[rows] ** 2)),
        float(np.sum(found.variance.redundancy_numbers[rows])),
        float(found.variance.sigma0),
        # sigma0 is 1 in the mean: the a-priori errors are the true ones
        (found.state.points - made.points) / np.sqrt([np.diag(found.cofactors_of(row)) for row in columns]),
    )


class WrongHeight(Struct, frozen=True):
    """Whether a point off the terrain was named, findings that name none of it, and right observations."""

    named: bool
    others: int
    right: int


def wrong_height_run(run: int) -> WrongHeight:
    """Lift one point off the terrain by twice what is just detectable, and search for it.

    Its images are where it is: only the height of the model is not its own.
    """
    random = random_numbers("terrain, blunders", run)
    clean = solved(terrain_block(run, **NO_DOWN_WEIGHTING).block)
    rows = _heights(clean)
    numbers = clean.variance.redundancy_numbers[rows]
    errors = next(kind for kind in clean.problem.observations if kind.rows.kind.name == "terrain").rows.error
    point = int(random.choice(np.flatnonzero(numbers >= LEAST_REDUNDANCY)))
    size = MINIMAL_SIZES * NON_CENTRALITY * errors[point] / np.sqrt(numbers[point]) * random.choice([-1.0, 1.0])
    spoilt = terrain_block(run, wrong={point: float(size)}, **NO_DOWN_WEIGHTING).block
    found = snoop(spoilt, SnoopingSettings("apriori"), lambda _: None, lambda: False)
    wrong = rows.start + point
    named = [{row for each in (one.rows, *one.alternatives) for row in each} for one in found.findings]
    return WrongHeight(
        any(wrong in rows_ for rows_ in named),
        sum(wrong not in rows_ for rows_ in named),
        int(np.count_nonzero(clean.equations.active)) - 1,
    )
