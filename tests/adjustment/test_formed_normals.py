"""The last correction with the normal equations of the iteration before."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.blocking.divided_blocks import calibrated, free, with_stations
from bundle.solving import redefined
from support.rig_blocks import rig_block

from orip.adjustment import iteration, iteration_state
from orip.adjustment.normals import solve_normals
from orip.bundle.problem import pose_problem
from orip.bundle.solve import SolvedBlock, iteration_settings, solve_problem
from orip.bundle.starting_state import starting_state
from orip.records.block import Block

PHOTOS = 24
DIGITS = 6.0
"""ENP of the end: the last correction is sure to be one that needs no new normal equations."""
NEVER = 10**9
SAME = 2e-3
"""Largest part by which standard deviations may differ from those at the very end: less than three printed digits."""


def adjusted(block: Block, monkeypatch: pytest.MonkeyPatch, worth_it: int) -> tuple[SolvedBlock, int]:
    """Return the solution, and how many times normal equations were formed, held for blocks of so many observations."""
    formed = []

    def counted(*arguments, **named):
        formed.append(1)
        return solve_normals(*arguments, **named)

    monkeypatch.setattr(iteration_state, "_WORTH_IT", worth_it)
    monkeypatch.setattr(iteration, "solve_normals", counted)
    settings = iteration_settings(block.definition)
    found = solve_problem(pose_problem(block), starting_state(block), settings, lambda _: None, lambda: False)
    return found, len(formed)


BLOCKS = (
    calibrated(PHOTOS),
    free(PHOTOS),
    with_stations(PHOTOS),
    rig_block("three", "held").block,
)


@pytest.mark.parametrize("block", BLOCKS)
def test_the_solution_is_the_same_with_fewer_normal_equations(block, monkeypatch):
    block = redefined(block, enp_stop=DIGITS)
    whole, of_whole = adjusted(block, monkeypatch, NEVER)
    held, of_held = adjusted(block, monkeypatch, 0)
    assert held.converged
    assert whole.converged
    assert of_held < of_whole
    assert held.linearised_at is not held.state
    for one, other in zip(standard_deviations(held), standard_deviations(whole), strict=True):
        assert one == pytest.approx(other, rel=SAME)
    off = np.abs(held.state.points - whole.state.points)
    deviation = np.sqrt(np.einsum("bii->bi", whole.cofactors.blocks)).max()
    assert off.max() < 10.0**-DIGITS * deviation


def standard_deviations(found: SolvedBlock) -> tuple[np.ndarray, np.ndarray]:
    """Return roots of the cofactors of reduced unknowns and of points."""
    return np.sqrt(found.cofactors.reduced.diagonal()), np.sqrt(np.einsum("bii->bi", found.cofactors.blocks))
