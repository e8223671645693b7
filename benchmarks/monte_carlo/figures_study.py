"""Blocks with points on figures: their standard deviations, and points off by twice the minimal detectable size."""

from __future__ import annotations

import numpy as np
from bundle.figure_blocks import figure_block
from monte_carlo.simulated_blocks import NO_DOWN_WEIGHTING, random_numbers, solved
from msgspec import Struct

from orip.bundle.results.reliability import NON_CENTRALITY
from orip.bundle.snooping.search import SnoopingSettings, snoop

FIGURES = {"line": "EDGE", "plane": "ROOF", "cylinder": "TANK", "height": "LAKE"}
"""Kinds of observation, and the figures of the blocks."""

LEAST_REDUNDANCY, MINIMAL_SIZES = 0.3, 2.0


class FigureRun(Struct, frozen=True):
    """Square sum of the residuals of each kind, their redundancy, and normalised differences from the truth."""

    squares: dict[str, float]
    redundancy: dict[str, float]
    sigma0: float
    differences: np.ndarray


def figure_run(run: int) -> FigureRun:
    """Adjust a block with errors of its own."""
    made = figure_block(run, **NO_DOWN_WEIGHTING)
    found = solved(made.block)
    squares, redundancy, first = {}, {}, 0
    for kind in found.problem.observations:
        rows = slice(first, first + len(kind.rows.error))
        first = rows.stop
        squares[kind.rows.kind.name] = float(np.sum(found.equations.residual[rows] ** 2))
        redundancy[kind.rows.kind.name] = float(np.sum(found.variance.redundancy_numbers[rows]))
    points = [made.block.point_index()[one.point] for one in made.block.figure_points]
    columns = found.problem.unknowns.points[points]
    # sigma0 is 1 in the mean: the a-priori errors are the true ones
    sd = np.sqrt(found.cofactors.reduced.diagonal()[columns])
    return FigureRun(
        squares, redundancy, float(found.variance.sigma0),
        (found.state.points[points] - made.points[points]) / sd,
    )  # fmt: skip


class BlunderRun(Struct, frozen=True):
    """Kind of each wrong point, whether it was named, and findings that name none of them; right observations."""

    named: dict[str, bool]
    others: int
    right: int


def blunder_run(run: int) -> BlunderRun:
    """Move one point of each figure off it by twice what is just detectable, and search for the wrong ones.

    Its images are where it is: only the distance from the figure is wrong.
    """
    random = random_numbers("figures, blunders", run)
    made = figure_block(run, **NO_DOWN_WEIGHTING)
    clean = solved(made.block)
    kinds = np.array([part.kind.name for one in clean.problem.observations for part in [one.rows] for _ in part.photo])
    errors = np.concatenate([one.rows.error for one in clean.problem.observations])
    numbers = clean.variance.redundancy_numbers
    wrong, moved = {}, {}
    for kind, figure in FIGURES.items():
        row = int(random.choice(np.flatnonzero((kinds == kind) & (numbers >= LEAST_REDUNDANCY))))
        size = MINIMAL_SIZES * NON_CENTRALITY * errors[row] / np.sqrt(numbers[row]) * random.choice([-1.0, 1.0])
        wrong[kind] = row
        moved[figure] = (row - int(np.flatnonzero(kinds == kind)[0]), float(size))
    spoilt = figure_block(run, wrong=moved, **NO_DOWN_WEIGHTING).block
    found = snoop(spoilt, SnoopingSettings("apriori"), lambda _: None, lambda: False)
    named = [{row for rows in (one.rows, *one.alternatives) for row in rows} for one in found.findings]
    return BlunderRun(
        {kind: any(row in rows for rows in named) for kind, row in wrong.items()},
        sum(rows.isdisjoint(wrong.values()) for rows in named),
        int(np.count_nonzero(clean.equations.active)) - len(wrong),
    )
