"""Antennas are found again without bias, and scatter as their standard deviations say; wrong stations are named.

The figures of the long studies are in docs/monte-carlo.md; `--log-cli-level=INFO` shows them.
"""

from __future__ import annotations

import logging
from typing import get_args

import numpy as np
import pytest
from monte_carlo.simulated_blocks import in_parallel
from monte_carlo.stations_study import Design, antenna_errors, wrong_stations
from scipy import stats

LOG = logging.getLogger(__name__)

FAMILY = 0.001
"""Of the tests of all unknowns of a study together (Bonferroni)."""


def check_scatter_and_bias(design: Design, runs: int, processes: int) -> None:
    errors = np.array(in_parallel(antenna_errors, [(design, run) for run in range(runs)], processes))
    squares, mean = np.sum(errors**2, axis=0), errors.mean(axis=0) * np.sqrt(runs)
    scatter = 2.0 * np.minimum(stats.chi2.cdf(squares, runs), stats.chi2.sf(squares, runs))
    bias = 2.0 * stats.norm.sf(np.abs(mean))
    LOG.info(
        "%s: %d runs, %d unknowns, scatter / sd %.4f (%.3f to %.3f), smallest p %.2g, of bias %.2g",
        *(
            design,
            runs,
            len(scatter),
            np.sqrt(np.mean(errors**2)),
            *np.sqrt(squares / runs)[[squares.argmin(), squares.argmax()]],
        ),
        *(scatter.min(), bias.min()),
    )
    assert scatter.min() > FAMILY / len(scatter)
    assert bias.min() > FAMILY / len(bias)


def check_wrong_stations(runs: int, processes: int) -> None:
    found = in_parallel(wrong_stations, list(range(runs)), processes)
    planted, right = sum(run.planted for run in found), sum(run.right for run in found)
    named, others = sum(run.named for run in found), sum(run.others for run in found)
    LOG.info("%d of %d wrong stations named, %d of %d others", named, planted, others, right)
    assert named >= 0.99 * planted
    assert others <= 0.002 * right


@pytest.mark.parametrize("design", get_args(Design))
def test_antennas_are_found_again_as_well_as_their_standard_deviations_say(design: Design) -> None:
    check_scatter_and_bias(design, 25, 1)


def test_wrong_stations_are_named_and_little_else() -> None:
    check_wrong_stations(12, 1)


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("design", get_args(Design))
def test_antennas_in_1000_blocks(design: Design) -> None:
    check_scatter_and_bias(design, 1000, 2)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_500_wrong_stations() -> None:
    check_wrong_stations(250, 2)
