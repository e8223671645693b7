"""Check points beside each other: thousands are compared in a few passes, with what comparing them one by one says."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orip.mistakes.control.check_points import ComparedPoints, exchanged_points, medians_of_others

VALUES = st.lists(st.one_of(st.just(np.nan), st.integers(0, 5).map(float)), min_size=1, max_size=9).map(np.array)


@given(VALUES)
def test_medians_of_the_others(values: np.ndarray) -> None:
    for row, found in enumerate(medians_of_others(values)):
        others = np.delete(values, row)
        others = others[np.isfinite(others)]
        assert found == (np.median(others) if len(others) else 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_exchanged_points_are_those_whose_exchange_removes_both_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    adjusted = rng.uniform(0.0, 100.0, (40, 3))
    given = adjusted + rng.normal(size=(40, 3)) * rng.choice([0.01, 1.0, 30.0], (40, 1))
    for one, other in ((3, 17), (5, 6), (20, 39)):
        given[[one, other]] = adjusted[[other, one]] + rng.normal(size=(2, 3))
    given[11, 2] = np.nan
    compared = ComparedPoints(tuple(map(str, range(40))), given, adjusted, np.full((40, 3), 0.05))

    def is_exchanged(one: int, other: int) -> bool:
        before = np.linalg.norm(given[[one, other]] - adjusted[[one, other]])
        after = np.linalg.norm(given[[one, other]] - adjusted[[other, one]])
        return bool(after < 0.1 * before and before > 8.0 * np.linalg.norm(compared.sd[[one, other]]))

    expected = [pair for pair in combinations(range(40), 2) if is_exchanged(*pair)]
    assert {(3, 17), (20, 39)} <= set(expected)
    assert exchanged_points(compared) == expected
