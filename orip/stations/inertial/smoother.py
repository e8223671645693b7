"""Smoothing: one factor graph of preintegrated inertial data and positions, solved by GTSAM.

States are the poses, velocities and biases at the epochs of the receiver, and once a second where it has none.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.stations.inertial.alignment import align
from orip.stations.inertial.common_errors import velocity_delay
from orip.stations.inertial.components import accelerated, estimated_factors, white_noise
from orip.stations.inertial.filter import Filtered, filtered_values, run_filter
from orip.stations.inertial.graph import Factors, Graph
from orip.stations.inertial.samples import Fixes, Observed
from orip.stations.inertial.solution import Solved
from orip.stations.inertial.standing import stands_at

_LONGEST_STEP = 1.0
_MOST_ESTIMATES = 20
_SETTLED, _NEARLY = 1.03, 1.3
"""Changes of factors with which no more are made, and with which their size is about known."""

_SETTLED_DELAY = 0.001


def smooth(observed: Observed, wanted: FloatArray | None = None, *, estimates_noise: bool = True) -> Solved:
    """Return the smoothed trajectory between the first and the last fix that the inertial data cover.

    Parameters
    ----------
    observed : Observed
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
    fixes : Fixes
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
