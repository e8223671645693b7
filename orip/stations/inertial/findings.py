"""What a trajectory shows of its observations: samples misread, fixes that do not fit, a wrong time, lever arm, axes.

Forces and rates are tried with axes exchanged and reversed against each other, and rates in other units, with the
attitude that fits each best (`orip.stations.inertial.alignment`): what is right has residuals that are smaller by far.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.stations.gnss.raw_files import moment
from orip.stations.inertial.alignment import velocities_of
from orip.stations.inertial.common_errors import common_errors, said_of_common_errors
from orip.stations.inertial.filter import KNOWN_ATTITUDE, Filtered
from orip.stations.inertial.samples import ImuSamples, Observed
from orip.stations.inertial.solution import Solved, Trajectory

_LOOKED_AT = 90.0
_BETTER = 3.0
"""Times by which residuals are smaller where something else is right."""

_FORCE, _RATE = 5.0, 0.5
"""m/s² and rad/s: nothing smaller is called misread."""

_ALONE, _USUAL = 20.0, 99.5
"""Times by which a misread sample is further from its neighbours than all but the largest part, percent."""


_AXES = ("forward", "right", "down")
_PER_DEGREE = np.pi / 180.0


class _Other(Struct, frozen=True):
    """Rates times `scale`, forces (3,) along the axes as `axes` (3, 3) takes them; and the residuals, m/s."""

    scale: float
    axes: FloatArray
    residual: float


def mistaken(observed: Observed) -> str:
    """Return what was probably mistaken; empty: nothing that is tried makes it better."""
    misread = _misread(observed.imu)
    if misread:
        return misread
    tried = list(_tried(observed))
    given, best = tried[0], min(tried, key=lambda other: other.residual)
    if best.residual * _BETTER > given.residual:
        return ""
    return _said(best)


def _misread(imu: ImuSamples) -> str:
    """Name samples that are far from the mean of those before and after them, which no movement is."""
    apart = np.max([
        np.abs(values[1:-1] - (values[:-2] + values[2:]) / 2.0).max(axis=1) / unit
        for values, unit in ((imu.force, _FORCE), (imu.rate, _RATE))
    ], axis=0)  # fmt: skip
    largest = np.flatnonzero(apart > max(_ALONE * float(np.percentile(apart, _USUAL)), 1.0))
    if not len(largest):
        return ""
    alone = [at for at in largest if apart[at] == apart[max(at - 1, 0) : at + 2].max()]  # its neighbours stand out too
    said = ", ".join(f"{at + 2} ({moment(imu.time[at + 1])})" for at in alone[:_MOST_NAMED])
    more = f" and {len(alone) - _MOST_NAMED} more" if len(alone) > _MOST_NAMED else ""
    return f"samples that are far from those before and after them were probably misread: {said}{more}; remove them"


def _tried(observed: Observed) -> Iterator[_Other]:
    """Yield what was given, then everything else."""
    orders = [np.eye(3)[list(order)] * np.array(signs)[:, None] for order in permutations(range(3))
              for signs in product((1.0, -1.0), repeat=3)]  # fmt: skip
    orders.sort(key=lambda axes: float(np.abs(axes - np.eye(3)).sum()))
    for scale in (1.0, -1.0, _PER_DEGREE, 1.0 / _PER_DEGREE):
        integral, change = _changes(observed, scale)
        for axes in orders:
            yield _Other(scale, axes, _residual(np.einsum("nijm,jm->ni", integral, axes), change))


def _changes(observed: Observed, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return integrals (k, 3, 3, 3) of attitude times force by their axes, and velocity changes less gravity (k, 3)."""
    imu, fixes, gravity = observed.imu, observed.fixes, observed.gravity
    velocity = velocities_of(fixes)
    speed = np.linalg.norm(velocity[:, :2], axis=1)
    first = max(int(np.argmax(speed > 0.5)) - 3, 0)
    last = int(np.searchsorted(fixes.time, fixes.time[first] + _LOOKED_AT))
    turned, integrals, changes = np.eye(3), [], []
    for at in range(first, min(last, len(fixes.time) - 1)):
        begin, end = float(fixes.time[at]), float(fixes.time[at + 1])
        force, rate, duration = imu.pieces(begin, end)
        steps = Rotation.from_rotvec(scale * rate * duration[:, None]).as_matrix()
        whole = np.zeros((3, 3, 3))
        for step, part, time in zip(steps, force, duration, strict=True):
            whole += turned[:, :, None] * part * time
            turned = turned @ step
        if np.isfinite(velocity[[at, at + 1]]).all():
            integrals.append(whole)
            changes.append(velocity[at + 1] - velocity[at] - gravity.at(fixes.place[at]) * (end - begin))
    return np.array(integrals), np.array(changes)


def _residual(body: FloatArray, frame: FloatArray) -> float:
    left, _, right = np.linalg.svd(frame.T @ body)
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left) * np.linalg.det(right)]) @ right
    return float(np.sqrt(np.mean((frame - body @ rotation.T) ** 2)))


def _said(other: _Other) -> str:
    parts = []
    if abs(other.scale) != 1.0:
        unit = "deg/s" if abs(other.scale) < 1.0 else "rad/s"
        parts.append(f"angular rates are in {unit}: --rate-unit {unit}")
    elif other.scale < 0.0:
        parts.append("the signs of all angular rates are reversed")
    if not np.array_equal(other.axes, np.eye(3)):
        parts.append(f"axes are exchanged: what is called the force {_taken(other.axes)} beside these angular rates")
    return "all fits if " + ", and ".join(parts) if parts else ""


def _taken(axes: FloatArray) -> str:
    """Return which force stands where: row j of the axes is where force m of the file belongs."""
    found = []
    for row, name in enumerate(_AXES):
        at = int(np.argmax(np.abs(axes[row])))
        if at != row or axes[row, at] < 0.0:
            sign = "" if axes[row, at] > 0.0 else "minus "
            found.append(f"{_AXES[at]} is {sign}{name}")
    return ", ".join(found)


_LEAST_CHANGE = 1.0
"""m/s of horizontal velocity changes without which no course is found."""

_LARGEST_FACTOR, _SUSPICIOUS_FACTOR = 100.0, 8.0
_LEAST_REDUNDANCY = 3.0
"""With which noise six times as large is found with a probability of 0.9 or so."""

_ERROR_PROBABILITY = 0.01
"""That any fix of a flight is called wrong which is right."""

_UPSIDE_DOWN = np.radians(60.0)
_ONE_WAY = 0.9
"""Length of the mean of unit vectors from which all point about the same way."""

_FORWARD = np.radians(60.0)
_MOST_NAMED = 3
_SPOILED = 3
"""Fixes after a wrong one."""


class Named(Struct, frozen=True):
    """Names of the files, and the time shift of the samples that was given."""

    imu: str
    positions: str
    shift: float


def innovation_statistic(filtered: Filtered) -> FloatArray:
    """Return the squares (m,) of innovations in their own standard deviations: chi-squared with 3 degrees."""
    solved = np.linalg.solve(filtered.innovation_covariance, filtered.innovation[:, :, None])[:, :, 0]
    return np.asarray(np.sum(filtered.innovation * solved, axis=1))


def findings(solved: Solved, filtered: Filtered, named: Named) -> Iterator[ProjectWarning]:
    """Yield what is to be said."""
    trajectory = solved.trajectory
    if trajectory.alignment.change < _LEAST_CHANGE:
        text = (
            f"velocity changes by {trajectory.alignment.change:.1f} m/s only: the course follows from movement, and is "
            "not known without; look at its standard deviation"
        )
        yield ProjectWarning("no-course", named.positions, text)
    cause = mistaken(solved.graph.observed) if trajectory.factors.unit > _SUSPICIOUS_FACTOR else ""
    if cause or trajectory.factors.unit > _LARGEST_FACTOR:
        text = f"the unit is {trajectory.factors.unit:.0f} times less precise than --noise says: " + (
            cause or "its axes (--mount), units, time (--shift) or lever arm are probably wrong"
        )
        yield ProjectWarning("unit-contradicts", named.imu, text)
        return
    graph = solved.graph
    yield from _untested(solved, named)
    for code, text in said_of_common_errors(
        common_errors(solved), named.shift, graph.observed.lever_arm.tolist(), is_corrected=graph.delay != 0.0
    ):
        yield ProjectWarning(code, named.imu if code == "time-offset" else named.positions, text)
    yield from _wrong_fixes(solved, filtered, named)
    yield from _mounting(trajectory, named)


def _untested(solved: Solved, named: Named) -> Iterator[ProjectWarning]:
    """Say where nothing shows whether the unit is as precise as was given, on which standard deviations rest."""
    if solved.trajectory.factors.unit != 1.0:
        return
    redundancy = solved.unit_redundancy()
    if redundancy < _LEAST_REDUNDANCY:
        text = (
            f"whether the unit is as precise as --noise says is not tested: its samples have a redundancy of "
            f"{redundancy:.1f} beside these positions; the standard deviations of attitudes are as good as --noise"
        )
        yield ProjectWarning("noise-untested", named.imu, text)


def fix_statistics(solved: Solved, filtered: Filtered) -> FloatArray:
    """Return the statistic (m,) of the fixes after the first; NaN where the attitude was not yet known."""
    at = np.flatnonzero(solved.trajectory.fix[1:] >= 0) + 1
    before = np.searchsorted(filtered.states.time, solved.trajectory.time[at]) - 1
    attitude = np.trace(filtered.states.attitude_covariance[before], axis1=1, axis2=2)
    return np.where(attitude < KNOWN_ATTITUDE**2, innovation_statistic(filtered), np.nan)


def _wrong_fixes(solved: Solved, filtered: Filtered, named: Named) -> Iterator[ProjectWarning]:
    statistic = fix_statistics(solved, filtered)
    limit = chi2.isf(_ERROR_PROBABILITY / max(np.isfinite(statistic).sum(), 1), 3)
    wrong = np.flatnonzero(statistic > limit)
    if not len(wrong):
        return
    # what follows a wrong position does not fit what was made of it
    begins = wrong[np.diff(wrong, prepend=-_SPOILED - 1) > _SPOILED]
    worst = begins[np.argsort(-statistic[begins], kind="stable")][:_MOST_NAMED]
    time = solved.graph.fixes.time[1:]
    said = "; ".join(
        f"{moment(time[row])} by {np.linalg.norm(filtered.innovation[row]):.2f} m where "
        f"{np.sqrt(np.trace(filtered.innovation_covariance[row])):.2f} m is the standard deviation"
        for row in sorted(worst)
    )
    more = f", and {len(begins) - len(worst)} more" if len(begins) > len(worst) else ""
    text = (
        f"positions do not fit what was observed before them: {said}{more}; are ambiguities wrong there? Leave "
        "them out, or give them larger deviations"
    )
    yield ProjectWarning("wrong-positions", named.positions, text)


def _mounting(trajectory: Trajectory, named: Named) -> Iterator[ProjectWarning]:
    """Say where forward is not where the body goes, or down is above."""
    down = float(np.median(trajectory.rotation[:, 2, 2]))
    if down > -np.cos(_UPSIDE_DOWN):
        angle = np.degrees(np.arccos(np.clip(-down, -1.0, 1.0)))
        text = (
            f"what --mount makes the body's down is {angle:.0f} degrees from the vertical in the median; is it right?"
        )
        yield ProjectWarning("mount", named.imu, text)
        return
    moves = np.linalg.norm(trajectory.velocity[:, :2], axis=1) > 1.0
    if moves.sum() < 10:
        return
    velocity, forward = trajectory.velocity[moves], trajectory.rotation[moves, :, 0]
    apart = np.arctan2(forward[:, 0], forward[:, 1]) - np.arctan2(velocity[:, 0], velocity[:, 1])
    mean = np.exp(1j * apart).mean()
    if abs(mean) > _ONE_WAY and abs(np.angle(mean)) > _FORWARD:
        angle, side = abs(np.degrees(np.angle(mean))), "right" if np.angle(mean) > 0.0 else "left"
        text = f"the body points {angle:.0f} degrees to the {side} of where it goes, all the time; is --mount right?"
        yield ProjectWarning("mount", named.imu, text)
