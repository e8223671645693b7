"""What is left out or taken back within one linearisation, and unknowns that nothing determines then."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from math import log

import numpy as np
from msgspec import Struct

from orip.adjustment.outlier_tests import OutlierTest
from orip.adjustment.residual_sums import TESTABLE, FactoredRows, JointEffects
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.solve import SolvedBlock

# Hypotheses of different size compete by the fall of the weighted square sum less the limit of their own test: a group
# wins over a single observation only if its further observations explain more than chance does.

_SEPARABLE = 2.0 * log(100.0)
"""Difference of square sums from which two hypotheses are told apart: one is a hundred times likelier."""


_ROUNDING = 1e-6
"""Square sums that differ by less are the same."""


class Choice(Struct, frozen=True):
    """A hypothesis (number of the candidate) that is left out or taken back.

    Parameters
    ----------
    statistic, limit : float
        Those it failed or fitted by.
    alternatives : tuple of int
        Candidates that explain the same misfit nearly as well, the likeliest first.
    """

    candidate: int
    statistic: float
    limit: float
    alternatives: tuple[int, ...] = ()


class Candidates(Struct, frozen=True, dict=True):
    """Hypotheses among the observations of a `JointEffects`.

    Parameters
    ----------
    places : sequence of arrays of int
        Of the observations of each.
    by_component : array (u,) of bool
        Tested by the largest w, and not as a whole.
    """

    places: Sequence[IntArray]
    by_component: BoolArray

    @cached_property
    def sizes(self) -> IntArray:
        """Return the number of observations (u,) of each."""
        return np.array([len(places) for places in self.places], dtype=np.int64)

    @cached_property
    def by_size(self) -> tuple[tuple[IntArray, IntArray], ...]:
        """Return candidates (v,) and their places (v, k) for each size k."""
        members = [np.flatnonzero(self.sizes == size) for size in np.unique(self.sizes)]
        return tuple((chosen, np.array([self.places[index] for index in chosen.tolist()])) for chosen in members)

    def touching(self, candidate: int) -> BoolArray:
        """Return which candidates (u,) share an observation with one."""
        own = set(self.places[candidate].tolist())
        return np.array([not own.isdisjoint(places.tolist()) for places in self.places])


class Assessment(Struct, frozen=True):
    """Test of u candidates: statistic and limit (u,), and by how much the square sum exceeds the limit of its fall."""

    statistic: FloatArray
    limit: FloatArray
    change: FloatArray
    freedom: IntArray
    excess: FloatArray

    @property
    def ratio(self) -> FloatArray:
        """Return statistic over limit (u,); 0 where nothing can be tested."""
        return np.where(np.isfinite(self.statistic), self.statistic, 0.0) / self.limit


def assess(effects: JointEffects, candidates: Candidates, test: OutlierTest) -> Assessment:
    """Test candidates: those in use for leaving out, those left out for taking back."""
    count = len(candidates.places)
    statistic, limit, change, excess = (np.zeros(count) for _ in range(4))
    freedom = np.zeros(count, dtype=np.int64)
    w = effects.normalised() / test.sigma0
    for chosen, places in candidates.by_size:
        found = effects.square_sum_changes(places)
        used = effects.in_use[places[:, 0]]
        limits = np.array([_group_limits(test, size) for size in range(places.shape[1] + 1)])
        own = limits[found.freedom, np.where(used, 0, 1)]
        root = np.sqrt(found.change) / test.sigma0
        change[chosen], freedom[chosen] = found
        excess[chosen] = root**2 - own**2
        largest = np.fmax.reduce(w[places], axis=1)
        of_one = np.where(used, test.limit(places.shape[1]), test.limit_of_left_out(places.shape[1]))
        single = candidates.by_component[chosen]
        statistic[chosen] = np.where(found.freedom > 0, np.where(single, largest, root), np.nan)
        limit[chosen] = np.where(single, of_one, own)
    return Assessment(statistic, limit, change, freedom, excess)


def _group_limits(test: OutlierTest, size: int) -> tuple[float, float]:
    return (test.group_limit(size), test.group_limit_of_left_out(size)) if size else (np.inf, np.inf)


def to_leave_out(
    effects: JointEffects,
    candidates: Candidates,
    test: OutlierTest,
    least_ratio: Callable[[float], float],
) -> Iterator[tuple[Choice, JointEffects]]:
    """Yield what fails, the likeliest first, each with the effects before it is left out.

    Parameters
    ----------
    effects : JointEffects
        Candidates that have an observation not in use take no part.
    least_ratio : callable
        Given the ratio of statistic to limit of the first choice, returns that down to which this linearisation is
        good enough.
    """
    open_ = np.array([effects.in_use[places].all() for places in candidates.places], dtype=bool)
    floor = 0.0
    now = assess(effects, candidates, test)
    while True:
        failing = open_ & (now.ratio > 1.0)
        if not failing.any():
            return
        best = int(np.where(failing, now.excess, -np.inf).argmax())
        floor = floor or least_ratio(float(now.ratio[best]))
        if now.ratio[best] < floor:
            return
        after = effects.changed(candidates.places[best])
        next_test = test.after(float(now.change[best]), int(now.freedom[best]))
        open_ &= ~candidates.touching(best)
        then = assess(after, candidates, next_test)
        equal = failing & open_ & ~(then.ratio > 1.0) & (_difference(now, best, test, next_test) < _SEPARABLE)
        yield _choice(now, best, equal), effects
        effects, test, now = after, next_test, then


def judged_again(effects: JointEffects, candidates: Candidates, test: OutlierTest, place: int) -> Choice | None:
    """Return what explains best what a candidate was left out for, now that all others are left out, too.

    When it was left out, other blunders still disturbed the comparison with its neighbours.

    Parameters
    ----------
    test : OutlierTest
        Of the adjustment without the candidate.
    place : int
        Of a candidate that is left out.

    Returns
    -------
    Choice or None
        None where nothing fails with the candidate in use.
    """
    out = assess(effects, candidates, test)
    test = test.after(-float(out.change[place]), -int(out.freedom[place]))
    back = effects.changed(candidates.places[place])
    now = assess(back, candidates, test)
    failing = np.array([back.in_use[own].all() for own in candidates.places], dtype=bool) & (now.ratio > 1.0)
    if not failing.any():
        return None
    best = int(np.where(failing, now.excess, -np.inf).argmax())
    if now.excess[best] <= now.excess[place] + _ROUNDING and failing[place]:
        best = place
    after = test.after(float(now.change[best]), int(now.freedom[best]))
    then = assess(back.changed(candidates.places[best]), candidates, after)
    explained = failing & ~candidates.touching(best) & ~(then.ratio > 1.0)
    return _choice(now, best, explained & (_difference(now, best, test, after) < _SEPARABLE))


def _choice(now: Assessment, best: int, equal: BoolArray) -> Choice:
    others = np.flatnonzero(equal)
    alternatives = tuple(others[np.argsort(-now.excess[others], kind="stable")].tolist())
    return Choice(best, float(now.statistic[best]), float(now.limit[best]), alternatives)


def _difference(now: Assessment, best: int, test: OutlierTest, after: OutlierTest) -> FloatArray:
    """Return by how much less other hypotheses explain than the best, as square sums of normal variables."""
    return np.asarray((now.excess[best] - now.excess) * (test.sigma0 / max(after.sigma0, 1e-300)) ** 2)


def to_take_back(effects: JointEffects, candidates: Candidates, test: OutlierTest) -> Iterator[Choice]:
    """Yield what fits although it was left out, the best first; each is in use when the next one is judged."""
    waiting = np.ones(len(candidates.places), dtype=bool)
    while waiting.any():
        now = assess(effects, candidates, test)
        ratio = np.where(waiting & np.isfinite(now.statistic), now.ratio, np.inf)
        best = int(ratio.argmin())
        if ratio[best] > 1.0:
            return
        yield Choice(best, float(now.statistic[best]), float(now.limit[best]))
        waiting &= ~candidates.touching(best)
        effects = effects.changed(candidates.places[best])
        test = test.after(-float(now.change[best]), -int(now.freedom[best]))


_MOVES = 0.05
"""An unknown is free if it moves by this part of its standard deviation with a free movement of unit length."""

_OWN_GROUPS = ("POINT", "THEODOLITE")


class FreedUnknowns(Struct, frozen=True):
    """What is no longer determined.

    Parameters
    ----------
    names : tuple of str
        Points, theodolite sets, photos and cameras.
    are_own : bool
        They are points and theodolite sets of the observations left out, and nothing else.
    """

    names: tuple[str, ...]
    are_own: bool


NOTHING_FREED = FreedUnknowns((), True)


def freed_unknowns(
    solved: SolvedBlock, rows: IntArray, factored: FactoredRows, out: IntArray, more: IntArray
) -> FreedUnknowns:
    """Return what is no longer determined when more observations are left out.

    Where the residuals of observations left out, with cofactors I - H, have a combination e that no other
    observation checks, all others are met for any size of the movement Q A^T e of the unknowns. It moves nothing but
    eliminated points where the part of W^T e in the reduced system is zero.

    Parameters
    ----------
    solved : SolvedBlock
        An adjustment in which these observations are in use; its design matrix is stored.
    rows : array (c,) of int
        Observations among all of the block.
    factored : FactoredRows
        W of these rows.
    out, more : arrays of int
        Places in `rows` of what is left out already, and of what is to be left out.
    """
    of_points = factored.of_points
    columns = of_points[more].indices
    near = np.unique(of_points[out][:, columns].tocoo().row) if len(out) and len(columns) else np.empty(0, np.int64)
    for others in (out[near], out):
        places = np.concatenate([more, others]).astype(np.int64)
        some = factored.of(places)
        values, vectors = np.linalg.eigh(np.eye(len(places)) - some.cofactor())
        free = vectors[:, values <= TESTABLE]
        if free.shape[1]:
            local = bool((np.linalg.norm(some.of_reduced @ free, axis=0) <= _MOVES).all())
            return _own_points(solved, rows[more]) if local else _moving(solved, rows[places], free)
    return NOTHING_FREED


def _own_points(solved: SolvedBlock, rows: IntArray) -> FreedUnknowns:
    columns = np.unique(solved.equations.design[rows].indices)
    return _named(solved, columns[columns >= solved.problem.layout.reduced], columns)


def _moving(solved: SolvedBlock, rows: IntArray, free: FloatArray) -> FreedUnknowns:
    design, cofactors = solved.equations.design[rows], solved.cofactors
    variance = np.concatenate([cofactors.reduced.diagonal(), np.einsum("bii->bi", cofactors.blocks).ravel()])
    scale = np.where(variance > 0.0, np.sqrt(np.where(variance > 0.0, variance, 1.0)), np.inf)
    movement = np.abs(solved.normals.solve(np.asarray(design.T @ free))) / scale[:, None]
    return _named(solved, np.flatnonzero(movement.max(axis=1) > _MOVES), np.unique(design.indices))


def _named(solved: SolvedBlock, columns: IntArray, touched: IntArray) -> FreedUnknowns:
    unknowns = [(column, name) for column in columns.tolist() if (name := solved.problem.unknowns.names[column])]
    own = set(touched.tolist())
    names = dict.fromkeys((name.group, name.name) for _, name in unknowns)
    return FreedUnknowns(
        tuple(f"{group.lower()} {name}" for group, name in names),
        all(column in own and name.group in _OWN_GROUPS for column, name in unknowns),
    )
