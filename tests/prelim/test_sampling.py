"""Subsets of observations: all of them, or random ones without repetition inside."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from orip.prelim.sampling import subsets


def test_few_combinations_are_all_there():
    assert [tuple(subset) for subset in subsets(7, 5, 21, 1)] == list(combinations(range(7), 5))
    assert subsets(4, 5, 100, 1).shape == (0, 5)
    assert np.array_equal(subsets(3, 3, 1, 1), [[0, 1, 2]])


def test_random_subsets_have_different_members_and_favour_none():
    found = subsets(9, 4, 100, 3)
    assert found.shape == (100, 4)
    assert all(len(set(sample)) == 4 for sample in found)
    large = subsets(30, 3, 4000, 5)
    assert large.min() == 0
    assert large.max() == 29
    # 400 of each on average, standard deviation 19
    assert np.abs(np.bincount(large.ravel()) - 400).max() < 100
    assert abs(large[:, 2].mean() - 14.5) < 0.7


def test_equal_seeds_give_equal_subsets():
    assert np.array_equal(subsets(40, 5, 50, 7), subsets(40, 5, 50, 7))
    assert not np.array_equal(subsets(40, 5, 50, 7), subsets(40, 5, 50, 8))
