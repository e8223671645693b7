"""The filter: states one after the other, each by what was observed until then (GTSAM's iSAM2, not smoothed).

Before a fix is used, what it should be is predicted: the difference, the innovation, tests the fix with its standard
deviation from all before it (Teunissen 1990, Quality control in integrated navigation systems, IEEE PLANS).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.progress import stage
from orip.stations.inertial.graph import Graph

KNOWN_ATTITUDE = np.radians(5.0)
"""Standard deviation below which predictions are linear enough to be tested."""

_PART = 200
"""States between two signs of life."""

_RELINEARISED = 0.005
"""Change (radians, m, m/s) from which equations are formed again."""

_FOUND, _SKIPPED = np.radians(1.0), 100
"""Standard deviation from which they are formed again every so many updates only: it costs what all states cost."""

JUST_BEFORE = 1e-4
"""Seconds before a fix at which its prediction stands in the filter's trajectory."""


class States(Struct, frozen=True, kw_only=True):
    """k states.

    Parameters
    ----------
    time : array (k,)
    place : array (k, 3)
        Of the unit, in the local frame, m.
    velocity : array (k, 3)
    rotation : array (k, 3, 3)
        Body to local frame.
    place_covariance : array (k, 3, 3)
        Along the axes of the local frame.
    attitude_covariance : array (k, 3, 3)
        Of small rotations about the axes of the body, rad².
    velocity_covariance : array (k, 3, 3)
    gyro_bias, accelerometer_bias : arrays (k, 3)
    """

    time: FloatArray
    place: FloatArray
    velocity: FloatArray
    rotation: FloatArray
    place_covariance: FloatArray
    attitude_covariance: FloatArray
    velocity_covariance: FloatArray
    gyro_bias: FloatArray
    accelerometer_bias: FloatArray


class Filtered(Struct, frozen=True):
    """What the filter found.

    Parameters
    ----------
    values : object
        Of all states, as GTSAM has them after the last: where smoothing begins.
    states : States
        Each as it was known at its time: where there is a fix, predicted just before it, and with it.
    innovation : array (m, 3)
        Of the fixes after the first: observed less predicted, m.
    innovation_covariance : array (m, 3, 3)
    """

    values: Any
    states: States
    innovation: FloatArray
    innovation_covariance: FloatArray


def filtered_values(graph: Graph) -> Any:
    """Return values of all states, as GTSAM has them: where smoothing begins."""
    return _Filter(graph, keeps=False).run()


def run_filter(graph: Graph) -> Filtered:
    """Return all states by what was observed until then."""
    forward = _Filter(graph, keeps=True)
    values = forward.run()
    rows = forward.rows
    states = States(**{name: np.array([row[name] for row in rows]) for name in States.__struct_fields__})
    innovation = np.array(forward.innovations).reshape(-1, 3)
    return Filtered(values, states, innovation, np.array(forward.innovation_covariances).reshape(-1, 3, 3))


class _Filter:
    """One way through the states; what it `keeps` costs as much as the way itself."""

    def __init__(self, graph: Graph, *, keeps: bool) -> None:
        self._graph, self._keeps = graph, keeps
        # Biases are known some 10^5 times less precisely than their changes in a step: too much for Cholesky's squares.
        parameters = graph.gtsam.ISAM2Params()
        parameters.setFactorization("QR")
        if keeps:
            parameters.relinearizeSkip = _SKIPPED
            parameters.setRelinearizeThreshold(_RELINEARISED)
        self._is_finding = keeps
        self._tree = graph.gtsam.ISAM2(parameters)
        self._new, self._fresh = graph.gtsam.NonlinearFactorGraph(), graph.first_values()
        self.rows: list[dict[str, Any]] = []
        self.innovations: list[FloatArray] = []
        self.innovation_covariances: list[FloatArray] = []

    def run(self) -> Any:
        """Go through all states."""
        graph = self._graph
        self._add(graph.first_factors())
        state, bias = self._updated(0)
        with stage("inertial data", total=len(graph.times)) as advance:
            for at in range(1, len(graph.times)):
                pim = graph.preintegrated(at, np.asarray(state.position()), bias)
                self._add(graph.unit_factors(at, pim))
                state = pim.predict(state, bias)
                self._fresh.insert(graph.x(at), state.pose())
                self._fresh.insert(graph.v(at), state.velocity())
                self._fresh.insert(graph.b(at), bias)
                observed = graph.fix_factors(at, state.attitude().matrix())
                if self._keeps and graph.fix[at] >= 0:
                    state, bias = self._updated(at, before=JUST_BEFORE)
                    self._test(at, state)
                self._add(observed)
                if observed or self._keeps:
                    state, bias = self._updated(at)
                if at % _PART == 0:
                    advance(at)
        if self._fresh.size():
            self._tree.update(self._new, self._fresh)
        return self._tree.calculateEstimate()

    def _add(self, factors: list[tuple[str, Any]]) -> None:
        for _, factor in factors:
            self._new.push_back(factor)

    def _updated(self, at: int, before: float = 0.0) -> tuple[Any, Any]:
        """Return a state and its biases with all that was added, and keep them."""
        graph, gtsam, tree = self._graph, self._graph.gtsam, self._tree
        # while the attitude is being found, covariances at attitudes of some epochs ago promise too much
        tree.update(self._new, self._fresh, force_relinearize=self._is_finding)
        self._new, self._fresh = gtsam.NonlinearFactorGraph(), gtsam.Values()
        pose = tree.calculateEstimatePose3(graph.x(at))
        velocity = tree.calculateEstimateVector(graph.v(at))
        bias = tree.calculateEstimateConstantBias(graph.b(at))
        if self._keeps:
            covariance, rotation = tree.marginalCovariance(graph.x(at)), pose.rotation().matrix()
            self.rows.append({
                "time": graph.times[at] - before,
                "place": pose.translation(),
                "velocity": velocity,
                "rotation": rotation,
                "place_covariance": rotation @ covariance[3:, 3:] @ rotation.T,
                "attitude_covariance": covariance[:3, :3],
                "velocity_covariance": tree.marginalCovariance(graph.v(at)),
                "gyro_bias": bias.gyroscope(),
                "accelerometer_bias": bias.accelerometer(),
            })  # fmt: skip
            self._pose_covariance = covariance
            self._is_finding = float(np.trace(covariance[:3, :3])) > _FOUND**2
        return gtsam.NavState(pose, velocity), bias

    def _test(self, at: int, state: Any) -> None:
        graph, fixes, row = self._graph, self._graph.fixes, int(self._graph.fix[at])
        arm, rotation = graph.observed.lever_arm, state.attitude().matrix()
        partial = rotation @ np.hstack([np.cross(np.eye(3), arm).T, np.eye(3)])
        self.innovations.append(fixes.place[row] - (state.position() + rotation @ arm))
        self.innovation_covariances.append(partial @ self._pose_covariance @ partial.T + fixes.covariance[row])
