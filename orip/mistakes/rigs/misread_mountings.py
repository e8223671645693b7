"""Mountings of a rig as they were probably meant: cameras exchanged, other units, the inverse rotation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.mistakes.rigs.compared_poses import Pose
from orip.units import DEGREES_PER_RADIAN
from orip.wording import joined


class OtherMountings(NamedTuple):
    """Poses of cameras, by their rows, as they may have been meant, what that says of the rig, and what to write."""

    poses: dict[int, Pose]
    is_exchange: bool
    text: str


class _Reading(NamedTuple):
    """What an offset and a rotation are instead, and the pose that they then are."""

    what: str
    changes: tuple[str, ...]
    pose: Callable[[FloatArray, FloatArray], Pose]


def _as_radians(rotation: FloatArray) -> FloatArray:
    return rotation_from_angles(angles_from_rotation(rotation) * DEGREES_PER_RADIAN)


def _in_other_order(rotation: FloatArray) -> FloatArray:
    """Return Rz Ry Rx of the angles of Rx Ry Rz."""
    return rotation_from_angles(-angles_from_rotation(rotation)).T


_INVERSE = _Reading(
    "offsets and rotations lead from the rig to the photo", ("offset", "rotation"), lambda o, m: (-m.T @ o, m.T)
)
_READINGS = (
    _Reading("offsets are a thousand times too large", ("offset",), lambda o, m: (o / 1000.0, m)),
    _Reading("offsets are a thousand times too small", ("offset",), lambda o, m: (o * 1000.0, m)),
    _Reading("rotations are in radians", ("rotation",), lambda o, m: (o, _as_radians(m))),
    _Reading("rotations are those from the rig to the photo", ("rotation",), lambda o, m: (o, m.T)),
    _Reading(
        "rotations are about the axes in the order kappa, phi, omega",
        ("rotation",),
        lambda o, m: (o, _in_other_order(m)),
    ),
    _Reading("offsets are along the axes of the photo", ("offset",), lambda o, m: (m @ o, m)),
    _INVERSE,
)


def other_mountings(
    said: dict[int, Pose], off: Sequence[int], names: dict[int, str], rig: str
) -> Iterator[OtherMountings]:
    """Yield what the mountings of a rig may have been meant to be.

    Parameters
    ----------
    said : dict
        Poses of cameras in the system of the rig.
    off : sequence of int
        The cameras that are not where they are said to be.
    names : dict
        Of the cameras.
    rig : str
    """
    others = [row for row in said if not _is_origin(said[row])]
    two = len(said) == 2 and len(others) == 1
    for one, other in combinations(said, 2):
        text = (
            f"cameras {names[one]} and {names[other]} of rig {rig} are exchanged: each is mounted where the other "
            "one is said to be; exchange their names in the [[rig]], or the cameras of their photos"
        )
        if two:  # the exchanged mounting is the inverse one
            text += f"; or {_read(_INVERSE, said, others, names, rig).text}"
        yield OtherMountings({**said, one: said[other], other: said[one]}, is_exchange=True, text=text)
    of_some = [tuple(row for row in others if row in off), *((row,) for row in others), tuple(others)]
    for rows in filter(None, dict.fromkeys(of_some)):
        for reading in _READINGS:
            if not (two and reading is _INVERSE):
                yield _read(reading, said, rows, names, rig)


def _read(
    reading: _Reading, said: dict[int, Pose], rows: Sequence[int], names: dict[int, str], rig: str
) -> OtherMountings:
    meant = {row: reading.pose(*said[row]) for row in rows}
    whose = f"camera{'s' if len(rows) > 1 else ''} {joined([names[row] for row in rows])} of rig {rig}"
    written = [f"{_written(reading.changes, pose)} for {names[row]}" for row, pose in meant.items()]
    text = f"{whose}: {reading.what}; write {joined(written)} in the [[rig]]"
    return OtherMountings({**said, **meant}, is_exchange=False, text=text)


def _is_origin(pose: Pose) -> bool:
    return not pose[0].any() and bool((pose[1] == np.eye(3)).all())


def _written(changes: Sequence[str], pose: Pose) -> str:
    values = {"offset": pose[0], "rotation": angles_from_rotation(pose[1]) * DEGREES_PER_RADIAN}
    return ", ".join(f"{key} = [{', '.join(f'{value:.6g}' for value in values[key].tolist())}]" for key in changes)
