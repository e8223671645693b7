"""Reliability figures from redundancy numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from orip.bundle.results.reliability import NON_CENTRALITY, reliability
from orip.records.results.solution import Residuals


def residuals(number, factor, a_priori):
    count = len(number)
    nothing = np.zeros(count)
    empty = ("",) * count
    return Residuals(
        ("photo",) * count, empty, empty, ("x",) * count, nothing, nothing, np.array(a_priori), nothing,
        np.array(factor), np.array(number), nothing,
    )  # fmt: skip


def test_non_centrality_of_alpha_one_thousandth_and_power_four_fifths():
    assert stats.norm.isf(0.0005) + stats.norm.isf(0.2) == pytest.approx(NON_CENTRALITY, abs=5e-4)


def test_internal_and_external_reliability():
    found = reliability(residuals([0.25, 1.0], [1.0, 1.0], [0.005, 0.01]), 2.0)
    assert found.minimal_detectable_bias == pytest.approx([4.132 * 0.005 / 0.5, 4.132 * 0.01])
    assert found.external == pytest.approx([4.132 * np.sqrt(3.0), 0.0])
    assert found.adjusted_sd == pytest.approx([2.0 * 0.005 * np.sqrt(0.75), 0.0])


def test_a_down_weighted_observation_needs_a_larger_error_to_be_found():
    # wf = 0.1 and h = 0.5: r = 0.95, var(v) / σ² = 1 + 0.5 - 2 · 0.05 - 0.1 · 0.9 · 0.25 = 1.3775
    found = reliability(residuals([0.95], [0.1], [0.01]), 1.0)
    assert found.minimal_detectable_bias == pytest.approx(4.132 * 0.01 * np.sqrt(1.3775) / 0.95)
    assert found.external == pytest.approx(4.132 * 0.1 * np.sqrt(0.5 * 1.3775) / 0.95)


def test_what_nothing_checks_has_no_reliability_but_a_standard_deviation():
    found = reliability(residuals([0.0], [1.0], [0.005]), 1.0)
    assert np.isnan(found.minimal_detectable_bias[0])
    assert np.isnan(found.external[0])
    assert found.adjusted_sd[0] == pytest.approx(0.005)


def test_deviation_of_a_down_weighted_observation_counts_its_full_leverage():
    # r = 1 - wf h with wf = 0.1 and h = 0.5
    found = reliability(residuals([0.95], [0.1], [0.01]), 1.0)
    assert found.adjusted_sd[0] == pytest.approx(0.01 * np.sqrt(0.5))


def test_a_disregarded_observation_has_none():
    found = reliability(residuals([np.nan], [np.nan], [0.01]), 1.0)
    assert np.isnan([found.minimal_detectable_bias[0], found.external[0], found.adjusted_sd[0]]).all()
