"""Blocks fitted by themselves: each is taken towards its own minimum, and none of them is made worse."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from adjustment.factorisation.linear_systems import equations_of
from msgspec import Struct

from orip.adjustment.convergence import judged_residuals, with_blocks_fitted
from orip.adjustment.equations import Equations, Layout, Linearised
from orip.structs import replace

Function = Callable[[np.ndarray], np.ndarray]


class Blocks(Struct, frozen=True):
    """One reduced unknown, and blocks whose observations are a function of each coordinate by itself, times `scale`."""

    function: Function
    derivative: Function
    scale: np.ndarray
    observed: np.ndarray
    fixed: np.ndarray

    @property
    def layout(self) -> Layout:
        return Layout(1, len(self.observed) // 3, np.append(False, self.fixed))

    def linearise(self, state: np.ndarray) -> Equations:
        design = np.hstack([self.scale[:, None], np.diag(self.scale * self.derivative(state[1:]))])
        return equations_of(design, self.scale * (self.function(state[1:]) + state[0]) - self.observed)

    def with_blocks_moved(self, state: np.ndarray, correction: np.ndarray) -> np.ndarray:
        return state + np.append(0.0, correction)


def fitted(problem: Blocks, state: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    moved = Linearised(state, problem.linearise(state))
    ones = np.ones(len(problem.observed)) if weights is None else weights
    return with_blocks_fitted(problem, moved, moved.equations, ones).state


def linear(observed: np.ndarray, fixed: np.ndarray | None = None) -> Blocks:
    none = np.zeros(len(observed), dtype=bool)
    scale = 10.0 ** np.arange(-3.0, len(observed) - 3.0)
    return Blocks(lambda x: x, np.ones_like, scale, observed, none if fixed is None else fixed)


def test_linear_blocks_get_to_their_minimum_and_the_reduced_unknown_stays():
    observed = np.random.default_rng(1).normal(size=6)
    problem = linear(observed)
    found = fitted(problem, np.append(0.5, np.zeros(6)))
    assert found[0] == 0.5
    assert np.allclose(found[1:], observed / problem.scale - 0.5, rtol=1e-12)


def test_a_full_block_is_solved():
    random = np.random.default_rng(2)
    design = np.hstack([np.zeros((8, 1)), random.normal(size=(8, 3)) * np.array([1e3, 1.0, 1e-3])])
    observed = random.normal(size=8)

    class One(Blocks):
        def linearise(self, state: np.ndarray) -> Equations:
            return equations_of(design, design @ state - observed)

    none = np.zeros(3, dtype=bool)
    problem = One(np.sin, np.cos, np.ones(3), np.zeros(3), none)
    state = np.zeros(4)
    weights = random.uniform(0.1, 1.0, 8)
    moved = Linearised(state, problem.linearise(state))
    found = with_blocks_fitted(problem, moved, moved.equations, weights).state
    root = np.sqrt(weights)
    wanted, *_ = np.linalg.lstsq(design[:, 1:] * root[:, None], observed * root, rcond=None)
    assert np.allclose(found[1:], wanted, rtol=1e-9)


def test_fixed_places_and_undetermined_ones_stay():
    observed = np.arange(1.0, 7.0)
    problem = linear(observed, np.array([False, True, False, False, False, False]))
    scale = problem.scale.copy()
    scale[4] = 0.0
    found = fitted(replace(problem, scale=scale), np.zeros(7))
    assert found[2] == 0.0 == found[5]
    assert np.allclose(found[[1, 3, 4, 6]], (observed / problem.scale)[[0, 2, 3, 5]], rtol=1e-12)


@pytest.mark.parametrize("start", [0.5, 3.0, 30.0])
def test_no_block_is_made_worse(start):
    # from 3 and 30 a full correction of the arctangent goes further away; the other block gets to its minimum
    problem = Blocks(np.arctan, lambda x: 1.0 / (1.0 + x**2), np.ones(6), np.zeros(6), np.zeros(6, dtype=bool))
    state = np.array([0.0, start, start, start, 0.1, 0.1, 0.1])
    found = fitted(problem, state)
    assert (np.abs(found[1:4]) <= start).all()
    assert (np.abs(found[4:]) < 1e-8).all()


def test_observations_out_of_sight_are_no_gain():
    before = equations_of(np.eye(3), np.array([0.1, 2.0, 5.0]))
    before.active[2] = False
    after = equations_of(np.eye(3), np.array([0.3, 0.0, 0.0]))
    after.active[1] = False
    assert np.allclose(judged_residuals(before, after), [0.3, 2.0 * np.sqrt(5.0), 0.0])
