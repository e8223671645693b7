"""Blunders of all kinds at twice their minimal detectable size: what snooping names.

The figures of the long study are in docs/monte-carlo.md; `--log-cli-level=INFO` shows them.
"""

from __future__ import annotations

import logging

import pytest
from monte_carlo.kinds_study import KINDS, Sigma0, kind_run
from monte_carlo.simulated_blocks import in_parallel

LOG = logging.getLogger(__name__)


def figures(sigma0: Sigma0, runs: int, processes: int) -> tuple[dict[str, float], float]:
    """Return the share of the wrong observations of each kind that are named, and of the others."""
    found = in_parallel(kind_run, [(run, sigma0) for run in range(runs)], processes)
    named, first = {}, {}
    for kind in KINDS:
        of_kind = [run for run in found if kind in run.named]
        named[kind] = sum(run.named[kind] for run in of_kind) / len(of_kind)
        first[kind] = sum(run.left_out[kind] for run in of_kind) / len(of_kind)
        LOG.info(
            "%s, %s: %d wrong, named %.2f %%, left out %.2f %%",
            *(sigma0, kind, len(of_kind), 100.0 * named[kind], 100.0 * first[kind]),
        )
    others = sum(run.others for run in found) / sum(run.right for run in found)
    LOG.info("%s: others %.4f %% of %d", sigma0, 100.0 * others, sum(run.right for run in found))
    return named, others


def test_blunders_of_every_kind_are_named_and_little_else() -> None:
    named, others = figures("apriori", 12, 1)
    # one of some 80 blunders may be missed
    assert sum(named.values()) >= len(KINDS) - 1.0 / 12.0
    assert others <= 0.002


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("sigma0", ["apriori", "posteriori"])
def test_blunders_of_every_kind_are_named_in_99_percent_of_1000_blocks(sigma0: Sigma0) -> None:
    named, others = figures(sigma0, 1000, 2)
    assert min(named.values()) >= 0.99
    assert others <= 0.002
