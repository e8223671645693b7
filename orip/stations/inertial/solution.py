"""The graph of inertial data and positions with its least-squares solution, its covariances and its residuals.

Covariances are those of single states, and of two, in a chain of which each is tied to the next one. The rows are
reduced by QR from the first state to the last; going back, the covariance of a state follows from that of the next one
(Bierman 1977, Factorization methods for discrete sequential estimation, chapter 10).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from scipy.linalg import solve_triangular

from orip.arrays import FloatArray, IntArray
from orip.stations.inertial.alignment import Alignment
from orip.stations.inertial.filter import States
from orip.stations.inertial.graph import SIZES, Factors, Graph

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

    def unit_residuals(self) -> tuple[FloatArray, FloatArray]:
        """Return residuals (k - 1, 15) of preintegrated samples and their covariances, in units of their deviations."""
        _, tied = self._rows(lambda _number, _matrix, side: side[:, None])
        rows, chain = np.array([part for (part,) in tied]), self.trajectory.chain
        matrix, residual, covariance = rows[:, :, :-1], rows[:, :, -1], chain.covariance
        across = chain.gain @ covariance[1:]
        joint = np.block([[covariance[:-1], across], [np.swapaxes(across, 1, 2), covariance[1:]]])
        return residual, np.eye(matrix.shape[1]) - matrix @ joint @ np.swapaxes(matrix, 1, 2)

    def unit_redundancy(self) -> float:
        """Return by how many observations more than they need the preintegrated samples are there."""
        return float(np.trace(self.unit_residuals()[1], axis1=1, axis2=2).sum())

    def unit_roots(self) -> FloatArray:
        """Return the roots (k - 1, 15, 15) of the weights of preintegrated samples."""
        return np.array([factor.noiseModel().R() for group, factor in self._grouped if group == "unit"])

    def square_sums(self) -> dict[str, float]:
        """Return vPv of each group."""
        sums = dict.fromkeys((*self.groups, "velocity"), 0.0)
        for group, factor in self._grouped:
            sums[group] += 2.0 * factor.error(self.values)
        return sums


class Chain(Struct, frozen=True):
    """k states of s unknowns.

    Parameters
    ----------
    covariance : array (k, s, s)
    gain : array (k - 1, s, s)
        An error of the next state times this is what is expected of a state's own error.
    """

    covariance: FloatArray
    gain: FloatArray

    def between(self, first: int, second: int) -> FloatArray:
        """Return the covariance (s, s) of a state with one after it."""
        found = self.covariance[second]
        for state in range(second - 1, first - 1, -1):
            found = self.gain[state] @ found
        return np.asarray(found)


def chain_of(single: Sequence[Iterable[FloatArray]], tied: Sequence[Iterable[FloatArray]]) -> Chain:
    """Return the covariances of a chain from the rows of its equations, divided by their standard deviations.

    Parameters
    ----------
    single : sequence of k iterables of arrays (r, s)
        Of equations that a state has by itself.
    tied : sequence of k - 1 iterables of arrays (r, 2 s)
        Of those that it has with the next one.
    """
    triangles, across = [], []
    kept = np.vstack(list(single[0]))
    size = kept.shape[1]
    for own, both in zip(single[1:], tied, strict=True):
        padded = np.hstack([kept, np.zeros_like(kept)])
        reduced = _triangle([padded, *both])
        triangles.append(reduced[:size, :size])
        across.append(reduced[:size, size:])
        kept = np.vstack([reduced[size:, size:], *own])
    triangles.append(_triangle([kept]))
    inverse = [solve_triangular(triangle, np.eye(size)) for triangle in triangles]
    covariance, gain = np.empty((len(single), size, size)), np.empty((len(single) - 1, size, size))
    covariance[-1] = inverse[-1] @ inverse[-1].T
    for state in range(len(single) - 2, -1, -1):
        gain[state] = -inverse[state] @ across[state]
        covariance[state] = inverse[state] @ inverse[state].T + gain[state] @ covariance[state + 1] @ gain[state].T
    return Chain(covariance, gain)


def border_of(single: Sequence[Iterable[FloatArray]], tied: Sequence[Iterable[FloatArray]], size: int) -> FloatArray:
    """Return what rows say of further unknowns that all of them share, and of their right-hand side.

    Parameters
    ----------
    single, tied
        As of `chain_of`, with e further columns, the last of them the right-hand side.
    size : int
        Unknowns of a state, s.

    Returns
    -------
    array (e, e)
        Upper triangle: the equations of the shared unknowns when those of all states are eliminated.
    """
    kept, tail = np.vstack(list(single[0])), []
    for own, both in zip(single[1:], tied, strict=True):
        padded = np.hstack([kept[:, :size], np.zeros((len(kept), size)), kept[:, size:]])
        reduced = _triangle([padded, *both])
        tail.append(reduced[2 * size :, 2 * size :])
        kept = np.vstack([reduced[size : 2 * size, size:], *own])
    tail.append(_triangle([kept])[size:, size:])
    return _triangle(tail)


def _triangle(rows: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(np.linalg.qr(np.vstack(rows), mode="r"), dtype=np.float64)
