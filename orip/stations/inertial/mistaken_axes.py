"""Samples that were misread, and axes and units that cannot be those said: which other ones make all agree.

Forces and rates are tried with axes exchanged and reversed against each other, and rates in other units, with the
attitude that fits each best (`orip.stations.inertial.alignment`): what is right has residuals that are smaller by far.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.arrays import FloatArray
from orip.stations.gnss.raw_files import moment
from orip.stations.inertial.alignment import velocities_of
from orip.stations.inertial.samples import ImuSamples, Observed

_LOOKED_AT = 90.0
_BETTER = 3.0
"""Times by which residuals are smaller where something else is right."""

_FORCE, _RATE = 5.0, 0.5
"""m/s² and rad/s: nothing smaller is called misread."""

_ALONE, _USUAL = 20.0, 99.5
"""Times by which a misread sample is further from its neighbours than all but the largest part, percent."""

_MOST_NAMED = 3

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
