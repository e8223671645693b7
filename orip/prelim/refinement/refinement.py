"""Refinement of a block's preliminary values: all photos and points in one least squares adjustment, weights robust.

It removes the drift that accumulates as photo after photo is added. Of unknown interior orientations only as much is
estimated as is needed to keep them from distorting the block (see `orip.prelim.refinement.problem`).
Standard deviations are left to the bundle adjustment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import LEAST_WEIGHT, LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.least_squares import LARGEST_TURN, E, PrelimProblem, least_squares
from orip.prelim.rays import ImageRays
from orip.prelim.refinement.array_steps import ArraySolver
from orip.prelim.refinement.problem import (
    EXPECTED,
    MEDIAN_LENGTH,
    RayResiduals,
    RefinementProblem,
    RefinementState,
    no_corrections,
)

ROUGH = 1e-2
"""Relative gain in the weighted square sum below which a system is good enough to grow further."""

_ENOUGH = 0.5
"""Gain in the weighted square sum, over the variance of unit weight, below which nothing is off by much more than its
standard deviation: photos connected with the others by few points hardly affect the whole sum."""

_UPHILL, _UPHILL_STEPS = 10.0, 2
"""Multiple of the weighted square sum up to which uphill steps are taken, and how many of them in succession."""

_NEVER_AGAIN = -1

_MOST_STEPS = 30

_FIRST_DAMPING = 1e-6
"""Small, as the drift of added photos is mostly a bending of strips, whose eigenvalues are small."""

_LEAST_DAMPING = 1e-8
"""Keeps the reduced system regular where nothing holds the block, or a photo."""


class Refined(Struct, frozen=True):
    """A refined block.

    Parameters
    ----------
    rotations : array (p, 3, 3)
    centres : array (p, 3)
    coordinates : array (q, 3)
    corrections : array (cameras, 4)
        Of the unknown cameras.
    weight_factors : array (n,)
        Of the rays; 0 for rays that took no part.
    s0 : float
        Robust scale of the residuals against the a-priori errors; 0 without redundancy.
    iterations : int
    """

    rotations: FloatArray
    centres: FloatArray
    coordinates: FloatArray
    corrections: FloatArray
    weight_factors: FloatArray
    s0: float
    iterations: int


def refine(
    rays: ImageRays,
    rotations: FloatArray,
    centres: FloatArray,
    oriented: BoolArray,
    coordinates: FloatArray,
    *,
    corrections: FloatArray | None = None,
    held_points: BoolArray | None = None,
    enough: float = 0.0,
) -> Refined:
    """Adjust photos and points together.

    Parameters
    ----------
    rays : ImageRays
    rotations : array (p, 3, 3)
        Photo to ground.
    centres : array (p, 3)
    oriented : array (p,) of bool
        Other photos stay as they are, and their rays take no part.
    coordinates : array (q, 3)
        NaN for a point without a position: its rays take no part.
    corrections : array (cameras, 4) or None
        Of the unknown cameras; 0 unless given.
    held_points : array (q,) of bool or None
        Control that is known and stays. Without any the block keeps its place by damping.
    enough : float
        Relative gain in the weighted square sum at which the iterations end; 0: they go on until nothing is off by much
        more than its standard deviation.

    Returns
    -------
    Refined

    Notes
    -----
    Gauss-Newton with Marquardt's (1963) damping and weights of the Danish method (Krarup, Juhl and Kubik 1980), whose
    scale is the median of the residuals. Points are eliminated; the reduced system of the photos, ordered by reverse
    Cuthill-McKee (1969), is solved as a band (Brown's 1976 arrangement of a block).
    """
    held_points = np.zeros(len(rays.points), dtype=bool) if held_points is None else held_points
    corrections = no_corrections(rays) if corrections is None else corrections
    do = _in_compiled_loop if is_compiled() else _with_arrays
    return do(rays, RefinementState(rotations, centres, coordinates, corrections), oriented, held_points, enough)


def _in_compiled_loop(
    rays: ImageRays, block: RefinementState, oriented: BoolArray, held_points: BoolArray, enough: float
) -> Refined:
    """Do what `_with_arrays` does in the compiled loop."""
    found = block.rotations.copy(), block.centres.copy(), block.points.copy(), block.corrections.copy()
    weights, scale, cameras = np.empty(len(rays.photo)), np.empty(1), rays.cameras
    of_rays = map(np.ascontiguousarray, (rays.photo, rays.point, rays.vectors, rays.error))
    iterations = kernels.refine(
        *of_rays, cameras.of_photo, cameras.unknown, oriented, held_points, _rules(enough), *found, weights, scale
    )
    return Refined(*found, weights, float(scale[0]), iterations)


def _rules(enough: float) -> FloatArray:
    """Return the numbers of `RefinementRules` in robust_iterations.h."""
    return np.array(
        [
            MEDIAN_LENGTH, LIMIT_OF_TWO_COMPONENTS, LEAST_WEIGHT, LARGEST_TURN, _UPHILL, _UPHILL_STEPS, _MOST_STEPS,
            _FIRST_DAMPING, _LEAST_DAMPING, _ENOUGH, enough, *EXPECTED.tolist(),
        ]
    )  # fmt: skip


def _with_arrays(
    rays: ImageRays, block: RefinementState, oriented: BoolArray, held_points: BoolArray, enough: float
) -> Refined:
    rotations, centres, coordinates, corrections = block.rotations, block.centres, block.points, block.corrections
    problem, used = _problem(rays, oriented, coordinates, held_points)
    weight_factors = np.zeros(len(rays.photo))
    if not len(problem.rays.photo):
        return Refined(rotations, centres, coordinates, corrections, weight_factors, 0.0, 0)
    # a system of the block's own size: damping treats angles and lengths alike
    base = centres[oriented].mean(axis=0)
    size = float(np.linalg.norm(coordinates[problem.rays.point] - centres[problem.rays.photo], axis=1).mean())
    start = RefinementState(rotations, (centres - base) / size, (coordinates - base) / size, corrections)
    robust = _RobustRefinement(problem, enough)
    found = least_squares(robust, robust.start(start), _UphillSteps(), _MOST_STEPS)
    state, s0, iterations = found.best.state, found.best.s0, found.iterations
    weight_factors[used] = found.best.weights
    moved_photos = np.zeros(len(rays.photos), dtype=bool)
    moved_photos[problem.rays.photo] = problem.photo_free[problem.rays.photo]
    moved_points = np.zeros(len(rays.points), dtype=bool)
    moved_points[problem.rays.point] = problem.point_free[problem.rays.point]
    return Refined(
        np.where(moved_photos[:, None, None], state.rotations, rotations),
        np.where(moved_photos[:, None], base + size * state.centres, centres),
        np.where(moved_points[:, None], base + size * state.points, coordinates),
        state.corrections,
        weight_factors,
        s0,
        iterations,
    )


def _problem(
    rays: ImageRays, oriented: BoolArray, coordinates: FloatArray, held_points: BoolArray
) -> tuple[RefinementProblem, IntArray]:
    """Return the problem, and the rays that take part: those of points that two photos see, or that are known."""
    known = np.asarray(np.isfinite(coordinates).all(axis=1), dtype=bool)
    used = oriented[rays.photo] & known[rays.point]
    number = np.bincount(rays.point[used], minlength=len(rays.points))
    used &= (number >= 2)[rays.point] | held_points[rays.point]
    rows = np.flatnonzero(used)
    rows = rows[np.argsort(rays.point[rows], kind="stable")]
    seen = np.zeros(len(rays.points), dtype=bool)
    seen[rays.point[rows]] = True
    taking = np.zeros(len(rays.photos), dtype=bool)
    taking[rays.photo[rows]] = True
    problem = RefinementProblem(rays.of(rows), taking, seen & ~held_points)
    return problem, rows


class _Estimate(NamedTuple):
    """Where the iterations stand: residuals, their robust scale, and weight factors (m,)."""

    state: RefinementState
    residuals: RayResiduals
    s0: float
    weights: FloatArray


class _RobustRefinement:
    """The least squares problem of a refinement, with weights of the Danish method."""

    def __init__(self, problem: RefinementProblem, enough: float) -> None:
        self._problem, self._enough = problem, enough
        self._solver = ArraySolver(problem)

    def start(self, state: RefinementState) -> _Estimate:
        return self.reweighted(_Estimate(state, self._solver.residuals(state), 0.0, np.empty(0)))

    def stepped(self, here: _Estimate, damping: FloatArray) -> _Estimate:
        state = self._solver.moved(here.state, here.weights, float(damping[0]))
        return here._replace(state=state, residuals=self._solver.residuals(state))

    def reweighted(self, here: _Estimate) -> _Estimate:
        weights, s0 = self._solver.weights(here.residuals.lengths)
        return here._replace(s0=s0, weights=weights)

    def costs(self, here: _Estimate, weights: FloatArray) -> FloatArray:
        """Return the weighted square sum (1,) of residuals and of the cameras' corrections.

        A ray that has come to lie behind its photo counts as a large residual.
        """
        return np.array([weights @ here.residuals.squares + here.residuals.of_cameras])

    def converged(self, before: _Estimate, after: _Estimate) -> bool:
        """Return whether the gain is small, both with the weights before the step and with the new ones."""
        cost, improved, reweighted = (
            float(self.costs(at, weights)[0])
            for at, weights in ((before, before.weights), (after, before.weights), (after, after.weights))
        )
        gain = min(cost - improved, abs(cost - reweighted))
        return gain <= (self._enough * cost or _ENOUGH * max(before.s0, 1.0) ** 2)


class _UphillSteps:
    """Marquardt's damping that allows for steps uphill.

    Along a curved valley a full step often leads uphill and the next one far down: two such steps are taken. If they do
    not help, the iterations go back to the best estimate with more damping, and no further uphill steps are taken.
    """

    exhausted = False

    def __init__(self) -> None:
        self.damping = np.array([_FIRST_DAMPING])
        self.on_trust = False
        self._steps_left, self._refused = _UPHILL_STEPS, False

    def accepts(self, problem: PrelimProblem[E], best: E, tried: E) -> BoolArray:
        """Return whether the square sum is no larger; otherwise decide whether to go on from there nevertheless."""
        before, after = problem.costs(best, best.weights)[0], problem.costs(tried, best.weights)[0]
        was_on_trust, self.on_trust = self.on_trust, False
        if after <= before:
            self.damping = np.maximum(self.damping * (1.0 if self._refused else 0.1), _LEAST_DAMPING)
            self._refused = False
            if self._steps_left >= 0:
                self._steps_left = _UPHILL_STEPS
            return np.array([True])
        if self._steps_left > 0 and after <= _UPHILL * before:
            self.on_trust = True
            self._steps_left -= 1
            return np.array([False])
        if was_on_trust:
            self._steps_left = _NEVER_AGAIN
        self.singular()
        self._refused = True
        return np.array([False])

    def singular(self) -> None:
        """Damp the next step more: the damping so far was less than rounding in nearly singular equations."""
        self.damping, self.on_trust = self.damping * 10.0, False
