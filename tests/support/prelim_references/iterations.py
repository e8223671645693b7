"""The loop of least squares that the references share: many small robust problems side by side.

A problem knows its observations and unknowns: it solves its normal equations for one step, gives its residuals, turns
them into weights and says when it has converged. The loop repeats that; a step rule decides which steps are taken.
"""

from __future__ import annotations

from typing import Any, Generic, NamedTuple, Protocol, TypeVar, cast

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.compiled import LARGEST_TURN


class PrelimEstimate(Protocol):
    """The unknowns of k problems with their equations: a named tuple whose arrays have k rows."""

    @property
    def weights(self) -> FloatArray:
        """Weight factors (k, n) of the observations."""


E = TypeVar("E", bound=PrelimEstimate)


class PrelimProblem(Protocol[E]):
    """k problems of least squares that are solved side by side."""

    def stepped(self, at: E, damping: FloatArray) -> E:
        """Return the estimates after one step, with the weights of `at`.

        Raises
        ------
        LinAlgError
            If the normal equations cannot be solved with this damping (k,).
        """

    def reweighted(self, at: E) -> E:
        """Return the estimates with the weights that follow from their residuals."""

    def costs(self, at: E, weights: FloatArray) -> FloatArray:
        """Return the weighted square sums (k,) of the residuals of estimates."""

    def converged(self, before: E, after: E) -> BoolArray | bool:
        """Return which problems (k,) need no further step after one from `before` to `after`."""


class StepRule(Protocol):
    """Decides which steps are taken, and how they are damped."""

    damping: FloatArray

    def accepts(self, problem: PrelimProblem[E], best: E, tried: E) -> BoolArray:
        """Return which problems (k,) are better after a step than the best estimate so far."""

    def singular(self) -> None:
        """Note that the normal equations could not be solved."""

    @property
    def exhausted(self) -> BoolArray | bool:
        """Return which problems (k,) no step of any length improves."""


class GaussNewton:
    """Every step is taken in full."""

    damping = np.zeros(1)
    exhausted = False

    def accepts(self, _problem: PrelimProblem[E], _best: E, _tried: E) -> BoolArray:
        """Accept the step of every problem."""
        return np.ones(1, dtype=bool)

    def singular(self) -> None:
        """Give up: without damping the next step would be the same."""
        message = "the normal equations are singular"
        raise np.linalg.LinAlgError(message)


class Marquardt:
    """Steps that increase the square sum are refused and damped more (Levenberg 1944, Marquardt 1963).

    Parameters
    ----------
    damping : array (k,)
        Of the first step, as part of the diagonal of the normal equations.
    decrease, increase : float
        Factors of the damping after a step that was accepted or refused.
    least : float
        Smallest damping.
    largest : float
        Damping at which no further step can be expected to help.
    """

    def __init__(
        self, damping: FloatArray, decrease: float, increase: float, least: float = 0.0, largest: float = np.inf
    ) -> None:
        self.damping = damping
        self._decrease, self._increase, self._least, self._largest = decrease, increase, least, largest

    def accepts(self, problem: PrelimProblem[E], best: E, tried: E) -> BoolArray:
        """Return which problems have no larger square sum than before, with the same weights."""
        better = problem.costs(tried, best.weights) <= problem.costs(best, best.weights)
        factor = np.where(better, self._decrease, self._increase)
        self.damping = np.maximum(self.damping * factor, self._least)
        return np.asarray(better)

    def singular(self) -> None:
        """Damp the next step more."""
        self.damping = self.damping * self._increase

    @property
    def exhausted(self) -> BoolArray | bool:
        """Return which problems are damped so much that no step helps."""
        return np.asarray(self.damping >= self._largest)


class Iterated(NamedTuple, Generic[E]):
    """Where the iterations ended.

    Attributes
    ----------
    best : PrelimEstimate
    before : PrelimEstimate
        That from which the last step led to the best one.
    iterations : int
    """

    best: E
    before: E
    iterations: int


def least_squares(
    problem: PrelimProblem[E], start: E, rule: StepRule, most_steps: int, *, reweightings: int | None = None
) -> Iterated[E]:
    """Solve k problems by iterations.

    Parameters
    ----------
    problem : PrelimProblem
    start : PrelimEstimate
        With its weights.
    rule : StepRule
        `GaussNewton`, `Marquardt` or one like them.
    most_steps : int
        Fewer where all problems have converged or are exhausted before.
    reweightings : int, optional
        Number of steps after which the weights follow the residuals; later they are held, as some would alternate for
        ever. Without it they follow after all steps.

    Returns
    -------
    Iterated
    """
    best = before = start
    iteration = 0
    for iteration in range(1, most_steps + 1):
        try:
            tried = problem.stepped(best, rule.damping)
        except np.linalg.LinAlgError:
            rule.singular()
            continue
        accepted = rule.accepts(problem, best, tried)
        if reweightings is None or iteration <= reweightings:
            tried = problem.reweighted(tried)
        before, best = best, chosen(accepted, tried, best)
        if np.all(rule.exhausted | (accepted & problem.converged(before, best))):
            break
    return Iterated(best, before, iteration)


def chosen(rows: BoolArray, new: E, old: E) -> E:
    """Return estimates of which some problems (k,) are taken from new ones and the others from old ones."""
    if rows.all():
        return new
    if not rows.any():
        return old
    return cast("E", _merged(rows, new, old))


def _merged(rows: BoolArray, new: Any, old: Any) -> Any:
    """Merge arrays whose first axis is that of the problems, and named tuples of them."""
    if isinstance(new, tuple):
        return type(new)(*(_merged(rows, *pair) for pair in zip(new, old, strict=True)))
    return np.where(rows.reshape(-1, *[1] * (new.ndim - 1)), new, old)


def enlarged_diagonal(normals: FloatArray, damping: FloatArray | float, floor: FloatArray) -> FloatArray:
    """Return normal matrices (k, u, u) with a larger diagonal.

    Parameters
    ----------
    normals : array (k, u, u)
    damping : float or array (k,)
        Part of each element that is added to it.
    floor : array (k,)
        Added to all diagonal elements, so that what nothing determines keeps its value; where it is 0, 1 is added.
    """
    diagonal = np.einsum("kii->ki", normals)
    added = np.asarray(damping).reshape(-1, 1) * diagonal + np.where(floor > 0.0, floor, 1.0)[:, None]
    return np.asarray(normals + added[:, :, None] * np.eye(normals.shape[1]))


def largest_elements(normals: FloatArray) -> FloatArray:
    """Return the largest diagonal elements (k,) of normal matrices (k, u, u)."""
    return np.asarray(np.einsum("kii->ki", normals).max(axis=1))


def shortened(corrections: FloatArray, turns: FloatArray, largest: float = LARGEST_TURN) -> FloatArray:
    """Return corrections (k, u) that turn nothing by more than `largest` radians; `turns` (k,) are their rotations."""
    return corrections * np.minimum(1.0, largest / np.maximum(turns, 1e-300))[:, None]


def group_sums(index: IntArray, values: FloatArray, count: int) -> FloatArray:
    """Return the sums (count, ...) of the rows of values (n, ...) that have the same index (n,)."""
    columns = values.reshape(len(index), int(np.prod(values.shape[1:]))).T
    sums = np.empty((count, len(columns)))
    for place, column in enumerate(columns):
        sums[:, place] = np.bincount(index, column, count)
    return sums.reshape(count, *values.shape[1:])
