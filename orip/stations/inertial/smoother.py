"""Smoothing: one factor graph of preintegrated inertial data and positions, solved by GTSAM.

States are the poses, velocities and biases at the epochs of the receiver, and once a second where it has none. Between
them the samples are preintegrated (Forster et al. 2017, On-manifold preintegration, IEEE Transactions on Robotics 33),
with the rotation of the Earth and the gravity of the place; biases walk at random.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.errors import OripError
from orip.progress import stage
from orip.stations.inertial.alignment import Alignment, align
from orip.stations.inertial.chain import Chain, chain_of
from orip.stations.inertial.samples import Fixes, ImuNoise, ImuSamples, LocalGravity
from orip.structs import replace

_LONGEST_STEP = 1.0
_LEVEL_DEVIATION, _COURSE_DEVIATION = np.radians(20.0), np.radians(90.0)
_SPEED_DEVIATION = 5.0
_INTEGRATION = 1e-10
"""m²/s² of the integration itself: far below what any unit has."""

_SETTLED, _MOST_ESTIMATES = 1.1, 8
_LEAST_REDUNDANCY = 20.0
"""Of a group whose factor is estimated."""

_PART = 200
"""States that are added between two solutions of the filter."""


_SIZES = {"x": 6, "v": 3, "b": 6}
"""Unknowns of pose, velocity and biases of a state, in their order."""


class Factors(Struct, frozen=True):
    """Of the standard deviations said, by which the observations ask for others: variance components.

    Parameters
    ----------
    unit : float
        Of the noise of the inertial unit.
    position, velocity : float
        Of those of the receiver.
    """

    unit: float = 1.0
    position: float = 1.0
    velocity: float = 1.0

    def times(self, other: Factors) -> Factors:
        """Return the products."""
        return Factors(self.unit * other.unit, self.position * other.position, self.velocity * other.velocity)

    @property
    def are_settled(self) -> bool:
        """Return whether none asks for a change that matters."""
        return all(1.0 / _SETTLED < factor < _SETTLED for factor in (self.unit, self.position, self.velocity))


class Trajectory(Struct, frozen=True):
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
    residual : array (m, 3)
        Of the fixes used: observed less computed, m.
    fix : array (k,) of int
        The fix of each state; -1: none.
    alignment : Alignment
    factors : Factors
    square_sum : float
        vPv of all observations.
    chain : Chain
        Of each state rotation and position, along the axes of the body, velocity, biases of accelerometer and
        gyroscope.
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
    residual: FloatArray
    fix: IntArray
    alignment: Alignment
    factors: Factors
    square_sum: float
    chain: Chain


def smooth(
    imu: ImuSamples,
    fixes: Fixes,
    gravity: LocalGravity,
    noise: ImuNoise,
    lever_arm: FloatArray,
    wanted: FloatArray | None = None,
    *,
    estimates_noise: bool = True,
) -> Trajectory:
    """Return the smoothed trajectory between the first and the last fix that the inertial data cover.

    Parameters
    ----------
    imu : ImuSamples
    fixes : Fixes
    gravity : LocalGravity
    noise : ImuNoise
    lever_arm : array (3,)
        From the unit to the antenna along the axes of the body, m.
    wanted : array (w,), optional
        Times that have states of their own, such as those of exposures.
    estimates_noise : bool
        The standard deviations of the three groups of observations are multiplied by what their residuals ask for.
    """
    try:
        import gtsam
    except ImportError as error:
        message = "inertial data are smoothed by GTSAM, which is not installed: pip install 'orip[ins]'"
        raise OripError(message) from error
    alignment = align(imu, fixes, gravity)
    times, fix = state_times(fixes, np.zeros(0) if wanted is None else wanted)
    factors, start = Factors(), None
    for _ in range(_MOST_ESTIMATES if estimates_noise else 1):
        graph = _Graph(gtsam, imu, fixes, gravity, noise, lever_arm, times, fix, factors)
        if start is None:
            start = graph.filtered(alignment)
        found, trajectory = graph.smoothed(start, alignment)
        change = graph.estimated_factors(found, trajectory)
        if not estimates_noise or change.are_settled:
            break
        start, factors = found, factors.times(change)
    return trajectory


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


class _Graph:
    """The factors, and their solution."""

    def __init__(
        self,
        gtsam: Any,
        imu: ImuSamples,
        fixes: Fixes,
        gravity: LocalGravity,
        noise: ImuNoise,
        lever_arm: FloatArray,
        times: FloatArray,
        fix: IntArray,
        factors: Factors,
    ) -> None:
        self._gtsam, self._imu, self._gravity, self._lever_arm = gtsam, imu, gravity, lever_arm
        self._noise, self._factors = noise, factors
        self._fixes = replace(
            fixes,
            covariance=fixes.covariance * factors.position**2,
            velocity_deviation=fixes.velocity_deviation * factors.velocity,
        )
        symbol = gtsam.symbol_shorthand
        self._x, self._v, self._b = symbol.X, symbol.V, symbol.B
        self._times, self._fix = times, fix

    def filtered(self, alignment: Alignment) -> Any:
        """Return values of all states, found one after the other."""
        gtsam, times = self._gtsam, self._times
        filtered = self._tree()
        fresh = self._first_values(alignment)
        graph = gtsam.NonlinearFactorGraph()
        for _, factor in self._first_factors(fresh, alignment):
            graph.push_back(factor)
        state = gtsam.NavState(fresh.atPose3(self._x(0)), fresh.atVector(self._v(0)))
        bias = fresh.atConstantBias(self._b(0))
        with stage("inertial data", total=len(times)) as advance:
            for at in range(1, len(times)):
                pim = self._preintegrated(at, np.asarray(state.position()), bias)
                for _, factor in [*self._imu_factor(at, pim), *self._fix_factors(at, int(self._fix[at]))]:
                    graph.push_back(factor)
                state = pim.predict(state, bias)
                fresh.insert(self._x(at), state.pose())
                fresh.insert(self._v(at), state.velocity())
                fresh.insert(self._b(at), bias)
                if self._fix[at] >= 0:
                    filtered.update(graph, fresh)
                    graph, fresh = gtsam.NonlinearFactorGraph(), gtsam.Values()
                    pose = filtered.calculateEstimatePose3(self._x(at))
                    state = gtsam.NavState(pose, filtered.calculateEstimateVector(self._v(at)))
                    bias = filtered.calculateEstimateConstantBias(self._b(at))
                if at % _PART == 0:
                    advance(at)
        return filtered.calculateEstimate()

    def _tree(self) -> Any:
        # Biases are known some 10^5 times less precisely than their changes in a step: too much for Cholesky's squares.
        parameters = self._gtsam.ISAM2Params()
        parameters.setFactorization("QR")
        return self._gtsam.ISAM2(parameters)

    def _first_values(self, alignment: Alignment) -> Any:
        gtsam, fixes = self._gtsam, self._fixes
        place = fixes.place[0] - alignment.rotation @ self._lever_arm
        velocity = np.where(np.isfinite(fixes.velocity[0]), fixes.velocity[0], _first_velocity(fixes))
        values = gtsam.Values()
        values.insert(self._x(0), gtsam.Pose3(gtsam.Rot3(alignment.rotation), place))
        values.insert(self._v(0), velocity)
        values.insert(self._b(0), gtsam.imuBias.ConstantBias(np.zeros(3), alignment.gyro_bias))
        return values

    def _first_factors(self, values: Any, alignment: Alignment) -> list[tuple[str, Any]]:
        """Return what is known of the first state: nearly nothing but the size of biases.

        The deviation about the vertical is larger than that of the level; the vertical is no axis of the body.
        """
        gtsam, model = self._gtsam, self._gtsam.noiseModel
        vertical = alignment.rotation.T @ np.array([0.0, 0.0, 1.0])
        covariance = np.diag([_LEVEL_DEVIATION**2] * 3 + [1e4] * 3)
        covariance[:3, :3] += (_COURSE_DEVIATION**2 - _LEVEL_DEVIATION**2) * np.outer(vertical, vertical)
        sigmas = np.repeat([self._noise.accelerometer_bias, self._noise.gyro_bias], 3)
        pose, speed = model.Gaussian.Covariance(covariance), model.Isotropic.Sigma(3, _SPEED_DEVIATION)
        zero = gtsam.imuBias.ConstantBias()
        first = [
            gtsam.PriorFactorPose3(self._x(0), values.atPose3(self._x(0)), pose),
            gtsam.PriorFactorVector(self._v(0), values.atVector(self._v(0)), speed),
            gtsam.PriorFactorConstantBias(self._b(0), zero, model.Diagonal.Sigmas(sigmas)),
        ]
        return [("first", factor) for factor in first] + self._fix_factors(0, 0)

    def _preintegrated(self, at: int, place: FloatArray, bias: Any) -> Any:
        gtsam, noise = self._gtsam, self._noise
        parameters = gtsam.PreintegrationCombinedParams(self._gravity.at(place))
        scaled = self._factors.unit**2 * np.eye(3)
        parameters.setGyroscopeCovariance(noise.gyro**2 * scaled)
        parameters.setAccelerometerCovariance(noise.accelerometer**2 * scaled)
        parameters.setBiasOmegaCovariance(noise.gyro_walk**2 * scaled)
        parameters.setBiasAccCovariance(noise.accelerometer_walk**2 * scaled)
        parameters.setIntegrationCovariance(_INTEGRATION * np.eye(3))
        parameters.setOmegaCoriolis(self._gravity.earth_rate)
        pim = gtsam.PreintegratedCombinedMeasurements(parameters, bias)
        force, rate, duration = self._imu.pieces(float(self._times[at - 1]), float(self._times[at]))
        # GTSAM turns the force of a piece by the attitude at its beginning; it was observed half a piece later
        force = force + np.cross(rate, force) * duration[:, None] / 2.0
        for part in range(len(duration)):
            pim.integrateMeasurement(force[part], rate[part], float(duration[part]))
        return pim

    def _imu_factor(self, at: int, pim: Any) -> list[tuple[str, Any]]:
        x, v, b = self._x, self._v, self._b
        return [("unit", self._gtsam.CombinedImuFactor(x(at - 1), v(at - 1), x(at), v(at), b(at - 1), b(at), pim))]

    def _fix_factors(self, at: int, row: int) -> list[tuple[str, Any]]:
        if row < 0:
            return []
        gtsam, fixes = self._gtsam, self._fixes
        model = gtsam.noiseModel.Gaussian.Covariance(fixes.covariance[row])
        factors = [("position", gtsam.GPSFactorArm(self._x(at), fixes.place[row], self._lever_arm, model))]
        if np.isfinite(fixes.velocity[row]).all() and np.isfinite(fixes.velocity_deviation[row]).all():
            sigmas = gtsam.noiseModel.Diagonal.Sigmas(fixes.velocity_deviation[row])
            factors.append(("velocity", gtsam.PriorFactorVector(self._v(at), fixes.velocity[row], sigmas)))
        return factors

    def _all_factors(self, values: Any, alignment: Alignment) -> list[tuple[str, Any]]:
        """Return all factors by their groups, with the samples preintegrated by the biases of some values."""
        factors = self._first_factors(self._first_values(alignment), alignment)
        for at in range(1, len(self._times)):
            place = values.atPose3(self._x(at - 1)).translation()
            pim = self._preintegrated(at, place, values.atConstantBias(self._b(at - 1)))
            factors += [*self._imu_factor(at, pim), *self._fix_factors(at, int(self._fix[at]))]
        return factors

    def smoothed(self, start: Any, alignment: Alignment) -> tuple[Any, Trajectory]:
        """Return the values of all states by all observations, as GTSAM has them and as a trajectory."""
        gtsam, times, fix = self._gtsam, self._times, self._fix
        self._grouped = self._all_factors(start, alignment)
        graph = gtsam.NonlinearFactorGraph()
        for _, factor in self._grouped:
            graph.push_back(factor)
        parameters = gtsam.GaussNewtonParams()
        parameters.setLinearSolverType("MULTIFRONTAL_QR")
        found = gtsam.GaussNewtonOptimizer(graph, start, parameters).optimize()
        chain = self._chain(graph.linearize(found))
        count = len(times)
        pose = [found.atPose3(self._x(at)) for at in range(count)]
        rotation = np.array([part.rotation().matrix() for part in pose])
        place = np.array([part.translation() for part in pose])
        covariance = chain.covariance
        bias = [found.atConstantBias(self._b(at)) for at in range(count)]
        antenna = place + rotation @ self._lever_arm
        trajectory = Trajectory(
            times,
            place,
            np.array([found.atVector(self._v(at)) for at in range(count)]),
            rotation,
            rotation @ covariance[:, 3:6, 3:6] @ np.swapaxes(rotation, 1, 2),
            covariance[:, :3, :3],
            covariance[:, 6:9, 6:9],
            np.array([part.gyroscope() for part in bias]),
            np.array([part.accelerometer() for part in bias]),
            self._fixes.place - antenna[fix >= 0],
            fix,
            alignment,
            self._factors,
            2.0 * graph.error(found),
            chain,
        )
        return found, trajectory

    def _chain(self, linear: Any) -> Chain:
        """Return the covariances of all states; their biases are too unlike in size for squares of their rows."""
        count, size = len(self._times), sum(_SIZES.values())
        single: list[list[FloatArray]] = [[] for _ in range(count)]
        tied: list[list[FloatArray]] = [[] for _ in range(count - 1)]
        begins = dict(zip(_SIZES, np.cumsum([0, *_SIZES.values()]).tolist(), strict=False))
        for number in range(linear.size()):
            factor = linear.at(number)
            symbols = [self._gtsam.Symbol(key) for key in factor.keys()]  # noqa: SIM118 - GTSAM's keys are no mapping
            rows, first, at = factor.jacobian()[0], min(symbol.index() for symbol in symbols), 0
            placed = np.zeros((len(rows), 2 * size))
            for symbol in symbols:
                kind = chr(symbol.chr())
                begin = begins[kind] + size * (symbol.index() - first)
                placed[:, begin : begin + _SIZES[kind]] = rows[:, at : at + _SIZES[kind]]
                at += _SIZES[kind]
            if any(symbol.index() > first for symbol in symbols):
                tied[first].append(placed)
            else:
                single[first].append(placed[:, :size])
        return chain_of(single, tied)

    def estimated_factors(self, found: Any, trajectory: Trajectory) -> Factors:
        """Return by what the deviations of each group are to be multiplied: the root of vPv over its redundancy.

        The redundancy of a fix is 3 less the trace of its computed covariance in units of its own; what remains of the
        redundancy of all is that of the unit.
        """
        sums = dict.fromkeys(("first", "unit", "position", "velocity"), 0.0)
        for group, factor in self._grouped:
            sums[group] += 2.0 * factor.error(found)
        fixes, states = self._fixes, np.flatnonzero(trajectory.fix >= 0)
        ratio = np.linalg.solve(fixes.covariance, trajectory.place_covariance[states])
        place = 3.0 * len(states) - float(np.trace(ratio, axis1=1, axis2=2).sum())
        has = np.isfinite(fixes.velocity).all(axis=1) & np.isfinite(fixes.velocity_deviation).all(axis=1)
        known = np.diagonal(trajectory.velocity_covariance[states[has]], axis1=1, axis2=2)
        speed = 3.0 * int(has.sum()) - float((known / fixes.velocity_deviation[has] ** 2).sum())
        unit = 3.0 * len(states) + 3.0 * int(has.sum()) - place - speed
        return Factors(_factor(sums["unit"], unit), _factor(sums["position"], place), _factor(sums["velocity"], speed))


def _factor(square_sum: float, redundancy: float) -> float:
    return float(np.sqrt(square_sum / redundancy)) if redundancy > _LEAST_REDUNDANCY and square_sum > 0.0 else 1.0


def _first_velocity(fixes: Fixes) -> FloatArray:
    velocity: FloatArray = (fixes.place[1] - fixes.place[0]) / (fixes.time[1] - fixes.time[0])
    return velocity
