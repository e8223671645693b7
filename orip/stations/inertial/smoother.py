"""Smoothing: one factor graph of preintegrated inertial data and positions, solved by GTSAM.

States are the poses, velocities and biases at the epochs of the receiver, and once a second where it has none.

The residuals of preintegrated samples have the errors of both kinds of sensor. Of a part T of their covariance C, with
residuals v of covariance Q, the square of the factor is v' C^-1 T C^-1 v over the trace of C^-1 T C^-1 Q, its share of
the redundancy (Förstner 1979, Ein Verfahren zur Schätzung von Varianz- und Kovarianzkomponenten, AVN 86).

Small units that are shaken are far noisier than at rest, and accelerometers by another factor than gyroscopes. The
walks of biases stay as they are said: a flight has too little redundancy for them.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import astuple
from scipy.stats import chi2

from orip.arrays import FloatArray, IntArray
from orip.stations.inertial.alignment import align, stands_at
from orip.stations.inertial.common_errors import velocity_delay
from orip.stations.inertial.filter import Filtered, filtered_values, run_filter
from orip.stations.inertial.graph import Factors, Graph
from orip.stations.inertial.samples import Fixes, ImuNoise, Observed
from orip.stations.inertial.solution import Solved

_LEAST_REDUNDANCY, _CHANCE = 20.0, 0.001
"""Of a group whose factor is estimated; with less, it is where vPv is that improbable by what was given."""

_SLOWEST = 0.9
"""Largest ratio of successive changes of logarithms that is believed."""


def white_noise(solved: Solved) -> FloatArray:
    """Return the covariances (2, k - 1, 15, 15) of preintegrated samples by the white noise given of each kind.

    The kinds are gyroscopes and accelerometers; the rows are rotation, position, velocity and biases.
    """
    graph, states = solved.graph, solved.trajectory
    given = graph.observed.noise
    kinds = [
        ImuNoise(given.gyro, 0.0, 0.0, 0.0, 0.0, 0.0),
        ImuNoise(0.0, given.accelerometer, 0.0, 0.0, 0.0, 0.0),
    ]
    found = np.empty((2, len(graph.times) - 1, 15, 15))
    for at in range(1, len(graph.times)):
        bias = solved.values.atConstantBias(graph.b(at - 1))
        for kind, noise in enumerate(kinds):
            pim = graph.preintegrated(at, states.place[at - 1], bias, noise, integration=0.0)
            found[kind, at - 1] = pim.preintMeasCov()
    return found


def estimated_factors(solved: Solved, white: FloatArray) -> Factors:
    """Return by what the deviations of each group are to be multiplied, with the `white_noise` as it was given.

    A kind of sensor that has too little redundancy by itself takes the factor of both.
    """
    factors = solved.graph.factors
    residual, covariance = solved.unit_residuals()
    root = solved.unit_roots()
    scale = np.square([factors.gyro, factors.accelerometer])[:, None, None, None]
    share = scale * (root @ white @ np.swapaxes(root, 1, 2))
    square_sum = np.einsum("ki,tkij,kj->t", residual, share, residual)
    redundancy = np.einsum("tkij,kji->t", share, covariance)
    both = _factor(float(square_sum.sum()), float(redundancy.sum()), factors.gyro)
    own = np.sqrt(square_sum / np.maximum(redundancy, _LEAST_REDUNDANCY))
    unit = np.where((redundancy > _LEAST_REDUNDANCY) & (own > 0.0), own, both)
    return Factors(float(unit[0]), float(unit[1]), *_receiver_factors(solved))


def _receiver_factors(solved: Solved) -> tuple[float, float]:
    """Return the factors of positions and velocities: roots of vPv over their redundancy.

    The redundancy of a fix is 3 less the trace of its computed covariance in units of its own.
    """
    trajectory, fixes, sums = solved.trajectory, solved.graph.fixes, solved.square_sums()
    states = np.flatnonzero(trajectory.fix >= 0)
    ratio = np.linalg.solve(fixes.covariance, trajectory.place_covariance[states])
    place = 3.0 * len(states) - float(np.trace(ratio, axis1=1, axis2=2).sum())
    has = np.isfinite(fixes.velocity).all(axis=1) & np.isfinite(fixes.velocity_deviation).all(axis=1)
    known = np.diagonal(trajectory.velocity_covariance[states[has]], axis1=1, axis2=2)
    speed = 3.0 * int(has.sum()) - float((known / fixes.velocity_deviation[has] ** 2).sum())
    factors = solved.graph.factors
    return _factor(sums["position"], place, factors.position), _factor(sums["velocity"], speed, factors.velocity)


def _factor(square_sum: float, redundancy: float, before: float) -> float:
    """Return the factor of a group, beside that before; 1 where its redundancy is too small to leave what was given."""
    if square_sum <= 0.0 or redundancy <= 0.0:
        return 1.0
    chance = min(chi2.sf(square_sum, redundancy), chi2.cdf(square_sum, redundancy))
    is_known = redundancy > _LEAST_REDUNDANCY or chance < _CHANCE or before != 1.0
    return float(np.sqrt(square_sum / redundancy)) if is_known else 1.0


def accelerated(change: Factors, before: Factors) -> Factors:
    """Return a change of the factors with those that would follow it, as it follows the one before (Aitken).

    One that is larger than the one before, or goes back, is taken as it is.
    """
    now, last = (np.log(np.array(astuple(part))) for part in (change, before))
    ratio = np.divide(now, last, out=np.zeros(4), where=last != 0.0)
    ratio = np.where((ratio > 0.0) & (ratio < 1.0), np.minimum(ratio, _SLOWEST), 0.0)
    return Factors(*np.exp(now / (1.0 - ratio)).tolist())


_LONGEST_STEP = 1.0
_MOST_ESTIMATES = 20
_SETTLED, _NEARLY = 1.03, 1.3
"""Changes of factors with which no more are made, and with which their size is about known."""

_SETTLED_DELAY = 0.001


def smooth(observed: Observed, wanted: FloatArray | None = None, *, estimates_noise: bool = True) -> Solved:
    """Return the smoothed trajectory between the first and the last fix that the inertial data cover.

    Parameters
    ----------
    wanted : array (w,), optional
        Times that have states of their own, such as those of exposures.
    estimates_noise : bool
        The standard deviations of the groups of observations are multiplied by what their residuals ask for, and
        velocities that are late are taken ahead.
    """
    alignment = align(observed)
    times, fix = state_times(observed.fixes, np.zeros(0) if wanted is None else wanted)
    stands = stands_at(observed.imu, observed.fixes, times)
    # a unit that stands is quieter than one that moves: noise is estimated without what is known of standing
    graph = Graph(observed, times, fix, Factors(), alignment, stands & (not estimates_noise))
    solved = Solved(graph, filtered_values(graph))
    white, before = white_noise(solved) if estimates_noise else np.empty(0), Factors()
    for _ in range(_MOST_ESTIMATES - 1 if estimates_noise else 0):
        change, delay = estimated_factors(solved, white), graph.delay
        step = accelerated(change, before)
        if step.are_within(_NEARLY):  # with deviations that are far too small everything would be significant
            delay = velocity_delay(solved)
        is_in_time = abs(delay - graph.delay) < _SETTLED_DELAY
        if is_in_time and step.are_within(_SETTLED):
            break
        # residuals with another delay say nothing of those without
        before = change if is_in_time else Factors()
        graph = Graph(observed, times, fix, graph.factors.times(step), alignment, graph.stands, delay)
        solved = Solved(graph, solved.values)
    if estimates_noise and stands.any():
        solved = Solved(Graph(observed, times, fix, graph.factors, alignment, stands, graph.delay), solved.values)
    return solved


def filter_as(solved: Solved) -> Filtered:
    """Return what the filter alone finds, with the noise of the smoothed trajectory."""
    return run_filter(solved.graph)


def state_times(fixes: Fixes, wanted: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the times of states, and the fix of each; -1: none.

    Parameters
    ----------
    wanted : array (w,)
        Further times, such as those of exposures; those outside of the fixes are left out.
    """
    within = wanted[(wanted > fixes.time[0]) & (wanted < fixes.time[-1])]
    between = within[~np.isin(within, fixes.time)]
    given = np.concatenate([fixes.time, between])
    fix = np.concatenate([np.arange(len(fixes.time)), np.full(len(between), -1)])
    order = np.argsort(given, kind="stable")
    times, found = [float(given[order[0]])], [int(fix[order[0]])]
    for at in order[1:]:
        begin, gap = times[-1], float(given[at]) - times[-1]
        parts = int(np.ceil(gap / _LONGEST_STEP - 1e-9))
        times += [begin + gap * part / parts for part in range(1, parts)]
        found += [-1] * (parts - 1)
        times.append(float(given[at]))
        found.append(int(fix[at]))
    return np.array(times), np.array(found, dtype=np.int64)
