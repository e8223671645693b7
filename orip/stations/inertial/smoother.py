"""Smoothing: one factor graph of preintegrated inertial data and positions, solved by GTSAM.

States are the poses, velocities and biases at the epochs of the receiver, and once a second where it has none.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.stations.inertial.alignment import Alignment, align
from orip.stations.inertial.chain import Chain, border_of, chain_of
from orip.stations.inertial.filter import Filtered, States, filtered_values, run_filter
from orip.stations.inertial.graph import SIZES, Factors, Graph
from orip.stations.inertial.samples import Fixes, Observed
from orip.stations.inertial.standing import stands_at

_LONGEST_STEP = 1.0
_MOST_ESTIMATES = 8
_LEAST_REDUNDANCY = 20.0
"""Of a group whose factor is estimated."""


Columns = Callable[[int, FloatArray, FloatArray], FloatArray | None]
"""Of a factor's number, rows and right-hand side: columns of further unknowns, and of the side; None: none."""


class Trajectory(States, frozen=True, kw_only=True):
    """k states by all observations.

    Parameters
    ----------
    residual : array (m, 3)
        Of the fixes used: observed less computed, m.
    fix : array (k,) of int
        The fix of each state; -1: none.
    alignment : Alignment
    factors : Factors
    square_sum : float
        vPv of all observations.
    standing : int
        States that stand.
    chain : Chain
        Of each state rotation and position, along the axes of the body, velocity, biases of accelerometer and
        gyroscope.
    """

    residual: FloatArray
    fix: IntArray
    alignment: Alignment
    factors: Factors
    square_sum: float
    standing: int
    chain: Chain


class Solved:
    """The graph with its solution."""

    def __init__(self, graph: Graph, start: Any) -> None:
        gtsam = graph.gtsam
        self.graph, self._grouped = graph, graph.all_factors(start)
        factors = gtsam.NonlinearFactorGraph()
        for _, factor in self._grouped:
            factors.push_back(factor)
        parameters = gtsam.GaussNewtonParams()
        parameters.setLinearSolverType("MULTIFRONTAL_QR")
        self.values = gtsam.GaussNewtonOptimizer(factors, start, parameters).optimize()
        self.linear = factors.linearize(self.values)
        self.trajectory = self._trajectory(2.0 * factors.error(self.values))

    @property
    def groups(self) -> list[str]:
        """Return the group of each factor of `linear`."""
        return [group for group, _ in self._grouped]

    def _trajectory(self, square_sum: float) -> Trajectory:
        graph, found = self.graph, self.values
        chain = self._chain()
        covariance, count = chain.covariance, len(graph.times)
        pose = [found.atPose3(graph.x(at)) for at in range(count)]
        rotation = np.array([part.rotation().matrix() for part in pose])
        place = np.array([part.translation() for part in pose])
        bias = [found.atConstantBias(graph.b(at)) for at in range(count)]
        antenna = place + rotation @ graph.observed.lever_arm
        return Trajectory(
            time=graph.times,
            place=place,
            velocity=np.array([found.atVector(graph.v(at)) for at in range(count)]),
            rotation=rotation,
            place_covariance=rotation @ covariance[:, 3:6, 3:6] @ np.swapaxes(rotation, 1, 2),
            attitude_covariance=covariance[:, :3, :3],
            velocity_covariance=covariance[:, 6:9, 6:9],
            gyro_bias=np.array([part.gyroscope() for part in bias]),
            accelerometer_bias=np.array([part.accelerometer() for part in bias]),
            residual=graph.fixes.place - antenna[graph.fix >= 0],
            fix=graph.fix,
            alignment=graph.alignment,
            factors=graph.factors,
            square_sum=square_sum,
            standing=self.groups.count("standing"),
            chain=chain,
        )

    def _chain(self) -> Chain:
        """Return the covariances of all states; their biases are too unlike in size for squares of their rows."""
        return chain_of(*self._rows(lambda _number, _matrix, _side: None))

    def border(self, columns: Columns) -> FloatArray:
        """Return what all observations say of unknowns that `columns` puts beside those of the states."""
        return border_of(*self._rows(columns), sum(SIZES.values()))

    def _rows(self, columns: Columns) -> tuple[list[list[FloatArray]], list[list[FloatArray]]]:
        """Return the rows that states have by themselves, and with the next one."""
        count, size = len(self.graph.times), sum(SIZES.values())
        single: list[list[FloatArray]] = [[] for _ in range(count)]
        tied: list[list[FloatArray]] = [[] for _ in range(count - 1)]
        begins = dict(zip(SIZES, np.cumsum([0, *SIZES.values()]).tolist(), strict=False))
        for number in range(self.linear.size()):
            factor = self.linear.at(number)
            symbols = [self.graph.gtsam.Symbol(key) for key in factor.keys()]  # noqa: SIM118 - no mapping of Python
            (rows, side), first, at = factor.jacobian(), min(symbol.index() for symbol in symbols), 0
            is_tied = any(symbol.index() > first for symbol in symbols)
            placed = np.zeros((len(rows), (1 + is_tied) * size))
            for symbol in symbols:
                kind = chr(symbol.chr())
                begin = begins[kind] + size * (symbol.index() - first)
                placed[:, begin : begin + SIZES[kind]] = rows[:, at : at + SIZES[kind]]
                at += SIZES[kind]
            more = columns(number, rows, side)
            (tied if is_tied else single)[first].append(placed if more is None else np.hstack([placed, more]))
        return single, tied

    def estimated_factors(self) -> Factors:
        """Return by what the deviations of each group are to be multiplied: the root of vPv over its redundancy.

        The redundancy of a fix is 3 less the trace of its computed covariance in units of its own; what remains of the
        redundancy of all is that of the unit.
        """
        trajectory = self.trajectory
        sums = dict.fromkeys(("first", "unit", "position", "velocity"), 0.0)
        for group, factor in self._grouped:
            sums[group] += 2.0 * factor.error(self.values)
        fixes, states = self.graph.fixes, np.flatnonzero(trajectory.fix >= 0)
        ratio = np.linalg.solve(fixes.covariance, trajectory.place_covariance[states])
        place = 3.0 * len(states) - float(np.trace(ratio, axis1=1, axis2=2).sum())
        has = np.isfinite(fixes.velocity).all(axis=1) & np.isfinite(fixes.velocity_deviation).all(axis=1)
        known = np.diagonal(trajectory.velocity_covariance[states[has]], axis1=1, axis2=2)
        speed = 3.0 * int(has.sum()) - float((known / fixes.velocity_deviation[has] ** 2).sum())
        unit = 3.0 * len(states) + 3.0 * int(has.sum()) - place - speed
        return Factors(
            _factor(sums["unit"], unit),
            _factor(sums["position"], place),
            _factor(sums["velocity"], speed),
        )


def smooth(observed: Observed, wanted: FloatArray | None = None, *, estimates_noise: bool = True) -> Solved:
    """Return the smoothed trajectory between the first and the last fix that the inertial data cover.

    Parameters
    ----------
    observed : Observed
    wanted : array (w,), optional
        Times that have states of their own, such as those of exposures.
    estimates_noise : bool
        The standard deviations of the three groups of observations are multiplied by what their residuals ask for.
    """
    alignment = align(observed)
    times, fix = state_times(observed.fixes, np.zeros(0) if wanted is None else wanted)
    stands = stands_at(observed.imu, observed.fixes, times)
    # a unit that stands is quieter than one that moves: noise is estimated without what is known of standing
    graph = Graph(observed, times, fix, Factors(), alignment, stands & (not estimates_noise))
    solved = Solved(graph, filtered_values(graph))
    for _ in range(_MOST_ESTIMATES - 1 if estimates_noise else 0):
        change = solved.estimated_factors()
        if change.are_settled:
            break
        graph = Graph(observed, times, fix, graph.factors.times(change), alignment, graph.stands)
        solved = Solved(graph, solved.values)
    if estimates_noise and stands.any():
        solved = Solved(Graph(observed, times, fix, graph.factors, alignment, stands), solved.values)
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


def _factor(square_sum: float, redundancy: float) -> float:
    return float(np.sqrt(square_sum / redundancy)) if redundancy > _LEAST_REDUNDANCY and square_sum > 0.0 else 1.0
