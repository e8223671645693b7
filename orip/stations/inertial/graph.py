"""The factors of inertial data and positions, for GTSAM: the beginning, preintegrated samples, fixes with a lever arm.

Between two states the samples are preintegrated (Forster et al. 2017, On-manifold preintegration, IEEE Transactions on
Robotics 33), with the rotation of the Earth and the gravity of the place; biases walk at random.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.errors import OripError
from orip.stations.inertial.alignment import STANDING_DEVIATION, Alignment
from orip.stations.inertial.samples import Fixes, ImuNoise, Observed
from orip.structs import replace

_LEVEL_DEVIATION, _COURSE_DEVIATION = np.radians(20.0), np.radians(90.0)
_SPEED_DEVIATION = 5.0
_INTEGRATION = 1e-10
"""m²/s² of the integration itself: far below what any unit has."""

SIZES = {"x": 6, "v": 3, "b": 6}
"""Unknowns of pose, velocity and biases of a state, in their order."""


class Factors(Struct, frozen=True):
    """Of the standard deviations said, by which the observations ask for others: variance components.

    Parameters
    ----------
    gyro, accelerometer : float
        Of the white noise of the inertial unit.
    position, velocity : float
        Of those of the receiver.
    """

    gyro: float = 1.0
    accelerometer: float = 1.0
    position: float = 1.0
    velocity: float = 1.0

    def times(self, other: Factors) -> Factors:
        """Return the products."""
        return Factors(*(getattr(self, name) * getattr(other, name) for name in self.__struct_fields__))

    @property
    def unit(self) -> float:
        """Return the larger of those of the inertial unit."""
        return max(self.gyro, self.accelerometer)

    def are_within(self, limit: float) -> bool:
        """Return whether all are between a limit and its inverse."""
        return all(1.0 / limit < factor < limit for factor in astuple(self))


def load_gtsam() -> Any:
    """Return the library.

    Raises
    ------
    OripError
        If it is not installed.
    """
    try:
        import gtsam
    except ImportError as error:
        message = (
            "inertial data are smoothed by GTSAM, which is not installed: pip install 'orip[ins]'; where that has no "
            "wheel for your platform, smooth them elsewhere and import the SBET (orip stations import)"
        )
        raise OripError(message) from error
    return gtsam


class Graph:
    """The factors of states at given times.

    Parameters
    ----------
    observed : Observed
    times : array (k,)
    fix : array (k,) of int
        The fix of each state; -1: none.
    factors : Factors
    alignment : Alignment
    stands : array (k,) of bool
        States in which the velocity is observed to be zero.
    delay : float
        By which the velocities of the receiver are those of an earlier time, s.
    """

    def __init__(
        self,
        observed: Observed,
        times: FloatArray,
        fix: IntArray,
        factors: Factors,
        alignment: Alignment,
        stands: BoolArray,
        delay: float = 0.0,
    ) -> None:
        self.gtsam, self.stands, self.delay = load_gtsam(), stands, delay
        self.observed, self.times, self.fix, self.factors, self.alignment = observed, times, fix, factors, alignment
        given = observed.fixes
        self.fixes = replace(
            given,
            covariance=given.covariance * factors.position**2,
            velocity_deviation=given.velocity_deviation * factors.velocity,
        )
        said = observed.noise
        self._noise = replace(
            said, gyro=said.gyro * factors.gyro, accelerometer=said.accelerometer * factors.accelerometer
        )
        symbol = self.gtsam.symbol_shorthand
        self.x, self.v, self.b = symbol.X, symbol.V, symbol.B
        self._ahead = _ahead(observed, delay)

    def first_values(self) -> Any:
        """Return values of the first state."""
        gtsam, fixes, alignment = self.gtsam, self.fixes, self.alignment
        place = fixes.place[0] - alignment.rotation @ self.observed.lever_arm
        velocity = np.where(np.isfinite(fixes.velocity[0]), fixes.velocity[0], _first_velocity(fixes))
        values = gtsam.Values()
        values.insert(self.x(0), gtsam.Pose3(gtsam.Rot3(alignment.rotation), place))
        values.insert(self.v(0), velocity)
        values.insert(self.b(0), gtsam.imuBias.ConstantBias(np.zeros(3), alignment.gyro_bias))
        return values

    def first_factors(self) -> list[tuple[str, Any]]:
        """Return what is known of the first state: nearly nothing but the size of biases.

        The deviation about the vertical is larger than that of the level; the vertical is no axis of the body.
        """
        gtsam, model, noise, values = self.gtsam, self.gtsam.noiseModel, self.observed.noise, self.first_values()
        vertical = self.alignment.rotation.T @ np.array([0.0, 0.0, 1.0])
        covariance = np.diag([_LEVEL_DEVIATION**2] * 3 + [1e4] * 3)
        covariance[:3, :3] += (_COURSE_DEVIATION**2 - _LEVEL_DEVIATION**2) * np.outer(vertical, vertical)
        sigmas = np.repeat([noise.accelerometer_bias, noise.gyro_bias], 3)
        pose, speed = model.Gaussian.Covariance(covariance), model.Isotropic.Sigma(3, _SPEED_DEVIATION)
        zero = gtsam.imuBias.ConstantBias()
        first = [
            gtsam.PriorFactorPose3(self.x(0), values.atPose3(self.x(0)), pose),
            gtsam.PriorFactorVector(self.v(0), values.atVector(self.v(0)), speed),
            gtsam.PriorFactorConstantBias(self.b(0), zero, model.Diagonal.Sigmas(sigmas)),
        ]
        return [("first", factor) for factor in first] + self.fix_factors(0, self.alignment.rotation)

    def preintegrated(
        self, at: int, place: FloatArray, bias: Any, noise: ImuNoise | None = None, integration: float = _INTEGRATION
    ) -> Any:
        """Return the samples from the state before to a state; `place` and `bias` are those before it.

        `noise` is that given times its factors, or another.
        """
        noise, gravity, unit = noise or self._noise, self.observed.gravity, np.eye(3)
        parameters = self.gtsam.PreintegrationCombinedParams(gravity.at(place))
        parameters.setGyroscopeCovariance(noise.gyro**2 * unit)
        parameters.setAccelerometerCovariance(noise.accelerometer**2 * unit)
        parameters.setBiasOmegaCovariance(noise.gyro_walk**2 * unit)
        parameters.setBiasAccCovariance(noise.accelerometer_walk**2 * unit)
        parameters.setIntegrationCovariance(integration * unit)
        parameters.setOmegaCoriolis(gravity.earth_rate)
        pim = self.gtsam.PreintegratedCombinedMeasurements(parameters, bias)
        force, rate, duration = self.observed.imu.pieces(float(self.times[at - 1]), float(self.times[at]))
        # GTSAM turns the force of a piece by the attitude at its beginning; it was observed half a piece later
        force = force + np.cross(rate, force) * duration[:, None] / 2.0
        for part in range(len(duration)):
            pim.integrateMeasurement(force[part], rate[part], float(duration[part]))
        return pim

    def unit_factors(self, at: int, pim: Any) -> list[tuple[str, Any]]:
        """Return what the samples say of a state and the one before it."""
        x, v, b = self.x, self.v, self.b
        return [("unit", self.gtsam.CombinedImuFactor(x(at - 1), v(at - 1), x(at), v(at), b(at - 1), b(at), pim))]

    def fix_factors(self, at: int, rotation: FloatArray) -> list[tuple[str, Any]]:
        """Return what the receiver says of a state, and that it stands.

        The velocity of the antenna is taken to the unit, and ahead by its delay, with an attitude (3, 3): its error
        hardly matters there.
        """
        gtsam, fixes, row = self.gtsam, self.fixes, int(self.fix[at])
        factors: list[tuple[str, Any]] = []
        if self.stands[at]:
            model = gtsam.noiseModel.Isotropic.Sigma(3, STANDING_DEVIATION)
            factors.append(("standing", gtsam.PriorFactorVector(self.v(at), np.zeros(3), model)))
        if row < 0:
            return factors
        model = gtsam.noiseModel.Gaussian.Covariance(fixes.covariance[row])
        factors.append(("position", gtsam.GPSFactorArm(self.x(at), fixes.place[row], self.observed.lever_arm, model)))
        if np.isfinite(fixes.velocity[row]).all() and np.isfinite(fixes.velocity_deviation[row]).all():
            sigmas = gtsam.noiseModel.Diagonal.Sigmas(fixes.velocity_deviation[row])
            gain = self.observed.gravity.at(fixes.place[row]) * self.delay
            velocity = fixes.velocity[row] + rotation @ self._ahead[row] + gain
            factors.append(("velocity", gtsam.PriorFactorVector(self.v(at), velocity, sigmas)))
        return factors

    def all_factors(self, values: Any) -> list[tuple[str, Any]]:
        """Return all factors by their groups, with the samples preintegrated by the biases of some values."""
        factors = self.first_factors()
        for at in range(1, len(self.times)):
            place = values.atPose3(self.x(at - 1)).translation()
            pim = self.preintegrated(at, place, values.atConstantBias(self.b(at - 1)))
            rotation = values.atPose3(self.x(at)).rotation().matrix()
            factors += [*self.unit_factors(at, pim), *self.fix_factors(at, rotation)]
        return factors


def _ahead(observed: Observed, delay: float) -> FloatArray:
    """Return specific force integrated over a delay, less the movement of the antenna about the unit before it (m, 3).

    Both are along the axes that the body has at the fixes. Biases are not taken off: in so short a time they make less
    than velocities of a receiver are good for.
    """
    imu, now = observed.imu, observed.fixes.time
    then = np.clip(now - delay, imu.time[0], imu.time[-1])
    swing = np.cross(imu.mean_rates(then), observed.lever_arm)
    if not delay:
        return -swing
    found = np.empty_like(swing)
    for row, (begin, end) in enumerate(zip(then, now, strict=True)):
        force, turned = imu.integrated(min(begin, end), max(begin, end))
        found[row] = turned.T @ (force - swing[row]) if delay > 0.0 else -force - turned @ swing[row]
    return found


def _first_velocity(fixes: Fixes) -> FloatArray:
    velocity: FloatArray = (fixes.place[1] - fixes.place[0]) / (fixes.time[1] - fixes.time[0])
    return velocity
