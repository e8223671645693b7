"""Where the Danish method ends from three starts, in blocks with blunders that hide.

The figures of the long study are in docs/monte-carlo.md; `--log-cli-level=INFO` shows them.
"""

from __future__ import annotations

import logging

import numpy as np
import pytest
from monte_carlo.simulated_blocks import in_parallel
from monte_carlo.starts_study import FEW_RAYS, MOST_ITERATIONS, starts_run
from support.long_cases import every

LOG = logging.getLogger(__name__)


def figures(scene: str, runs: int, processes: int) -> tuple[float, float]:
    """Return in which part of the blocks all starts end in the same set, and in the same robust cost."""
    found = in_parallel(starts_run, [(scene, run) for run in range(runs)], processes)
    iterations = np.array([run.iterations for run in found])
    assert iterations.max() <= MOST_ITERATIONS
    same_set, same_cost = (np.mean([getattr(run, name) for run in found]) for name in ("same_set", "same_cost"))
    LOG.info(
        "%s: %d blocks, the same set in %.1f %%, the same cost in %.1f %%, iterations %.1f, %d, converged %.1f %%",
        *(scene, runs, 100.0 * same_set, 100.0 * same_cost, iterations.mean(), iterations.max()),
        100.0 * np.mean([run.converged for run in found]),
    )
    return float(same_set), float(same_cost)


def test_no_start_takes_more_iterations_than_are_allowed() -> None:
    figures("convergent", 3, 1)


@pytest.mark.parametrize(("scene", "run"), [("terrestrial", 33), ("terrestrial", 95)])
def test_contradicting_rays_are_told_alike_from_every_start(scene: str, run: int) -> None:
    # the wrong ray of three moved the point too far away for an exchange of weights
    found = starts_run((scene, run))
    assert found.same_set
    assert all(found.converged)


@pytest.mark.parametrize("run", every(6, [23, 30, 46, 58, 65, 82]))
def test_neighbours_wrong_together_are_told_alike_from_every_start(run: int) -> None:
    # some in points of two and three rays had turned a photo, and pushed out what is right
    assert starts_run((FEW_RAYS, run)).same_cost


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_blunders_in_points_of_few_rays_end_at_the_same_cost() -> None:
    # of the first 124 blocks 123 do, and 371 of their 372 ends are the lowest known; far below that
    assert figures(FEW_RAYS, 170, 2)[1] >= 0.96


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("scene", ["aerial", "convergent", "terrestrial"])
def test_starts_end_alike_as_often_as_documented(scene: str) -> None:
    same_set, same_cost = figures(scene, 170, 2)
    # three standard deviations below the 98.8 % of the table, from 170 blocks: 0.963
    assert same_set >= 0.95
    assert same_cost >= 0.90
