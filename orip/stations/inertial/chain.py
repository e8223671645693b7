"""Covariances within a chain of states of which each is tied to the next one: of single states, and of two of them.

The rows are reduced by QR from the first state to the last; going back, the covariance of a state follows from that of
the next one (Bierman 1977, Factorization methods for discrete sequential estimation, chapter 10).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from msgspec import Struct
from scipy.linalg import solve_triangular

from orip.arrays import FloatArray


class Chain(Struct, frozen=True):
    """k states of s unknowns.

    Parameters
    ----------
    covariance : array (k, s, s)
    gain : array (k - 1, s, s)
        An error of the next state times this is what is expected of a state's own error.
    """

    covariance: FloatArray
    gain: FloatArray

    def between(self, first: int, second: int) -> FloatArray:
        """Return the covariance (s, s) of a state with one after it."""
        found = self.covariance[second]
        for state in range(second - 1, first - 1, -1):
            found = self.gain[state] @ found
        return np.asarray(found)


def chain_of(single: Sequence[Iterable[FloatArray]], tied: Sequence[Iterable[FloatArray]]) -> Chain:
    """Return the covariances of a chain from the rows of its equations, divided by their standard deviations.

    Parameters
    ----------
    single : sequence of k iterables of arrays (r, s)
        Of equations that a state has by itself.
    tied : sequence of k - 1 iterables of arrays (r, 2 s)
        Of those that it has with the next one.
    """
    triangles, across = [], []
    kept = np.vstack(list(single[0]))
    size = kept.shape[1]
    for own, both in zip(single[1:], tied, strict=True):
        padded = np.hstack([kept, np.zeros_like(kept)])
        reduced = _triangle([padded, *both])
        triangles.append(reduced[:size, :size])
        across.append(reduced[:size, size:])
        kept = np.vstack([reduced[size:, size:], *own])
    triangles.append(_triangle([kept]))
    inverse = [solve_triangular(triangle, np.eye(size)) for triangle in triangles]
    covariance, gain = np.empty((len(single), size, size)), np.empty((len(single) - 1, size, size))
    covariance[-1] = inverse[-1] @ inverse[-1].T
    for state in range(len(single) - 2, -1, -1):
        gain[state] = -inverse[state] @ across[state]
        covariance[state] = inverse[state] @ inverse[state].T + gain[state] @ covariance[state + 1] @ gain[state].T
    return Chain(covariance, gain)


def border_of(single: Sequence[Iterable[FloatArray]], tied: Sequence[Iterable[FloatArray]], size: int) -> FloatArray:
    """Return what rows say of further unknowns that all of them share, and of their right-hand side.

    Parameters
    ----------
    single, tied
        As of `chain_of`, with e further columns, the last of them the right-hand side.
    size : int
        Unknowns of a state, s.

    Returns
    -------
    array (e, e)
        Upper triangle: the equations of the shared unknowns when those of all states are eliminated.
    """
    kept, tail = np.vstack(list(single[0])), []
    for own, both in zip(single[1:], tied, strict=True):
        padded = np.hstack([kept[:, :size], np.zeros((len(kept), size)), kept[:, size:]])
        reduced = _triangle([padded, *both])
        tail.append(reduced[2 * size :, 2 * size :])
        kept = np.vstack([reduced[size : 2 * size, size:], *own])
    tail.append(_triangle([kept])[size:, size:])
    return _triangle(tail)


def _triangle(rows: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(np.linalg.qr(np.vstack(rows), mode="r"), dtype=np.float64)
