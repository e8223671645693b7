"""Stations of successive exposures and differences between them, as observations that are independent of one another.

Errors of a smoothed trajectory are nearly the same in neighbouring exposures. Taken as independent, its stations would
promise too much of what they have in common, and differences would be counted twice. Their errors are taken for a
Gauss-Markov process: of an error of variance P whose correlation falls by r from each exposure to the next, the joint
weight is exactly that of independent stations and differences,

    difference   r / ((1 - r^2) P)              station   (1 / (1 + r) + 1 / (1 + r') - 1) / P

with r and r' of the two neighbours, and 0 where there is none. The time constant of each component is that with which
the process has the mean errors of the smoother: the integral of its correlation over the flight. Errors over short
times are rather smaller than that, so that a difference is no less precise than is said.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from scipy.optimize import brentq

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.stations.inertial.solution import Trajectory

_LEAST_TIE, _CLOSEST = 0.05, 1.0 - 1e-6
"""Correlations with which a difference says something, and beyond which its weight has no digits left."""

_SHORTEST, _LONGEST = 1e-3, 1e7
"""Time constants, s."""


class IndependentPoses(Struct, frozen=True):
    """n exposures as observations that are independent of one another, in the axes of the local frame.

    Parameters
    ----------
    state : array (n,) of int
        Of the trajectory.
    station : array (n, 6, 6)
        Covariances of position (m) and small rotations about the axes (radians).
    difference : array (n - 1, 6, 6)
        Of the next position less this one, and of the error of the next rotation less that of this one; NaN where the
        two have too little in common.
    """

    state: IntArray
    station: FloatArray
    difference: FloatArray


def independent_poses(trajectory: Trajectory, states: Sequence[int]) -> IndependentPoses:
    """Return the exposures at some states, ascending, as independent observations."""
    time = trajectory.time[list(states)]
    own = np.array([_pose_covariance(trajectory, trajectory.chain.covariance[state], state, state) for state in states])
    constant = np.array([_time_constants(trajectory, state) for state in states])
    tie = np.exp(-np.diff(time)[:, None] / ((constant[1:] + constant[:-1]) / 2.0))
    tie = np.minimum(tie, _CLOSEST)
    tie[tie.max(axis=1, initial=0.0) < _LEAST_TIE] = 0.0
    nothing = np.zeros((1, 6))
    before, after = np.vstack([nothing, tie]), np.vstack([tie, nothing])
    station = _scaled(own, 1.0 / np.sqrt(1.0 / (1.0 + before) + 1.0 / (1.0 + after) - 1.0))
    mean = (own[:-1] + own[1:]) / 2.0
    is_tied = tie.any(axis=1)
    safe = np.maximum(tie, _LEAST_TIE**2)
    difference = _scaled(mean, np.sqrt((1.0 - safe**2) / safe))
    station = _as_precise(station, difference, is_tied, own)
    difference[~is_tied] = np.nan
    return IndependentPoses(np.array(states, dtype=np.int64), station, difference)


def _as_precise(station: FloatArray, difference: FloatArray, is_tied: BoolArray, wanted: FloatArray) -> FloatArray:
    """Return covariances of stations with which each pose, by all observations, is as precise as it is to be.

    P changes along a flight; where it does, the weights of the process are too large for the stations in between.
    """
    tie = np.where(is_tied[:, None, None], np.linalg.inv(difference), 0.0)
    aim = np.sqrt(np.diagonal(wanted, axis1=1, axis2=2))
    start = np.sqrt(np.diagonal(station, axis1=1, axis2=2))
    largest = np.maximum(_MOST * aim, start)
    largest[:, 3:] = np.minimum(largest[:, 3:], np.pi)
    factors = np.ones_like(aim)
    for _ in range(_ROUNDS):
        found = _joint_deviations(_scaled(station, factors), tie)
        if (np.abs(found / aim - 1.0) < _AS_GOOD).all():
            break
        factors = np.clip(factors * aim / found, 1.0 / _MOST, largest / start)
    return _scaled(station, factors)


_ROUNDS, _AS_GOOD = 40, 0.01
_MOST = 100.0
"""Times the smoother's standard deviation, with which a station says nothing by itself any more."""


def _joint_deviations(station: FloatArray, tie: FloatArray) -> FloatArray:
    """Return the standard deviations (n, 6) of poses by stations (n, 6, 6) and weights of differences (n - 1, 6, 6)."""
    weight = np.linalg.inv(station)
    forward, backward = [np.zeros((6, 6))], [np.zeros((6, 6))]
    for own, tied in zip(weight[:-1], tie, strict=True):
        forward.append(tied - tied @ np.linalg.inv(own + forward[-1] + tied) @ tied)
    for own, tied in zip(weight[:0:-1], tie[::-1], strict=True):
        backward.append(tied - tied @ np.linalg.inv(own + backward[-1] + tied) @ tied)
    whole = np.linalg.inv(weight + np.array(forward) + np.array(backward[::-1]))
    return np.asarray(np.sqrt(np.diagonal(whole, axis1=1, axis2=2)))


def _scaled(covariance: FloatArray, factors: FloatArray) -> FloatArray:
    """Return covariances (n, 6, 6) whose standard deviations are multiplied by factors (n, 6)."""
    return np.asarray(covariance * factors[:, :, None] * factors[:, None, :])


def _pose_covariance(trajectory: Trajectory, found: FloatArray, first: int, second: int) -> FloatArray:
    """Return the covariance (6, 6) of two states as that of positions and rotations about the axes of the frame."""
    one, other = (np.zeros((6, 6)) for _ in range(2))
    for matrix, state in ((one, first), (other, second)):
        matrix[:3, 3:] = matrix[3:, :3] = trajectory.rotation[state]
    return np.asarray(one @ found[:6, :6] @ other.T)


def _time_constants(trajectory: Trajectory, state: int) -> FloatArray:
    """Return the time constants (6,) of processes with the correlations of a state with all others, integrated."""
    states, integral = _correlations(trajectory, state)
    time = trajectory.time
    step = np.gradient(time)[states]
    apart = np.abs(time[states] - time[state])
    found = np.empty(6)
    for axis in range(6):
        whole = float(integral[:, axis] @ step)

        def missing(logarithm: float, whole: float = whole) -> float:
            return float(np.exp(-apart / np.exp(logarithm)) @ step) - whole

        low, high = np.log(_SHORTEST), np.log(_LONGEST)
        if missing(low) >= 0.0:
            found[axis] = _SHORTEST
        elif missing(high) <= 0.0:
            found[axis] = _LONGEST
        else:
            found[axis] = np.exp(brentq(missing, low, high, xtol=1e-3))
    return found


_WINDOW = 300.0
"""Seconds to both sides in which correlations are looked at: those of hours say nothing more of some exposures."""


def _correlations(trajectory: Trajectory, state: int) -> tuple[IntArray, FloatArray]:
    """Return the states around one, and the correlations (k, 6) of their components with its own."""
    chain, time = trajectory.chain, trajectory.time
    first, last = np.searchsorted(time, [time[state] - _WINDOW, time[state] + _WINDOW])
    pieces: list[tuple[int, FloatArray]] = []
    found = chain.covariance[state]
    for other in range(state - 1, first - 1, -1):
        found = chain.gain[other] @ found
        pieces.append((other, _pose_covariance(trajectory, found, other, state)))
    product = np.eye(len(found))
    for other in range(state, min(last, len(time))):
        if other > state:
            product = product @ chain.gain[other - 1]
        pieces.append((other, _pose_covariance(trajectory, product @ chain.covariance[other], state, other)))
    pieces.sort(key=lambda piece: piece[0])
    states = np.array([other for other, _ in pieces], dtype=np.int64)
    of_state = _deviations(trajectory, state)
    both = np.array([np.diag(covariance) / (of_state * _deviations(trajectory, other)) for other, covariance in pieces])
    return states, both


def _deviations(trajectory: Trajectory, state: int) -> FloatArray:
    covariance = trajectory.chain.covariance[state]
    return np.asarray(np.sqrt(np.diag(_pose_covariance(trajectory, covariance, state, state))))
