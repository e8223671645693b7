"""Blocks with heights on terrain, or given directions: their standard deviations, and wrong ones among them."""

from __future__ import annotations

import numpy as np
from bundle.kinds.direction_blocks import direction_block
from bundle.kinds.terrain_blocks import terrain_block
from monte_carlo.simulated_blocks import NO_DOWN_WEIGHTING, random_numbers, solved
from msgspec import Struct

from orip.bundle.results.reliability import NON_CENTRALITY
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.bundle.solve import SolvedBlock
from orip.records.block import Block

KINDS = ("terrain", "given direction")
LEAST_REDUNDANCY, MINIMAL_SIZES = 0.3, 2.0


class ScatterRun(Struct, frozen=True):
    """Square sum of the residuals of a kind and their redundancy, sigma0 of all, and normalised differences."""

    square: float
    redundancy: float
    sigma0: float
    differences: np.ndarray


def _rows(found: SolvedBlock, kind: str) -> slice:
    """Return the rows of a kind of observation."""
    names = [part.rows.kind.name for part in found.problem.observations]
    ends = np.cumsum([0, *(len(part.rows.error) for part in found.problem.observations)])
    place = names.index(kind)
    return slice(int(ends[place]), int(ends[place + 1]))


def scatter_run(task: tuple[str, int]) -> ScatterRun:
    """Adjust a block with errors of its own; the task is a kind and the number of a run."""
    kind, run = task
    made = (terrain_block if kind == "terrain" else direction_block)(run, **NO_DOWN_WEIGHTING)
    found = solved(made.block)
    rows, columns = _rows(found, kind), found.problem.unknowns.points
    return ScatterRun(
        float(np.sum(found.equations.residual[rows] ** 2)),
        float(np.sum(found.variance.redundancy_numbers[rows])),
        float(found.variance.sigma0),
        # sigma0 is 1 in the mean: the a-priori errors are the true ones
        (found.state.points - made.points) / np.sqrt([np.diag(found.cofactors_of(row)) for row in columns]),
    )


class WrongRun(Struct, frozen=True):
    """Whether the wrong observation was named, findings that do not name it, and right observations."""

    named: bool
    others: int
    right: int


def wrong_run(task: tuple[str, int]) -> WrongRun:
    """Make one observation wrong by twice what is just detectable, and search for it.

    A point is lifted off the terrain with its images, so that the height of the model alone is not its own; a
    direction is turned to a side.
    """
    kind, run = task
    random = random_numbers(f"{kind}, blunders", run)
    clean = solved((terrain_block if kind == "terrain" else direction_block)(run, **NO_DOWN_WEIGHTING).block)
    rows = _rows(clean, kind)
    numbers = clean.variance.redundancy_numbers[rows]
    errors = next(part for part in clean.problem.observations if part.rows.kind.name == kind).rows.error
    row = int(random.choice(np.flatnonzero(numbers >= LEAST_REDUNDANCY))) if kind == "terrain" else 0
    size = float(MINIMAL_SIZES * NON_CENTRALITY * errors[row] / np.sqrt(numbers[row]) * random.choice([-1.0, 1.0]))
    found = snoop(_spoilt(kind, run, row, size), SnoopingSettings("apriori"), lambda _: None, lambda: False)
    named = [{one for each in (finding.rows, *finding.alternatives) for one in each} for finding in found.findings]
    wrong = rows.start + row
    return WrongRun(
        any(wrong in each for each in named),
        sum(wrong not in each for each in named),
        int(np.count_nonzero(clean.equations.active)) - 1,
    )


def _spoilt(kind: str, run: int, row: int, size: float) -> Block:
    if kind == "terrain":
        return terrain_block(run, wrong={row: size}, **NO_DOWN_WEIGHTING).block
    return direction_block(run, wrong=size, **NO_DOWN_WEIGHTING).block
