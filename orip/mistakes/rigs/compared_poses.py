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

_ROUNDS, _SETTLED = 4, 1e-6
"""The body is moved so often, differences of degrees are not linear in its rotation; or until the square sum falls by
no larger part."""


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
        if square <= _LIMIT:
            break
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
    own = np.array([rows.index(row) for row in kept])
    columns = (6 * own[:, None] + np.arange(6)).ravel()
    whitening = np.linalg.inv(np.linalg.cholesky(found.covariance[np.ix_(columns, columns)]))
    offsets, mountings = (np.array([said[row][part] for row in rows]) for part in (0, 1))
    places, rotations = (np.array([found.poses[row][part] for row in rows]) for part in (0, 1))
    # the body where most of the cameras have it
    turns = rotations @ np.swapaxes(mountings, 1, 2)
    shifts = places - (turns @ offsets[:, :, None])[:, :, 0]
    (shift,), (turn,) = robust_poses(shifts[own], turns[own], np.zeros(len(own), dtype=np.int64), 1)
    square, best = np.inf, np.zeros((len(rows), 6))
    for _ in range(_ROUNDS):
        arms = offsets @ turn.T
        vectors, _ = rotation_vectors_with_partials(rotations @ np.swapaxes(turn @ mountings, 1, 2))
        apart = np.hstack([places - shift - arms, vectors])
        moved = _by_motion(arms)
        motion = np.linalg.lstsq(whitening @ moved[own].reshape(-1, 6), whitening @ apart[own].ravel(), rcond=None)[0]
        rest = apart - moved @ motion
        of_rest = float(np.sum((whitening @ rest[own].ravel()) ** 2))
        is_settled = of_rest > (1.0 - _SETTLED) * square
        if of_rest < square:
            square, best = of_rest, rest
        if is_settled:
            break
        shift, turn = shift + motion[:3], rotation_about_axes(motion[None, 3:])[0] @ turn
    return _Compared(square, dict(zip(rows, best, strict=True)))


def _by_motion(arms: FloatArray) -> FloatArray:
    """Return the partials (n, 6, 6) of place and rotation at the end of arms by those at their beginning."""
    partials = np.tile(np.eye(6), (len(arms), 1, 1))
    partials[:, :3, 3:] = -cross_matrix(arms)
    return partials
