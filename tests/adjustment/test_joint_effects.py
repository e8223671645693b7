"""Leaving observations out and taking them back, against adjustments without and with them."""

from __future__ import annotations

import numpy as np
import pytest

from orip.adjustment.residual_sums import JointEffects

RANDOM = np.random.default_rng(7)
DESIGN = RANDOM.normal(size=(12, 4))
OBSERVED = RANDOM.normal(size=12)
EVERY = np.ones(12, dtype=bool)


def adjusted(in_use: np.ndarray) -> JointEffects:
    """Return the observations of a straightforward adjustment of those in use."""
    inverse = np.linalg.inv(DESIGN[in_use].T @ DESIGN[in_use])
    unknowns = inverse @ DESIGN[in_use].T @ OBSERVED[in_use]
    return JointEffects(DESIGN @ unknowns - OBSERVED, DESIGN @ inverse @ DESIGN.T, in_use)


def square_sum(effects: JointEffects) -> float:
    return float(np.sum(effects.residual[effects.in_use] ** 2))


def same(one: JointEffects, other: JointEffects) -> None:
    # the condition of the random design is below 10: nothing but rounding
    assert np.allclose(one.residual, other.residual, atol=1e-12)
    assert np.allclose(one.cofactor, other.cofactor, atol=1e-12)
    assert (one.in_use == other.in_use).all()


@pytest.mark.parametrize("group", [[3], [3, 5], [0, 7, 11]])
def test_leaving_a_group_out_gives_the_adjustment_without_it(group: list[int]) -> None:
    without = EVERY.copy()
    without[group] = False
    here = adjusted(EVERY)
    same(here.changed(np.array(group)), adjusted(without))
    (fall,), (freedom,) = here.square_sum_changes(np.array([group]))
    assert fall == pytest.approx(square_sum(here) - square_sum(adjusted(without)), rel=1e-12)
    assert freedom == len(group)


@pytest.mark.parametrize("group", [[3], [3, 5], [0, 7, 11]])
def test_taking_a_group_back_undoes_it(group: list[int]) -> None:
    without = EVERY.copy()
    without[group] = False
    there = adjusted(without)
    same(there.changed(np.array(group)), adjusted(EVERY))
    (rise,), _ = there.square_sum_changes(np.array([group]))
    assert rise == pytest.approx(square_sum(adjusted(EVERY)) - square_sum(there), rel=1e-12)


def test_one_after_the_other_is_both_together() -> None:
    same(adjusted(EVERY).changed(np.array([1])).changed(np.array([8])), adjusted(EVERY).changed(np.array([1, 8])))


def test_the_fall_of_one_observation_is_the_square_of_its_normalised_residual() -> None:
    here = adjusted(EVERY)
    fall, _ = here.square_sum_changes(np.arange(12)[:, None])
    assert np.allclose(fall, here.normalised() ** 2, rtol=1e-12)


def test_what_alone_determines_an_unknown_has_no_influence_on_the_others() -> None:
    # one more unknown that observation 0 alone depends on
    design = np.hstack([DESIGN, np.eye(12)[:, :1]])
    inverse = np.linalg.inv(design.T @ design)
    unknowns = inverse @ design.T @ OBSERVED
    here = JointEffects(design @ unknowns - OBSERVED, design @ inverse @ design.T, EVERY)
    assert here.unchecked(np.array([0]))
    assert not here.unchecked(np.array([1]))
    assert np.isnan(here.normalised()[0])
    _, (freedom,) = here.square_sum_changes(np.array([[0, 1]]))
    assert freedom == 1
    after = here.changed(np.array([0]))
    assert np.allclose(after.residual[1:], here.residual[1:], atol=1e-12)
