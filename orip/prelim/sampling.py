"""Samples of observations for orientations without initial values, and medians of a few numbers."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import chain, combinations

import numpy as np

from orip.arrays import FloatArray, IntArray


@lru_cache(maxsize=256)
def subsets(count: int, size: int, limit: int, seed: int = 0) -> IntArray:
    """Return subsets of `count` things: all of them if there are at most `limit`, else `limit` random ones.

    Random subsets have different members and may repeat; their order is random. Equal arguments give equal subsets.

    Parameters
    ----------
    count, size : int
        `size` of the indices 0 to `count` - 1; none if `count` is less.

    Returns
    -------
    array (s, size)
        Shared between callers, and therefore read-only.
    """
    total = math.comb(count, size)
    if total <= limit:
        members = np.fromiter(chain.from_iterable(combinations(range(count), size)), dtype=np.int64, count=total * size)
        members = members.reshape(total, size)
    else:
        members = _random_subsets(count, size, limit, np.random.default_rng(seed))
    members.setflags(write=False)
    return members


def _random_subsets(count: int, size: int, number: int, generator: np.random.Generator) -> IntArray:
    """Draw the k-th member from the remaining count - k things: its rank among them, moved past those drawn before."""
    result = np.empty((number, size), dtype=np.int64)
    for k in range(size):
        drawn = generator.integers(count - k, size=number)
        for before in np.sort(result[:, :k], axis=1).T:
            drawn += drawn >= before
        result[:, k] = drawn
    return result


def medians(values: FloatArray) -> FloatArray:
    """Return the median of each column, ten times as fast as `np.median` for a few numbers.

    Parameters
    ----------
    values : array (n, k)
        Finite; n > 0.

    Returns
    -------
    array (k,)
    """
    lower, upper = (len(values) - 1) // 2, len(values) // 2
    ordered = np.partition(values, (lower, upper), axis=0)
    return np.asarray(0.5 * (ordered[lower] + ordered[upper]))


def median(values: FloatArray) -> float:
    """Return the median of finite numbers in an array of any shape, at least one."""
    return float(medians(values.ravel()))
