"""Variance components: by what the stated deviations of gyroscopes, accelerometers and receiver are to be multiplied.

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

from orip.arrays import FloatArray
from orip.stations.inertial.graph import Factors
from orip.stations.inertial.samples import ImuNoise
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
