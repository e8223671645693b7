"""Points on figures: what scatters as the standard deviations say, and wrong points that data snooping names.

The figures of the long studies are in docs/verification.md; `--log-cli-level=INFO` shows them.
"""

from __future__ import annotations

import logging

import numpy as np
import pytest
from monte_carlo.figures_study import FIGURES, blunder_run, figure_run
from monte_carlo.simulated_blocks import in_parallel

LOG = logging.getLogger(__name__)


def scatter(runs: int) -> dict[str, float]:
    """Return sigma0 of each kind of observation and of all, and the scatter of coordinates of points on figures."""
    found = in_parallel(figure_run, range(runs), 1)
    kinds = {
        kind: float(np.sqrt(sum(run.squares[kind] for run in found) / sum(run.redundancy[kind] for run in found)))
        for kind in ("photo", "control", *FIGURES)
    }
    kinds["all"] = float(np.sqrt(np.mean([run.sigma0**2 for run in found])))
    kinds["points"] = float(np.sqrt(np.mean([run.differences**2 for run in found])))
    LOG.info("%d runs: %s", runs, ", ".join(f"{kind} {value:.4f}" for kind, value in kinds.items()))
    return kinds


def test_sigma0_of_each_kind_is_1():
    found = scatter(20)
    # the standard deviation of sigma0 of 20 runs with a redundancy of 4 each is 8 %
    for kind in FIGURES:
        assert found[kind] == pytest.approx(1.0, abs=0.25)
    assert found["all"] == pytest.approx(1.0, abs=0.02)
    # what control says of the whole block is in all points: 140 errors of movements
    assert found["points"] == pytest.approx(1.0, abs=0.18)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_sigma0_of_each_kind_is_1_in_200_blocks():
    found = scatter(200)
    for kind in ("all", "photo", "points"):
        assert 0.97 <= found[kind] <= 1.03
    # of 200 runs with a redundancy of 4 it is 2.5 %
    for kind in FIGURES:
        assert found[kind] == pytest.approx(1.0, abs=0.08)


def named(runs: int) -> tuple[dict[str, float], float]:
    """Return the share of the wrong points of each kind that are named, and of right observations that are."""
    found = in_parallel(blunder_run, range(runs), 1)
    shares = {kind: sum(run.named[kind] for run in found) / runs for kind in FIGURES}
    others = sum(run.others for run in found) / sum(run.right for run in found)
    LOG.info("%d blocks: named %s; others %.4f %%", runs, shares, 100.0 * others)
    return shares, others


def test_wrong_points_are_named():
    shares, others = named(5)
    assert sum(shares.values()) >= 4.0 - 0.2
    assert others <= 0.002


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_wrong_points_are_named_in_99_percent_of_200_blocks():
    shares, others = named(200)
    assert min(shares.values()) >= 0.99
    assert others <= 0.002
