"""Reliability: the smallest error that a test detects, and the effect of an undetected one on the unknowns."""

from __future__ import annotations

import numpy as np

from orip.records.solution import Reliability, Residuals

NON_CENTRALITY = 4.132
"""Shift of a normalised residual that a test with error probability 0.001 finds with probability 0.80 (Baarda 1968)."""

_TESTABLE = 1e-6


def reliability(residuals: Residuals, deviation_scale: float) -> Reliability:
    """Return the reliability of observations from their redundancy numbers.

    Parameters
    ----------
    residuals : Residuals
    deviation_scale : float
        sigma0, or 1 without redundancy.

    Returns
    -------
    Reliability
        Internal: 4.13 a / sqrt(r), with a the a-priori error. External: 4.13 sqrt((1 - r) / r), the influence of such
        an error on any function of the unknowns, in units of its standard deviation. The deviation of the adjusted
        observation is sigma0 a sqrt(h), with h = (1 - r) / weight factor.
    """
    number = residuals.redundancy_number
    testable = np.where(number > _TESTABLE, number, np.nan)
    share = np.clip(1.0 - number, 0.0, None)
    factor = np.where(residuals.weight_factor > 0.0, residuals.weight_factor, np.nan)
    # the figures of an adjustment that diverged may overflow; they are printed as they are
    with np.errstate(over="ignore", invalid="ignore"):
        return Reliability(
            minimal_detectable_bias=NON_CENTRALITY * residuals.a_priori / np.sqrt(testable),
            external=NON_CENTRALITY * np.sqrt(share / testable),
            adjusted_sd=deviation_scale * residuals.a_priori * np.sqrt(share / factor),
        )
