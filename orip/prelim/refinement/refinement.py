"""Refinement of a block's preliminary values: all photos and points in one least squares adjustment, weights robust.

It removes the drift that adding photo after photo leaves. Of unknown interior orientations no more is estimated than
keeps them from spoiling it (see `orip.prelim.refinement.camera_corrections`), and no standard deviations come of it:
that is what the bundle adjustment is for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orip.adjustment.weights import danish_weights
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.compiled import is_compiled
from orip.prelim.refinement.array_steps import ArraySolver
from orip.prelim.refinement.camera_corrections import no_corrections
from orip.prelim.refinement.compiled_steps import CompiledSolver
from orip.prelim.refinement.problem import Network, Residuals, State
from orip.records.preliminary import ImageRays

_LIMIT = 3.5
"""3.5: of residuals with two components one good one in 460 is longer."""

ROUGH = 1e-2
"""Relative gain in the weighted square sum below which a system is good enough to grow further."""

_ENOUGH = 0.5
"""Gain in the weighted square sum, over the variance of unit weight, below which nothing is off by much more than its
standard deviation: photos that hang together with the others by few points hardly show in the whole sum."""

_UPHILL, _UPHILL_STEPS = 10.0, 2
"""Times the weighted square sum up to which steps uphill are taken, and how many of them one after the other."""

_FIRST_DAMPING = 1e-6
"""What adding photo after photo leaves is mostly the bending of strips, whose eigenvalues are small."""

_LEAST_DAMPING = 1e-8
"""Keeps the reduced system regular where nothing holds the block, or a photo."""


@dataclass(frozen=True, slots=True)
class Refined:
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
    held_photos: BoolArray | None = None,
    enough: float = 0.0,
    sweeps: int = 30,
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
    held_points, held_photos : arrays (q,), (p,) of bool or None
        What is known and stays: control, photos oriented before. Without any the block keeps its place by damping.
    enough : float
        Relative gain in the weighted square sum at which the iterations end; 0: they go on until nothing is off by much
        more than its standard deviation.
    sweeps : int
        Largest number of iterations.

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
    held_photos = np.zeros(len(rays.photos), dtype=bool) if held_photos is None else held_photos
    corrections = no_corrections(rays) if corrections is None else corrections
    network, used = _network(rays, oriented, coordinates, held_points, held_photos)
    weight_factors = np.zeros(len(rays.photo))
    if not len(network.rays.photo):
        return Refined(rotations, centres, coordinates, corrections, weight_factors, 0.0, 0)
    # a system of the block's own size: damping treats angles and lengths alike
    base = np.nanmean(centres[oriented], axis=0)
    size = float(np.linalg.norm(coordinates[network.rays.point] - centres[network.rays.photo], axis=1).mean())
    start = State(rotations, (centres - base) / size, (coordinates - base) / size, corrections)
    state, factors, s0, iterations = _iterate(network, start, enough, sweeps)
    weight_factors[used] = factors
    moved_photos = np.zeros(len(rays.photos), dtype=bool)
    moved_photos[network.rays.photo] = network.photo_free[network.rays.photo]
    moved_points = np.zeros(len(rays.points), dtype=bool)
    moved_points[network.rays.point] = network.point_free[network.rays.point]
    return Refined(
        np.where(moved_photos[:, None, None], state.rotations, rotations),
        np.where(moved_photos[:, None], base + size * state.centres, centres),
        np.where(moved_points[:, None], base + size * state.points, coordinates),
        state.corrections,
        weight_factors,
        s0,
        iterations,
    )


def _network(
    rays: ImageRays, oriented: BoolArray, coordinates: FloatArray, held_points: BoolArray, held_photos: BoolArray
) -> tuple[Network, IntArray]:
    """Return what is adjusted, and the rays that take part: those of points that two photos see, or that are known."""
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
    network = Network(rays.of(rows), taking & ~held_photos, seen & ~held_points)
    return network, rows


class _Stand(NamedTuple):
    """Where the iterations stand: residuals, their robust scale, and weight factors (m,)."""

    state: State
    residuals: Residuals
    s0: float
    factors: FloatArray

    def cost(self, at: Residuals) -> float:
        """Return the weighted square sum of residuals with these weights, and of the cameras' corrections.

        A ray that has come to lie behind its photo counts as a large residual.
        """
        squares = np.where(at.in_front, np.sum(at.residual**2, axis=1), 1e6)
        return float(self.factors @ squares) + at.of_cameras


def _stand(network: Network, state: State, residuals: Residuals) -> _Stand:
    length = residuals.length
    s0 = network.scale(length)
    return _Stand(state, residuals, s0, danish_weights(length / max(s0, 1.0), _LIMIT))


def _iterate(network: Network, state: State, enough: float, sweeps: int) -> tuple[State, FloatArray, float, int]:
    """Return the state, weight factors (m,), s0 and the number of iterations.

    Along a bent valley a whole step often leads uphill and the next one far down: two are taken on trust. If that
    was for nothing it begins anew from where it was best, with more damping, and uphill no more.
    """
    solver = (CompiledSolver if is_compiled() else ArraySolver)(network)
    best = here = _stand(network, state, solver.residuals(state))
    iteration, gain, limit, damping = 0, np.inf, 0.0, _FIRST_DAMPING
    trust, refused = _UPHILL_STEPS, False
    while iteration < sweeps and gain > limit:
        iteration += 1
        try:
            tried = solver.moved(here.state, here.residuals, here.factors, damping)
        except np.linalg.LinAlgError:
            # the damping so far is less than rounding in normal equations that are nearly singular
            here, damping = best, damping * 10.0
            continue
        there = solver.residuals(tried)
        before, after = best.cost(best.residuals), best.cost(there)
        if after <= before:
            limit = enough * before or _ENOUGH * max(best.s0, 1.0) ** 2
            damping = max(damping * (1.0 if refused else 0.1), _LEAST_DAMPING)
            trust, refused = (trust if trust < 0 else _UPHILL_STEPS), False
            best = here = _stand(network, tried, there)
            # what new weights take back is no gain
            gain = min(before - after, abs(before - best.cost(there)))
        elif trust > 0 and after <= _UPHILL * before:
            trust -= 1
            here = _stand(network, tried, there)
        else:
            trust = -1 if here is not best else trust
            here, damping, refused = best, damping * 10.0, True
    return best.state, np.where(best.residuals.in_front, best.factors, 0.0), best.s0, iteration
