"""The Danish method: weights that fall with the standard residual, and which weight function an iteration uses."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.adjustment.equations import Equations
from orip.arrays import BoolArray, FloatArray, parts
from orip.set_aside import set_aside
from orip.structs import replace
from orip.threads import by_threads

# Krarup, Juhl and Kubik (1980) gave the principle. The function used here, exp(-u / c) above the limit c, is this
# program's choice among those found under that name: it does not diverge where the steeper ones do.

LEAST_WEIGHT = 1e-10
"""Smallest weight: unknowns that only down-weighted observations determine remain determined."""

_NO_INFLUENCE = 0.01
"""Weighted square of a residual that is of no influence."""

MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a standard normal residual."""

LIMIT_OF_TWO_COMPONENTS = 3.5
"""Limit c for the length of a residual with two components: one good residual in 460 is longer."""


def _least_weights(standard_residuals: FloatArray) -> FloatArray:
    """Return weights (n,) with which no residual has an influence, however large it is.

    Beside a projection centre residuals, and with them the partial derivatives, are of any size.
    """
    return np.minimum(LEAST_WEIGHT, _NO_INFLUENCE / np.maximum(standard_residuals, 1.0) ** 2)


def danish_weights(standard_residuals: FloatArray, limit: float) -> FloatArray:
    """Return weight factors (0, 1]: 1 up to the limit, exp(-u / c) above it.

    Parameters
    ----------
    standard_residuals : array (n,)
        u = |v| / a-priori error after the iteration before.
    limit : float
        c.

    Returns
    -------
    array (n,)
    """
    reduced = np.maximum(np.exp(-standard_residuals / limit), _least_weights(standard_residuals))
    return np.where(standard_residuals <= limit, 1.0, reduced)


def danish_costs(standard_residuals: FloatArray, limit: float) -> FloatArray:
    """Return what each residual adds to the robust cost: the integral of u wf(u), at most `greatest_danish_cost`.

    Iterations with weights computed again minimise the sum of these costs (Holland and Welsch 1977).

    Parameters
    ----------
    standard_residuals : array (n,)

    Returns
    -------
    array (n,)
        u²/2 up to the limit c, c² (1/2 + 2/e - (1 + u/c) exp(-u/c)) above it.
    """
    parts = np.maximum(standard_residuals, limit) / limit
    above = greatest_danish_cost(limit) - limit**2 * (1.0 + parts) * np.exp(-parts)
    return np.where(standard_residuals <= limit, standard_residuals**2 / 2.0, above)


def greatest_danish_cost(limit: float) -> float:
    """Return what a residual of any size adds to the robust cost at most."""
    return limit**2 * (0.5 + 2.0 / float(np.e))


def wide_weights(standard_residuals: FloatArray, limit: float, exponent: int) -> FloatArray:
    """Return weight factors for iterations that are not near the solution yet: 1 up to the limit L, (L / u)^p above it.

    They fall more slowly than the Danish weights, since large residuals may come from a photo whose orientation is
    still wrong, which must stay tied to the block.

    Parameters
    ----------
    standard_residuals : array (n,)
    exponent : int
        2; or 3 where many observations are wrong: it falls fast enough that a fifth of these does not move the block.
    """
    reduced = (limit / np.maximum(standard_residuals, limit)) ** exponent
    return np.maximum(reduced, _least_weights(standard_residuals))


def wide_costs(standard_residuals: FloatArray, limit: float) -> FloatArray:
    """Return what each residual adds to the cost that wide weights of exponent 3 minimise: L² (3/2 - L / u) above L."""
    above = limit**2 * (1.5 - limit / np.maximum(standard_residuals, limit))
    return np.where(standard_residuals <= limit, standard_residuals**2 / 2.0, above)


def robust_scale(standard_residuals: FloatArray) -> float:
    """Return the scale of residuals, most of which are normal: the median of their sizes over that of normal ones.

    Up to half of them may be of any size. 1 without residuals.
    """
    if not len(standard_residuals):
        return 1.0
    return float(np.median(standard_residuals)) / MEDIAN_OF_NORMAL


# See docs/decisions/006 and 015.

SETTLED_ENP = 1.0
"""Corrections a tenth of their standard deviations: residuals no longer depend on the starting values."""

_LONG_SETTLING, _LONGEST_SETTLING = 7, 30
"""Iterations after which the Danish method begins where the residuals no longer fall, and in any case: with many
blunders ENP may never reach that limit."""

_ON_THE_WAY_ENP, _STILL_FALLS = 0.0, 0.9
"""Corrections larger than their standard deviations, and the part of the least scale of the residuals so far below
which they still fall: photos are on their way then, and the Danish method would leave out at once what leads them."""

_FAR_OFF = 1.5
"""A-priori errors that are right within this factor are not replaced by the scale of the residuals."""

_OF_COMPUTED_DATA = 0.1
"""A smaller scale comes from observations without errors: it says nothing of how they would be measured."""

_SAME_SCALE = 0.2
"""Logarithm of the ratio of two scales that are the same: with the least redundancy each is known to 12 %."""

_MOST_ESTIMATES = 4

_MANY, _MANY_PART = 40, 0.0025
"""Observations that do not fit, at least, and the part of all, as in tracks of feature matching: so many carry blocks
and others away. Fewer are left to the weights."""

_TRACKS = 200
"""Observations that do not fit, at least, where they come from feature matching: what was measured as one is wrong as a
whole then. In blocks of some hundred observations it would depend on the starting values."""

_TESTABLE, _LEAST_REDUNDANCY = 0.05, 100.0
"""Least redundancy number of a residual that the scale is estimated from, and the least sum of these numbers: the scale
is then known to 12 % (the standard deviation of such a median is 1.17 / sqrt(redundancy))."""


class Weighing(Struct, frozen=True):
    """The phase of weighting that the iterations are in.

    Parameters
    ----------
    limit : float
        Standard residual above which the Danish method reduces a weight.
    start : int or None
        First iteration in which the Danish method may reduce weights; None: all weights are 1.
    settled_after : int or None
        Iterations until the residuals no longer depended on the starting values; None: they still do.
    early : bool
        Exceptionally large residuals lose weight before the Danish method; else all weights are 1 until then.
    scale : float
        Of the observations, in a-priori errors: 1 unless these are far off.
    estimates : int
        How many times it was estimated; the most once it no longer changes.
    crowded, of_tracks : bool
        Many observations did not fit when the state had settled; so many that they come from feature matching.
    least : float
        Scale of the residuals, the least of the iterations before it had settled.
    """

    limit: float
    start: int | None
    settled_after: int | None = None
    early: bool = True
    scale: float = 1.0
    estimates: int = 0
    crowded: bool = False
    of_tracks: bool = False
    least: float = np.inf

    @property
    def final_limit(self) -> float:
        """Return the standard residual up to which an observation keeps its full weight in the solution."""
        return self.limit * self.scale

    def factors(self, equations: Equations, iteration: int) -> FloatArray:
        """Return the weight factors (n,) for an iteration; exact constraints always have 1."""
        factors = np.ones(len(equations.residual))
        if self.start is None or not (self.early or iteration >= self.start):
            return set_aside(factors)
        judged = _judged(equations)
        limit = self.limit * self.scale_in(equations, iteration)
        grouped = self._grouped(equations, iteration, limit)
        size = grouped.sizes(equations.residual, judged)[judged]
        if self.has_begun_in(iteration):
            factors[judged] = danish_weights(size, limit)
        else:
            factors[judged] = wide_weights(size, limit, 3 if _are_many(size > limit) else 2)
        return set_aside(factors)

    def _grouped(self, equations: Equations, iteration: int, limit: float) -> Equations:
        """Return the equations with the groups of observations that lose weight together in an iteration."""
        if self.has_begun_in(iteration):
            as_wholes = self.of_tracks
        else:
            judged = _judged(equations)
            as_wholes = _are_of_tracks(equations.sizes(equations.residual, judged)[judged] > limit)
        return equations.with_wider_groups() if as_wholes else equations

    def cost_in(self, equations: Equations, iteration: int, residuals: FloatArray) -> float:
        """Return the cost that an iteration from some equations minimises, at residuals (n,) of these.

        For iterations in which many weights are reduced.
        """
        judged = _judged(equations)
        if self.start is None:
            return float(np.sum(residuals[judged] ** 2) / 2.0)
        limit = self.limit * self.scale_in(equations, iteration)
        grouped = self._grouped(equations, iteration, limit)
        size = grouped.sizes(residuals, judged)[judged]
        parts = (danish_costs if self.has_begun_in(iteration) else wide_costs)(size, limit)
        return float((parts * grouped.shares(judged)[judged]).sum())

    def scale_in(self, equations: Equations, iteration: int) -> float:
        """Return the scale of the limit in an iteration: before the Danish method begins, that of the residuals."""
        if self.start is None or self.has_begun_in(iteration):
            return self.scale
        return max(robust_scale(np.abs(equations.residual[_judged(equations)])), 1.0)

    def is_crowded_in(self, iteration: int, equations: Equations, weights: FloatArray) -> bool:
        """Return whether many observations do not fit: in an iteration with some weights, and once settled for good."""
        return self.crowded if self.has_begun_in(iteration) else has_many_reduced(equations, weights)

    def has_begun_with_tracks_in(self, iteration: int) -> bool:
        """Return whether an iteration has the weights of the Danish method for tracks of feature matching."""
        return self.of_tracks and self.has_begun_in(iteration)

    def has_begun_in(self, iteration: int) -> bool:
        """Return whether an iteration has the weights of the Danish method."""
        return self.settled_after is not None and self.start is not None and iteration >= self.start

    def cost(self, equations: Equations) -> float:
        """Return the robust cost of the Danish method; what cannot be computed counts as the largest residual.

        Half the square sum where all weights are 1.
        """
        judged = _judged(equations)
        if self.start is None:
            return float(np.sum(equations.residual[judged] ** 2) / 2.0)
        grouped = equations.with_wider_groups() if self.of_tracks else equations
        of_judged = danish_costs(grouped.sizes(equations.residual, judged)[judged], self.final_limit)
        of_judged *= grouped.shares(judged)[judged]
        lost = int(np.count_nonzero(~equations.active))
        return float(of_judged.sum()) + lost * greatest_danish_cost(self.final_limit)

    def with_many_reduced(self, equations: Equations, weights: FloatArray) -> Weighing:
        """Return the weighing of a block that has settled with many weights (n,) reduced."""
        return replace(self, crowded=True, of_tracks=_are_of_tracks(weights[_judged(equations)] < 1.0))

    def after(self, iteration: int, enp: float, equations: Equations) -> Weighing:
        """Return the phase that follows an iteration, which led to some equations."""
        if self.settled_after is not None:
            return self
        if enp >= SETTLED_ENP or iteration >= _LONGEST_SETTLING:
            return replace(self, settled_after=iteration)
        scale = self.scale_in(equations, iteration)
        on_the_way = enp < _ON_THE_WAY_ENP and scale < _STILL_FALLS * self.least
        if iteration >= _LONG_SETTLING and not on_the_way:
            return replace(self, settled_after=iteration)
        return replace(self, least=min(scale, self.least))

    def scaled(self, equations: Equations, redundancy_numbers: FloatArray, among: BoolArray | None = None) -> Weighing:
        """Return the weighing with the scale of the residuals, where the a-priori errors are far off.

        The parameters are those of `scale_of_observations`.
        """
        scale = scale_of_observations(equations, redundancy_numbers, among)
        is_far_off = not 1.0 / _FAR_OFF <= scale <= _FAR_OFF
        used = scale if is_far_off and scale >= _OF_COMPUTED_DATA else 1.0
        # what the scale of a converged solution changes by less is not known better
        same = abs(np.log(used / self.scale)) < _SAME_SCALE
        estimates = _MOST_ESTIMATES if same else self.estimates + 1
        return replace(self, scale=self.scale if same else used, estimates=estimates)

    @property
    def is_scale_in_doubt(self) -> bool:
        """Return whether the scale has changed the limit, and the residuals since then may show another one."""
        return self.crowded and self.estimates < _MOST_ESTIMATES

    def is_final_in(self, iteration: int) -> bool:
        """Return whether an iteration had the weight function that the solution has: all 1, or the Danish method."""
        return self.start is None or (self.settled_after is not None and iteration > self.iterations_before)

    @property
    def iterations_before(self) -> int:
        """Return the number of iterations before the Danish method began; 0 as long as it has not."""
        if self.start is None or self.settled_after is None:
            return 0
        return max(self.settled_after, self.start - 1)


def weighing_from(limit: float, start: int | None, *, early: bool) -> Weighing:
    """Return the phase to begin with; without early weights the Danish method waits for nothing but its iteration."""
    return Weighing(limit, start) if early or start is None else Weighing(limit, start, start - 1, early=False)


def has_many_reduced(equations: Equations, weights: FloatArray) -> bool:
    """Return whether weights (n,) are reduced as often as in tracks of feature matching."""

    def counts(part: slice) -> tuple[int, int]:
        judged = equations.active[part] & ~equations.exact[part]
        return int(np.count_nonzero(judged & (weights[part] < 1.0))), int(np.count_nonzero(judged))

    reduced, judged = np.sum([(0, 0), *by_threads(counts, parts(len(weights)))], axis=0)
    return _is_many(int(reduced), int(judged))


def sums_of_full_weight(equations: Equations, weights: FloatArray) -> tuple[int, int, float]:
    """Return how many observations are active, how many of these have a weight (n,) of 1, and their square sum.

    The residuals of exact constraints are not in the sum.
    """

    def counts(part: slice) -> tuple[int, int, float]:
        active = equations.active[part]
        full = active & (weights[part] >= 1.0)
        judged = np.where(full & ~equations.exact[part], equations.residual[part], 0.0)
        return int(np.count_nonzero(active)), int(np.count_nonzero(full)), float(judged @ judged)

    of_parts = [(0, 0, 0.0), *by_threads(counts, parts(len(weights)))]
    active, full, square_sum = (sum(column) for column in zip(*of_parts, strict=True))
    return int(active), int(full), float(square_sum)


def _are_many(wrong: BoolArray) -> bool:
    return _is_many(int(np.count_nonzero(wrong)), len(wrong))


def _is_many(wrong: int, of_all: int) -> bool:
    return wrong >= max(_MANY, _MANY_PART * of_all)


def _are_of_tracks(wrong: BoolArray) -> bool:
    return _are_many(wrong) and bool(np.count_nonzero(wrong) >= _TRACKS)


def scale_of_observations(
    equations: Equations, redundancy_numbers: FloatArray, among: BoolArray | None = None
) -> float:
    """Return how large the errors of observations are, in a-priori errors; 1 where too few are checked by others.

    The median of the residuals over the roots of their redundancy numbers: residuals show a part of the errors only.

    Parameters
    ----------
    redundancy_numbers : array (n,)
    among : array (n,) of bool, optional
        Observations that are looked at; otherwise all.
    """
    tested = _judged(equations) if among is None else _judged(equations) & among
    tested &= np.nan_to_num(redundancy_numbers) > _TESTABLE
    if np.sum(redundancy_numbers[tested]) < _LEAST_REDUNDANCY:
        return 1.0
    return robust_scale(np.abs(equations.residual[tested]) / np.sqrt(redundancy_numbers[tested]))


def _judged(equations: Equations) -> BoolArray:
    return equations.active & ~equations.exact
