"""Points of a block with a drifting receiver, by stations alone and with relative control, scatter as they say.

The figures of the long study are in docs/monte-carlo.md; `--log-cli-level=INFO` shows them.
"""

from __future__ import annotations

import logging

import numpy as np
import pytest
from monte_carlo.relative_study import point_errors, wrong_difference
from monte_carlo.simulated_blocks import in_parallel

LOG = logging.getLogger(__name__)


def scatter(runs: int, processes: int, *, with_differences: bool) -> tuple[float, np.ndarray, np.ndarray]:
    """Return errors over standard deviations, and both in each coordinate: root mean squares."""
    found = in_parallel(point_errors, [(run, with_differences) for run in range(runs)], processes)
    error, sd = (np.concatenate([getattr(run, name) for run in found]) for name in ("error", "sd"))
    ratio = float(np.sqrt(np.mean((error / sd) ** 2)))
    of_error, of_sd = (np.sqrt(np.mean(values**2, axis=0)) for values in (error, sd))
    LOG.info("differences %s: error / sd %.3f, errors %s, sd %s", with_differences, ratio, of_error, of_sd)
    return ratio, of_error, of_sd


def check(runs: int, processes: int, tolerance: float) -> None:
    alone, error_alone, sd_alone = scatter(runs, processes, with_differences=False)
    both, error, sd = scatter(runs, processes, with_differences=True)
    assert alone == pytest.approx(1.0, abs=tolerance)
    assert both == pytest.approx(1.0, abs=tolerance)
    # heights gain most: pitch and roll of a strip hold together
    assert sd[2] < 0.5 * sd_alone[2]
    assert error[2] < 0.6 * error_alone[2]


def test_points_scatter_as_they_say_with_and_without_differences() -> None:
    check(2, 1, 0.6)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_points_of_many_blocks_scatter_as_they_say() -> None:
    check(200, 2, 0.1)


def test_a_wrong_difference_is_named() -> None:
    found = [wrong_difference(run) for run in range(2)]
    assert all(named for named, _ in found)
    assert sum(others for _, others in found) <= 1
