"""Iterations that end by changes of angles, coordinates or the square sum, besides ENP."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from bundle.solving import OFF, redefined, solved
from support.synthetic_block import synthetic_block

BLOCK = synthetic_block("convergent", "criteria", noise_mm=0.005, start_error=0.02, enp_stop=0.1, **OFF).block


@pytest.mark.parametrize(
    ("criterion", "lax", "strict"),
    [("stop_angles", 10.0, 1e-9), ("stop_coordinates", 100.0, 1e-10), ("stop_vtpv", 0.9, 1e-14)],
)
def test_a_strict_limit_makes_more_iterations_and_a_lax_one_none(criterion: str, lax: float, strict: float) -> None:
    usual = len(solved(BLOCK).iterations)
    assert len(solved(redefined(BLOCK, **{criterion: lax})).iterations) >= usual
    found = solved(redefined(BLOCK, **{criterion: strict}))
    assert found.converged
    assert len(found.iterations) > usual
    assert all(not record.is_small for record in found.iterations[:-2] if record.enp > 0.1)


def test_the_criterion_is_the_average_change_of_the_last_iteration() -> None:
    """The states after n and n - 1 iterations are compared without the function under test."""
    found = solved(redefined(BLOCK, stop_coordinates=1e-6))
    count = len(found.iterations)
    ends = [solved(redefined(BLOCK, max_iterations=n, enp_stop=15.0)).state for n in (count - 2, count - 1, count)]
    changes = [
        np.mean(np.abs(np.concatenate([(b.centres - a.centres).ravel(), (b.points - a.points).ravel()])))
        for a, b in pairwise(ends)
    ]
    assert changes[0] > 1e-6 >= changes[1]
