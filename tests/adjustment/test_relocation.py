"""Blocks at other places: change of the cost and correction against normal equations formed again."""

from __future__ import annotations

import numpy as np
import pytest
from adjustment.factorisation.linear_systems import equations_of, random_equations, random_weights

from orip.adjustment.equations import Equations, OtherPlace
from orip.adjustment.normals import solve_normals
from orip.adjustment.relocations import changed_weights, relocations
from orip.adjustment.weights import danish_costs
from orip.structs import replace

LIMIT = 5.0


def other_place(equations: Equations, reduced: int, block: int, seed: int) -> tuple[OtherPlace, Equations]:
    """Return a place where a block has another design, and the equations with it."""
    random = np.random.default_rng(seed)
    design, residual = equations.design.toarray(), equations.residual.copy()
    columns = reduced + 3 * block + np.arange(3)
    rows = np.flatnonzero(design[:, columns].any(axis=1))
    weights = np.ones(len(rows))
    weights[random.integers(len(rows))] = 1e-10
    design[rows] *= random.uniform(0.5, 2.0, (len(rows), 1))
    design[np.ix_(rows, columns)] += design[np.ix_(rows, columns)] * random.normal(size=(len(rows), 3))
    residual[rows] = random.normal(size=len(rows))
    place = OtherPlace(
        columns,
        np.full(3, 7.0),
        rows,
        weights,
        design[rows][:, :reduced],
        design[np.ix_(rows, columns)],
        residual[rows],
    )
    return place, equations_of(design, residual)


def least_cost(equations: Equations, weights: np.ndarray) -> tuple[float, np.ndarray]:
    """Return half the least weighted square sum, and the correction to it."""
    root = np.sqrt(weights)
    design = equations.design.toarray() * root[:, None]
    scale = np.linalg.norm(design, axis=0)
    moved = -np.linalg.lstsq(design / scale, root * equations.residual, rcond=None)[0] / scale
    after = root * equations.residual + design @ moved
    return float(after @ after) / 2.0, moved


@pytest.mark.parametrize("seed", range(4))
def test_the_change_and_the_correction_are_those_of_an_adjustment_at_the_other_place(seed: int) -> None:
    equations, layout = random_equations(seed)
    weights = np.maximum(random_weights(seed, len(equations.residual)), 0.1)
    normals = solve_normals(equations, weights, layout, 12.0)
    block = 3 + seed
    place, there = other_place(equations, layout.reduced, block, seed)
    changed = weights.copy()
    changed[place.rows] = place.weights
    found = relocations([place], equations, weights, normals, layout, LIMIT)
    (one,) = found.single
    before, _ = least_cost(equations, weights)
    after, expected = least_cost(there, changed)
    none = place.rows[place.weights < 1.0]
    beyond = danish_costs(np.abs(there.residual[none]), LIMIT) - changed[none] * there.residual[none] ** 2 / 2.0
    own = equations.residual[place.rows]
    less = danish_costs(np.abs(own), LIMIT) - weights[place.rows] * own**2 / 2.0
    # the scaled normal equations have a condition below 1e4, and the costs are of the order of 50
    assert one.change == pytest.approx(after - before + beyond.sum() - less.sum(), abs=1e-7)
    expected[place.columns] += place.move
    assert np.allclose(found.correction([one]), expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_observations_of_a_group_cost_what_the_length_of_their_residuals_does() -> None:
    equations, layout = random_equations(2)
    weights = np.ones(len(equations.residual))
    normals = solve_normals(equations, weights, layout, 12.0)
    place, _ = other_place(equations, layout.reduced, 3, 2)
    first, second = place.rows[:2]
    far = np.r_[30.0, 40.0, place.residual[2:]]
    place = place._replace(weights=np.r_[1e-10, 1e-10, np.ones(len(place.rows) - 2)], residual=far)
    groups = np.full(len(weights), -1)
    groups[[first, second]] = 4
    alone = relocations([place], equations, weights, normals, layout, LIMIT).single[0].change
    grouped = replace(equations, groups=groups)
    together = relocations([place], grouped, weights, normals, layout, LIMIT).single[0].change
    # before, both have full weight and cost half their squares: the groups differ at the other place only
    expected = danish_costs(np.array([50.0]), LIMIT).sum() - danish_costs(far[:2], LIMIT).sum()
    before = np.abs(equations.residual[[first, second]])
    expected -= danish_costs(np.array([np.hypot(*before)]), LIMIT).sum() - danish_costs(before, LIMIT).sum()
    # the costs are of the order of 50
    assert together - alone == pytest.approx(expected, abs=1e-9)


def test_the_observations_that_change_their_weight_are_named() -> None:
    equations, layout = random_equations(1)
    weights = np.ones(len(equations.residual))
    place, _ = other_place(equations, layout.reduced, 2, 1)
    lost = place.rows[place.weights >= 1.0][0]
    weights[lost] = 0.01
    normals = solve_normals(equations, weights, layout, 12.0)
    found = relocations([place], equations, weights, normals, layout, LIMIT)
    full, none = changed_weights(found.single, weights)
    assert full.tolist() == [lost]
    assert none.tolist() == place.rows[place.weights < 1.0].tolist()


def test_of_each_block_the_best_place_is_taken() -> None:
    equations, layout = random_equations(2)
    weights = np.ones(len(equations.residual))
    normals = solve_normals(equations, weights, layout, 12.0)
    places = [other_place(equations, layout.reduced, block, seed)[0] for block in (1, 4) for seed in range(3)]
    found = relocations(places, equations, weights, normals, layout, LIMIT)
    best = found.of_different_blocks(np.inf)
    for block in (1, 4):
        own = [one.change for one in found.single if one.place.columns[0] == layout.reduced + 3 * block]
        assert min(own) in [one.change for one in best]
    assert len(best) == 2
