"""Heights from a terrain model: what scatters as the standard deviations say, and points that are not on it.

The figures of the long studies are in docs/verification.md; `--log-cli-level=INFO` shows them.
"""

from __future__ import annotations

import logging

import numpy as np
import pytest
from monte_carlo.simulated_blocks import in_parallel
from monte_carlo.terrain_study import terrain_run, wrong_height_run

LOG = logging.getLogger(__name__)


def scatter(runs: int) -> dict[str, float]:
    """Return sigma0 of the heights and of all observations, and the scatter of the points."""
    found = in_parallel(terrain_run, range(runs), 1)
    shares = {
        "heights": float(np.sqrt(sum(run.square for run in found) / sum(run.redundancy for run in found))),
        "all": float(np.sqrt(np.mean([run.sigma0**2 for run in found]))),
        "points": float(np.sqrt(np.mean([run.differences**2 for run in found]))),
    }
    LOG.info("%d runs: %s", runs, ", ".join(f"{kind} {value:.4f}" for kind, value in shares.items()))
    return shares


def test_sigma0_of_the_heights_is_1():
    found = scatter(20)
    # of 20 runs with a redundancy of 15 each the standard deviation is 4 %
    assert found["heights"] == pytest.approx(1.0, abs=0.12)
    assert found["all"] == pytest.approx(1.0, abs=0.02)
    assert found["points"] == pytest.approx(1.0, abs=0.12)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_sigma0_of_the_heights_is_1_in_200_blocks():
    found = scatter(200)
    assert all(0.97 <= value <= 1.03 for value in found.values())


def named(runs: int) -> tuple[float, float]:
    """Return the share of the wrong heights that are named, and of right observations that are."""
    found = in_parallel(wrong_height_run, range(runs), 1)
    share = sum(run.named for run in found) / runs
    others = sum(run.others for run in found) / sum(run.right for run in found)
    LOG.info("%d blocks: named %.4f; others %.4f %%", runs, share, 100.0 * others)
    return share, others


def test_wrong_heights_are_named():
    share, others = named(20)
    assert share >= 0.95
    assert others <= 0.002


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_wrong_heights_are_named_in_99_percent_of_200_blocks():
    share, others = named(200)
    assert share >= 0.99
    assert others <= 0.002
