"""Poses of the cameras of a rig as they are said to be against those that were found, by generalised least squares.

All that was found may be moved as one body: r = d - A m, with the differences d of the cameras from where a body moved
by m has them, and r^T C^-1 r least. Leaving a camera out is the same as letting it be anywhere; by how much the square
sum falls tests whether it is off.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import cross_matrix, rotation_about_axes, rotation_vectors_with_partials

Pose = tuple[FloatArray, FloatArray]
"""Place (3,) and rotation (3, 3)."""

_LIMIT = 60.0
"""Fall of the square sum by a camera, six elements, from which it is no chance: 22 has a probability of 0.1 %, and
correlations between photos may be neglected."""

_ROUNDS = 4
"""The body is moved so often: differences of degrees are not linear in its rotation."""


class FoundPoses(NamedTuple):
    """Cameras of a rig as k photos have them: poses by camera, and their covariance (6 n, 6 n), places before angles.

    Its order is that of the poses.
    """

    poses: dict[int, Pose]
    covariance: FloatArray


class _Compared(NamedTuple):
    """The square sum of the cameras that are compared, and shift and rotation (6,) of all of them, by camera."""

    square: float
    differences: dict[int, FloatArray]


def poses_off(said: dict[int, Pose], found: FoundPoses) -> dict[int, tuple[FloatArray, FloatArray]]:
    """Return the cameras that are not where the others have them: shift (3,), rotation (3,).

    Left out one after the other, that which fits least first; of two cameras it is the second one.
    """
    left, off = list(said), list[int]()
    while len(left) > 1:
        square = _compared(said, found, left).square
        tested = left if len(left) > 2 else left[1:]
        falls = [square - _compared(said, found, [row for row in left if row != one]).square for one in tested]
        if max(falls) <= _LIMIT:
            break
        off.append(tested[int(np.argmax(falls))])
        left.remove(off[-1])
    differences = _compared(said, found, left).differences
    return {row: (differences[row][:3], differences[row][3:]) for row in said if row in off}


def square_sum(said: dict[int, Pose], found: FoundPoses) -> float:
    """Return the least r^T C^-1 r of all cameras."""
    return _compared(said, found, list(said)).square


def _compared(said: dict[int, Pose], found: FoundPoses, kept: Sequence[int]) -> _Compared:
    """Return how cameras differ from where those that are kept have them."""
    from orip.bundle.rigs.starting import robust_poses

    rows = list(found.poses)
    columns = np.concatenate([6 * rows.index(row) + np.arange(6) for row in kept])
    factor = np.linalg.cholesky(found.covariance[np.ix_(columns, columns)])
    # the body where most of the cameras have it
    turns = np.stack([found.poses[row][1] @ said[row][1].T for row in kept])
    shifts = np.stack([found.poses[row][0] - turn @ said[row][0] for row, turn in zip(kept, turns, strict=True)])
    places, rotations = robust_poses(shifts, turns, np.zeros(len(kept), dtype=np.int64), 1)
    body, best = (places[0], rotations[0]), _Compared(np.inf, {})
    for _ in range(_ROUNDS):
        found_apart = {row: _difference(said[row], found.poses[row], body) for row in said}
        moved = np.linalg.solve(factor, np.concatenate([_by_motion(body[1] @ said[row][0]) for row in kept]))
        apart = np.linalg.solve(factor, np.concatenate([found_apart[row] for row in kept]))
        motion = np.linalg.lstsq(moved, apart, rcond=None)[0]
        square = float(np.sum((apart - moved @ motion) ** 2))
        body = body[0] + motion[:3], rotation_about_axes(motion[None, 3:])[0] @ body[1]
        if square < best.square:
            best = _Compared(square, {row: _difference(said[row], found.poses[row], body) for row in said})
    return best


def _by_motion(arm: FloatArray) -> FloatArray:
    """Return the partials (6, 6) of place and rotation at the end of an arm by shift and rotation at its beginning."""
    partials = np.eye(6)
    partials[:3, 3:] = -cross_matrix(arm[None])[0]
    return partials


def _difference(said: Pose, found: Pose, body: Pose) -> FloatArray:
    """Return shift and rotation (6,) of a pose against where the body has it."""
    place, rotation = body
    turn = found[1] @ (rotation @ said[1]).T
    return np.concatenate([found[0] - place - rotation @ said[0], rotation_vectors_with_partials(turn[None])[0][0]])
