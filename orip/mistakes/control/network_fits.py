"""A network fitted to control as it may have been meant, for many changes of the control at once.

A change costs no more than the solution of a few equations: all of them are solved together, as stacked matrices.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, inverse_of_covariance
from orip.geometry.similarity import UNKNOWNS, Similarity, fit_similarity, several, similarity_with_partials

FEWEST_POINTS = 4
"""Least number of points that show which of them is wrong."""

LOOKS_UP = -0.5
"""Mean cosine from which photos look up at the control: what is said of it then is said elsewhere."""

CHANCE, OPTIMISTIC = 4.0, 2.0
"""Standard deviations by which a sum of squares is larger than chance gives at most, and how many times larger, as
errors are often given a little too small."""

_ROUNDS, _SETTLED, _NEAR_START = 4, 1e-7, 0.5
"""Rounds of the adjustment of a similarity at most, the part of the extent by which points move in the last one, and
the change of scale up to which the start was near."""

_AT_ONCE = 1 << 18
"""Elements of the matrices that are stacked: more are no faster."""


class Seen(Struct, frozen=True):
    """Points as given and as the photos see them.

    Parameters
    ----------
    names : tuple of str
        Of n points.
    given, errors : arrays (n, 3)
        NaN where not given.
    found : array (n, 3)
        In the network.
    spread : array (3n, 3n)
        Its covariances.
    rotations : array (p, 3, 3)
        Of the photos in the network.
    is_placed : bool
        The network has the scale and the axes of observed positions, and differs by a shift alone.
    """

    names: tuple[str, ...]
    given: FloatArray
    errors: FloatArray
    found: FloatArray
    spread: FloatArray
    rotations: FloatArray
    is_placed: bool


class Change(NamedTuple):
    """Something that may have been mistaken: the coordinates (n, 3) as meant, which of them (n, 3) are left out."""

    meant: FloatArray
    left_out: BoolArray
    price: float
    points: tuple[int, ...]
    factor: float


class Fitted(NamedTuple):
    """A change, its half sum of squares, their redundancy, and the points (n, 3) in the ground system with their sd."""

    change: Change
    cost: float
    redundancy: int
    placed: FloatArray
    sd: FloatArray

    @property
    def fits(self) -> bool:
        """Return whether the sum of squares is no larger than chance, and errors a little too small, make it."""
        chance = self.redundancy + CHANCE * np.sqrt(2.0 * max(self.redundancy, 0))
        return self.redundancy > 0 and self.cost < OPTIMISTIC * 0.5 * chance

    @property
    def score(self) -> float:
        """Return the half sum of squares and the price of the change."""
        return self.cost + self.change.price

    def gain(self, cost: float) -> float:
        """Return by how much less it costs than without the change; in the residuals' own size, if errors are small."""
        scale = max(1.0, 2.0 * self.cost / max(self.redundancy, 1))
        return (cost - self.cost) / scale - self.change.price


class _Start(NamedTuple):
    """A change, which coordinates (n, 3) are compared, n points and those they become, a shift, a first similarity."""

    change: Change
    used: BoolArray
    source: FloatArray
    target: FloatArray
    middle: FloatArray
    similarity: Similarity


def fitted(seen: Seen, changes: Iterable[Change]) -> list[Fitted]:
    """Fit the network to the control as it may have been meant; what is not determined is left out."""
    starts = [start for change in changes if (start := _start(seen, change)) is not None]
    count = max(1, _AT_ONCE // seen.spread.size)
    return [fit for at in range(0, len(starts), count) for fit in _adjusted(seen, starts[at : at + count])]


def _start(seen: Seen, change: Change) -> _Start | None:
    used = np.isfinite(change.meant) & np.isfinite(seen.errors) & ~change.left_out
    full = used.all(axis=1)
    if np.count_nonzero(full) < FEWEST_POINTS - 1:
        return None
    middle, centre = np.mean(change.meant[full], axis=0), np.mean(seen.found[full], axis=0)
    source, target = seen.found - centre, change.meant - middle
    try:
        similarity = fit_similarity(source[full], target[full])
    except ValueError:
        return None
    if seen.is_placed:
        similarity = Similarity(1.0, np.eye(3), np.zeros(3))
    if change.price and (similarity.rotation @ seen.rotations)[:, 2, 2].mean() < LOOKS_UP:
        return None
    return _Start(change, used, source, target, middle, similarity)


def _adjusted(seen: Seen, starts: list[_Start]) -> list[Fitted]:
    """Return the fits that there are, from s starts, in their order; of m = 3 n coordinates and u unknowns."""
    found: dict[int, Fitted] = {}
    going, at = np.arange(len(starts)), several([start.similarity for start in starts])
    noise = np.diag(np.nan_to_num(seen.errors.ravel()) ** 2)
    unknowns = slice(1, 4) if seen.is_placed else slice(0, 7)
    for rounds in range(1, _ROUNDS + 1):
        chosen = [starts[index] for index in going]
        if not chosen:
            break
        value, by_unknowns = similarity_with_partials(at, np.array([start.source for start in chosen]))
        own = _turned(seen.spread, at.scale[:, None, None] * at.rotation)
        rows = np.array([start.used.ravel() for start in chosen])
        partials = by_unknowns.reshape(*rows.shape, -1)[..., unknowns]
        weight = _weights(own + noise, rows)
        off = np.where(rows, (np.array([start.target for start in chosen]) - value).reshape(rows.shape), 0.0)
        weighted = np.swapaxes(partials, 1, 2) @ weight
        normals = np.asarray(np.linalg.pinv(weighted @ partials), dtype=np.float64)
        step = _times(normals, _times(weighted, off))
        moved = np.zeros((len(chosen), UNKNOWNS))
        moved[:, unknowns] = step
        at, by = at.moved(moved), _times(partials, step)
        off = np.where(rows, off - by, 0.0)
        is_near = np.isfinite(step).all(axis=1) & (np.abs(moved[:, 0]) <= _NEAR_START)  # else nothing of the kind fits
        extent = np.array([np.ptp(start.target[start.used]) for start in chosen])
        is_last = (np.abs(by).max(axis=1) < _SETTLED * extent) | (rounds == _ROUNDS)
        # what the others say of a coordinate that is left out: its residual is predicted from theirs
        gain = own @ weight
        through = partials - gain @ partials
        variances = np.diagonal(own, axis1=1, axis2=2) - (gain * own).sum(axis=2)
        sd = np.sqrt(np.maximum(variances + ((through @ normals) * through).sum(axis=2), 0.0))
        residual, cost = _times(gain, off), 0.5 * (off * _times(weight, off)).sum(axis=1)
        for row in np.flatnonzero(is_near & is_last).tolist():
            start = chosen[row]
            placed = at.one(row).apply(start.source) + residual[row].reshape(-1, 3) + start.middle
            redundancy = int(np.count_nonzero(start.used)) - partials.shape[2]
            found[int(going[row])] = Fitted(start.change, float(cost[row]), redundancy, placed, sd[row].reshape(-1, 3))
        goes_on = np.asarray(is_near & ~is_last)
        going, at = going[goes_on], at.only(goes_on)
    return [found[index] for index in sorted(found)]


def _turned(spread: FloatArray, turns: FloatArray) -> FloatArray:
    """Return the covariances (s, m, m) of points after each of s linear maps (s, 3, 3) of all of them."""
    points = len(spread) // 3
    pairs = spread.reshape(points, 3, points, 3).swapaxes(1, 2).reshape(-1, 9)
    both = np.einsum("sab,scd->sbdac", turns, turns).reshape(-1, 9, 9)
    turned = (pairs @ both).reshape(-1, points, points, 3, 3)
    return np.asarray(turned.swapaxes(2, 3).reshape(-1, *spread.shape))


def _weights(covariances: FloatArray, rows: BoolArray) -> FloatArray:
    """Return the inverses (s, m, m) of the covariances of chosen rows (s, m), zero elsewhere."""
    both = rows[:, :, None] & rows[:, None, :]
    identity = np.eye(rows.shape[1])
    try:
        half = np.linalg.solve(np.linalg.cholesky(np.where(both, covariances, identity)), identity)
    except np.linalg.LinAlgError:
        inverse = np.zeros(covariances.shape)
        for matrix, covariance, chosen in zip(inverse, covariances, rows, strict=True):
            matrix[np.ix_(chosen, chosen)] = inverse_of_covariance(covariance[np.ix_(chosen, chosen)])
        return inverse
    return np.where(both, np.swapaxes(half, 1, 2) @ half, 0.0)


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray((matrices @ vectors[..., None])[..., 0])
