"""Heights on terrain and given directions: what scatters as the standard deviations say, and wrong ones that are named.

The figures of the long studies are in docs/verification.md; `--log-cli-level=INFO` shows them.
"""

from __future__ import annotations

import logging

import numpy as np
import pytest
from monte_carlo.observations_study import KINDS, scatter_run, wrong_run
from monte_carlo.simulated_blocks import in_parallel

LOG = logging.getLogger(__name__)


def scatter(kind: str, runs: int) -> dict[str, float]:
    """Return sigma0 of a kind of observation and of all, and the scatter of the points."""
    found = in_parallel(scatter_run, [(kind, run) for run in range(runs)], 1)
    shares = {
        "kind": float(np.sqrt(sum(run.square for run in found) / sum(run.redundancy for run in found))),
        "all": float(np.sqrt(np.mean([run.sigma0**2 for run in found]))),
        "points": float(np.sqrt(np.mean([run.differences**2 for run in found]))),
    }
    LOG.info("%s, %d runs: %s", kind, runs, ", ".join(f"{name} {value:.4f}" for name, value in shares.items()))
    return shares


@pytest.mark.parametrize("kind", KINDS)
def test_sigma0_of_a_kind_is_1(kind):
    found = scatter(kind, 20)
    # of 20 runs with a redundancy of 8 or 15 each the standard deviation is 6 or 4 %
    assert found["kind"] == pytest.approx(1.0, abs=0.18)
    assert found["all"] == pytest.approx(1.0, abs=0.02)
    # what control says of the whole block is in all points: 140 errors of movements
    assert found["points"] == pytest.approx(1.0, abs=0.18)


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("kind", KINDS)
def test_sigma0_of_a_kind_is_1_in_1000_blocks(kind):
    found = scatter(kind, 1000)
    # with a redundancy of 8 each it is 0.8 %
    assert found["kind"] == pytest.approx(1.0, abs=0.03)
    assert 0.97 <= found["all"] <= 1.03
    # what control says of the whole block is in all points: of the 7000 errors of movements it is 0.8 %
    assert found["points"] == pytest.approx(1.0, abs=0.03)


def named(kind: str, runs: int) -> tuple[float, float]:
    """Return the share of the wrong observations that are named, and of right ones that are."""
    found = in_parallel(wrong_run, [(kind, run) for run in range(runs)], 1)
    share = sum(run.named for run in found) / runs
    others = sum(run.others for run in found) / sum(run.right for run in found)
    LOG.info("%s, %d blocks: named %.4f; others %.4f %%", kind, runs, share, 100.0 * others)
    return share, others


@pytest.mark.parametrize("kind", KINDS)
def test_wrong_observations_are_named(kind):
    share, others = named(kind, 10)
    assert share >= 0.9
    assert others <= 0.002


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("kind", KINDS)
def test_wrong_observations_are_named_in_99_percent_of_200_blocks(kind):
    share, others = named(kind, 200)
    assert share >= 0.99
    assert others <= 0.002
