"""Exchanges of weights against all subsets of observations, each adjusted by a straightforward iteration."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from adjustment.factorisation.linear_systems import (
    adjusted,
    converged,
    dense_normals,
    equations_of,
    linear_problem,
    random_equations,
    random_weights,
    settings,
)

from orip.adjustment import exchanges, weight_search
from orip.adjustment.exchanges import exchanges_to_try, lost_by_themselves, wrong_by_themselves, wrong_one_by_one
from orip.adjustment.improvement import rounds_after
from orip.adjustment.normals import solve_normals
from orip.adjustment.residual_sums import factored_rows
from orip.adjustment.weight_changes import HIDDEN, LinearAdjustment, begun
from orip.adjustment.weight_search import taken_back_together, weights_of_lower_cost
from orip.structs import replace

COUNT, LIMIT = 12, 5.0
EVERY = np.ones(COUNT, dtype=bool)
SUBSETS = [subset for number in range(5) for subset in combinations(range(COUNT), number)]


def costs(residuals: np.ndarray) -> np.ndarray:
    """Return the robust cost of each row of residuals, written out."""
    u = np.abs(residuals) / LIMIT
    above = 0.5 + 2.0 / np.e - (1.0 + u) * np.exp(-u)
    return LIMIT**2 * np.where(u <= 1.0, u**2 / 2.0, above).sum(axis=1)


def minima(design: np.ndarray, observed: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return costs and weights of the local minima that sets of weights (s, n) lead to."""
    for _ in range(50):
        normals = np.einsum("sn,ni,nj->sij", weights, design, design)
        right = np.einsum("sn,ni,n->si", weights, design, observed)
        residuals = np.linalg.solve(normals, right[:, :, None])[:, :, 0] @ design.T - observed
        u = np.abs(residuals) / LIMIT
        weights = np.where(u <= 1.0, 1.0, np.exp(-u))
    return costs(residuals), weights


def lowest(design: np.ndarray, observed: np.ndarray) -> float:
    """Return the lowest of the minima with up to four observations left out at first."""
    return float(minima(design, observed, of_subsets())[0].min())


def of_subsets() -> np.ndarray:
    weights = np.ones((len(SUBSETS), COUNT))
    for row, subset in enumerate(SUBSETS):
        weights[row, list(subset)] = 1e-10
    return weights


def line_with_blunders(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a straight line through points of which four are wrong, with two at an end of it, where they hide."""
    random = np.random.default_rng(seed)
    x = np.sort(random.uniform(0.0, 10.0, COUNT))
    observed = 2.0 + 0.5 * x + random.normal(size=COUNT)
    wrong = [0, 1, *random.choice(np.arange(2, COUNT), 2, replace=False)]
    observed[wrong] += random.uniform(8.0, 30.0, 4) * random.choice([-1.0, 1.0], 4)
    return np.stack([np.ones(COUNT), x], axis=1), observed


@pytest.mark.parametrize("seed", range(16))
def test_the_iterations_end_at_the_lowest_cost_of_all_subsets(seed: int) -> None:
    design, observed = line_with_blunders(seed)
    found = adjusted(linear_problem(design, observed), np.zeros(2), settings(start=2, enp_stop=6.0))
    assert converged(found)
    # ENP 6: the cost, quadratic in the rest of the correction, is that of the minimum within rounding
    assert costs(found.equations.residual[None])[0] <= lowest(design, observed) * (1.0 + 1e-6)


def test_an_exchange_lowers_the_cost_of_a_local_minimum() -> None:
    exchanged = 0
    for seed in range(12):
        design, observed = line_with_blunders(seed)
        problem = linear_problem(design, observed)
        every, of_all = minima(design, observed, of_subsets())
        cost, weights = every.max(), of_all[every.argmax()]
        normals = design.T @ (weights[:, None] * design)
        residual = design @ np.linalg.solve(normals, design.T @ (weights * observed)) - observed
        equations = equations_of(design, residual)
        solved = solve_normals(equations, weights, problem.layout, 12.0)
        for exchange in exchanges_to_try(equations, weights, solved, problem.layout, LIMIT, EVERY)[:1]:
            exchanged += 1
            after = weights.copy()
            after[exchange.full_weight], after[exchange.no_weight] = 1.0, 1e-10
            (lower,), _ = minima(design, observed, after[None])
            # what is hardly higher without the other weights that follow is a candidate, too
            assert lower < cost + 0.01 * LIMIT**2
    assert exchanged >= 6


def test_no_exchange_where_all_observations_fit() -> None:
    design, observed = line_with_blunders(3)
    equations = equations_of(design, np.random.default_rng(3).normal(size=COUNT))
    problem = linear_problem(design, observed)
    weights = np.ones(COUNT)
    normals = solve_normals(equations, weights, problem.layout, 12.0)
    assert not exchanges_to_try(equations, weights, normals, problem.layout, LIMIT, EVERY)


@pytest.mark.parametrize("seed", range(4))
def test_the_correction_of_an_exchange_is_that_of_the_changed_weights(seed: int) -> None:
    design, observed = line_with_blunders(seed)
    problem = linear_problem(design, observed)
    every, of_all = minima(design, observed, of_subsets())
    weights = of_all[every.argmax()]
    equations = problem.linearise(np.array([1.0, 2.0]))
    normals = solve_normals(equations, weights, problem.layout, 12.0)
    found = exchanges_to_try(equations, weights, normals, problem.layout, LIMIT, EVERY)
    assert found
    for exchange in found:
        after = weights.copy()
        after[exchange.changed] += exchange.change
        expected = np.linalg.solve(design.T @ (after[:, None] * design), design.T @ (after * -equations.residual))
        correction = exchange.correction(equations.residual, equations, weights, normals)
        # two unknowns whose normal equations have a condition below 1e3
        assert np.allclose(correction, expected, rtol=0.0, atol=1e-9)


def test_cofactors_of_weighted_observations() -> None:
    equations, layout = random_equations(5)
    weights = random_weights(5, len(equations.residual))
    rows = np.arange(0, len(weights), 3)
    normals = solve_normals(equations, weights, layout, 12.0)
    design = equations.design.toarray()
    expected = design @ np.linalg.solve(dense_normals(equations, weights), design.T)
    found = factored_rows(equations, weights, normals, layout, rows).cofactor()
    # unknowns have units that differ by 1e6, which scaling removes; the scaled matrix has a condition below 1e4
    assert np.allclose(found, expected[np.ix_(rows, rows)], atol=1e-8)


def test_where_much_is_wrong_what_is_in_no_group_may_be_wrong_by_itself() -> None:
    count = 400
    groups = np.r_[np.arange(count - 8) // 2, np.full(8, -1)]
    equations = replace(equations_of(np.ones((count, 1)), np.zeros(count)), wider_groups=lambda: groups)
    many = np.ones(count)
    many[:100] = many[count - 1] = 0.1
    assert np.flatnonzero(wrong_by_themselves(equations, many)).tolist() == list(range(count - 8, count))
    many[count - 8 :] = 0.1
    assert wrong_by_themselves(equations, many)[count - 8 :].all()


def test_where_much_is_wrong_what_is_close_to_the_limit_may_be_wrong_one_by_one() -> None:
    count = 400
    residual = np.zeros(count)
    few, many = np.ones(count), np.ones(count)
    few[:3], many[:100] = 0.1, 0.1
    assert wrong_one_by_one(equations_of(np.ones((count, 1)), residual), few, LIMIT).all()
    assert not wrong_one_by_one(equations_of(np.ones((count, 1)), residual), many, LIMIT).any()
    residual[:95] = -30.0 * LIMIT
    found = wrong_one_by_one(equations_of(np.ones((count, 1)), residual), many, LIMIT)
    assert np.flatnonzero(found).tolist() == list(range(95, count))


def test_observations_of_no_eliminated_point_that_have_lost_weight_are_lost_control() -> None:
    equations, layout = random_equations(5)
    count, of_points = len(equations.residual), 12 * 6
    weights, nothing = np.ones(count), np.zeros(count, dtype=bool)
    weights[[3, 40, of_points + 2, count - 1]] = 0.1
    assert lost_by_themselves(equations, weights, layout, nothing).tolist() == [of_points + 2, count - 1]
    among = nothing.copy()
    among[[40, 41]] = True
    assert lost_by_themselves(equations, weights, layout, among).tolist() == [40, of_points + 2, count - 1]


def test_an_observation_just_below_the_limit_is_exchanged_in_a_large_problem() -> None:
    # the mean of each three observations: the last one of all costs less without weight, though it is within the limit
    count = 1200
    design = np.zeros((count, count // 3))
    design[np.arange(count), np.arange(count) // 3] = 1.0
    observed = np.random.default_rng(1).normal(size=count)
    observed[:3] = [0.0, 0.0, 60.0]
    observed[-3:] = [-2.4, -2.4, 4.8]
    problem = linear_problem(design, observed)
    weights = np.ones(count)
    weights[2] = 1e-10
    normals = solve_normals(problem.linearise(np.zeros(count // 3)), weights, problem.layout, 12.0)
    state = np.linalg.solve(design.T @ (weights[:, None] * design), design.T @ (weights * observed))
    found = exchanges_to_try(
        problem.linearise(state), weights, normals, problem.layout, LIMIT, np.ones(count, dtype=bool)
    )
    assert [count - 1] in [exchange.no_weight.tolist() for exchange in found]


@pytest.mark.parametrize("seed", range(4))
def test_small_errors_of_the_cofactors_take_no_gross_error_back(seed: int) -> None:
    random = np.random.default_rng(seed)
    design, observed = random.normal(size=(60, 20)), random.normal(size=60)
    observed[0] += 3000.0
    weights = np.ones(60)
    weights[0] = 1e-10
    cofactor = design @ np.linalg.inv(design.T @ (weights[:, None] * design)) @ design.T
    residual = observed - cofactor @ (weights * observed)
    # as where the last correction has changed the design matrix by a ten-thousandth; 9e6 times that is 1800
    start = LinearAdjustment((1.0 + 2e-4) * cofactor, residual, weights, float(weights @ residual**2))
    assert all(end[0] < 1.0 for end in weights_of_lower_cost(start, LIMIT))


def many_wrong(random: np.random.Generator) -> LinearAdjustment:
    """Return an adjustment with some wrong observations, and others without weight in their place."""
    design, observed = random.normal(size=(120, 40)), random.normal(size=120)
    observed[:30] += random.normal(0.0, 40.0, 30)
    weights = np.ones(120)
    weights[15:45] = 1e-3
    cofactor = design @ np.linalg.inv(design.T @ (weights[:, None] * design)) @ design.T
    residual = observed - cofactor @ (weights * observed)
    return LinearAdjustment(cofactor, residual, weights, float(weights @ residual**2))


def test_observations_that_are_taken_back_together_have_the_residuals_of_an_adjustment_with_them() -> None:
    random = np.random.default_rng(3)
    start = many_wrong(random)
    lots = [np.array(lot) for lot in ([20, 31], [16, 18, 44, 25], [40, 41], [17, 19, 21], [15, 16])]
    (found,) = taken_back_together(begun(start, 1), lots)
    for lot, residual, weight, square_sum in zip(lots, found.residual, found.weight, found.square_sum, strict=True):
        weights = start.weight.copy()
        weights[lot] = 1.0
        expected = start.with_weights(weights)
        assert np.array_equal(weight, weights)
        assert np.allclose(residual, expected.residual, rtol=0.0, atol=1e-9 * np.abs(expected.residual).max())
        assert square_sum == pytest.approx(expected.square_sum, rel=1e-9)


def test_the_search_ends_early_where_one_better_solution_after_the_other_was_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    start, searches, look = many_wrong(np.random.default_rng(5)), [], weight_search._ends

    def counted(now: LinearAdjustment, limit: float) -> list[weight_search._End]:
        searches.append(now)
        return look(now, limit)

    monkeypatch.setattr(weight_search, "_ends", counted)
    numbers = []
    for attempts in (0, 2, 5, 11):
        searches.clear()
        assert weights_of_lower_cost(start, LIMIT, rounds_after(attempts))
        numbers.append(len(searches))
    # two searches, from the start and from convex weights, and at most so many more of each
    assert numbers[0] >= numbers[1] > numbers[2] >= numbers[3]
    assert all(number <= 2 + 2 * most for number, most in zip(numbers, (10, 3, 1, 1), strict=True))


def test_an_end_at_which_hardly_anything_keeps_its_weight_is_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    # the mean of many, and one that is far off and determines it nearly alone when it is taken back: all others fall
    count = 200
    design, observed = np.ones(count), np.random.default_rng(2).normal(size=count)
    design[0], observed[0] = 1e3, 1e6
    weights = np.ones(count)
    weights[0] = 1e-10
    cofactor = np.outer(design, design) / (weights @ design**2)
    residual = observed - cofactor @ (weights * observed)
    start = LinearAdjustment(cofactor, residual, weights, float(weights @ residual**2))
    back, looked_at, look = np.ones(count), [], LinearAdjustment.residuals_with
    assert np.count_nonzero(np.abs(start.residuals_with(back)) > LIMIT) >= count - 1

    def counted(now: LinearAdjustment, weights: np.ndarray) -> np.ndarray:
        looked_at.append(np.count_nonzero(weights < 1.0))
        return look(now, weights)

    monkeypatch.setattr(LinearAdjustment, "residuals_with", counted)
    end = weight_search._End(np.inf, back)
    assert weight_search._settled(start, end, LIMIT) is end
    assert looked_at == [0]


def test_observations_are_chosen_by_the_cofactors_of_a_dense_inverse(monkeypatch: pytest.MonkeyPatch) -> None:
    equations, layout = random_equations(5)
    random = np.random.default_rng(5)
    count = len(equations.residual)
    weights = np.where(random.uniform(size=count) < 0.04, 0.01, 1.0)
    rows = np.arange(count)
    normals = solve_normals(equations, weights, layout, 12.0)
    design = equations.design.toarray()
    cofactor = design @ np.linalg.solve(dense_normals(equations, weights), design.T)
    reduced = weights < 1.0
    shared = np.abs(cofactor[:, reduced]) / (1.0 + (1.0 - weights[reduced]) * np.diag(cofactor)[reduced])
    assert np.array_equal(exchanges._related(equations, weights, normals, rows), reduced | (shared > 0.03).any(axis=1))
    monkeypatch.setattr(exchanges, "_AT_ONCE", 7)
    large = exchanges._are_large(equations, weights, normals, layout, rows, LIMIT, HIDDEN)
    least = LIMIT * np.clip(1.0 - weights * np.diag(cofactor), 0.0, 0.5)
    assert np.array_equal(large, np.abs(equations.residual) > least)
