"""Sums of correlated residuals: their covariances against those of dense matrices, and against another adjustment."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from orip.adjustment.residual_sums import ResidualSums, RowsUnderTest, residual_sums, with_checks_used

UNKNOWNS, TESTED, OTHERS = 5, 9, 30
ROUNDING = 1e-9
"""Condition numbers of the normal equations here are below 100."""


class Design:
    """30 observations that are not tested, 9 that are, of which the last three are check observations."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        self.others = random.normal(size=(OTHERS, UNKNOWNS))
        self.tested = random.normal(size=(TESTED, UNKNOWNS))
        self.weight = np.array([1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        self.observed = random.normal(size=OTHERS + TESTED)
        self.factors = random.normal(size=(TESTED, 4))

    def adjusted(self, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the cofactors of the unknowns, and M with residuals M l, of all observations."""
        a = np.vstack([self.others, self.tested])
        w = np.concatenate([np.ones(OTHERS), weight])
        q = np.linalg.inv(a.T @ (w[:, None] * a))
        return q, a @ q @ (w[:, None] * a).T - np.eye(len(a))

    def sums(self, weight: np.ndarray, others_variance: float = 1.0) -> ResidualSums:
        q, m = self.adjusted(weight)
        residual = (m @ self.observed)[OTHERS:]
        rows = RowsUnderTest(
            csr_array(self.tested),
            np.arange(self.tested.shape[1]),
            residual,
            weight,
            lambda right: q @ right,
            others_variance,
        )
        return residual_sums(rows, self.factors)


@pytest.mark.parametrize("variance", [1.0, 2.25])
def test_covariances_follow_from_those_of_the_observations(variance):
    given = Design(1)
    _, m = given.adjusted(given.weight)
    of_observations = np.diag(np.r_[np.full(OTHERS, variance), np.ones(TESTED)])
    expected = given.factors.T @ (m @ of_observations @ m.T)[OTHERS:, OTHERS:] @ given.factors
    assert given.sums(given.weight, variance).covariance() == pytest.approx(expected, rel=ROUNDING)


def test_with_reduced_weights_among_the_tested_they_are_exact_too():
    given = Design(2)
    weight = np.array([0.3, 1.0, 0.0, 0.7, 1.0, 1.0, 0.0, 0.0, 0.0])
    _, m = given.adjusted(weight)
    expected = given.factors.T @ (m @ m.T)[OTHERS:, OTHERS:] @ given.factors
    assert given.sums(weight).covariance() == pytest.approx(expected, rel=ROUNDING)


def test_an_error_changes_the_sums_by_their_response():
    given = Design(3)
    error = np.linspace(-1.0, 2.0, TESTED)
    before = given.sums(given.weight)
    given.observed[OTHERS:] += error
    assert before.values - given.sums(given.weight).values == pytest.approx(
        before.responses(error[:, None])[:, 0], rel=1e-7
    )


def test_check_observations_taking_part_are_another_adjustment():
    given = Design(4)
    checks = np.arange(TESTED) >= 6
    before = given.sums(given.weight)
    smoothed = residual_sums(before.rows, np.eye(TESTED)[:, checks]).smoothed
    found = with_checks_used(before, checks, smoothed)
    expected = given.sums(np.where(checks, 1.0, given.weight))
    assert found.values == pytest.approx(expected.values, rel=1e-7)
    assert found.covariance() == pytest.approx(expected.covariance(), rel=1e-7)
