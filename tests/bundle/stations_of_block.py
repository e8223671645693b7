"""Exposure stations of an aerial block of three strips, with what is planted in them."""

from __future__ import annotations

import numpy as np
from bundle.aerial_block import aerial_block
from bundle.solving import OFF, redefined
from scipy.spatial.transform import Rotation

from orip.records.control import Station
from orip.structs import replace

MADE = aerial_block("stations", 6)
ARM, TURN, OFFSET = np.array([0.4, -0.3, 1.2]), np.array([0.6, -0.4, 2.5]), 0.05
SHIFTS = np.array([[0.4, -0.3, 0.5], [-0.2, 0.1, 0.3], [0.6, 0.2, -0.4]])
DRIFTS = np.array([[0.002, -0.001, 0.003], [0.0, 0.0, 0.0], [-0.002, 0.004, 0.001]])
STRIP = np.arange(15) // 5
SPEED = 60.0


NO_VECTOR, NO_TABLE = np.zeros(3), np.zeros((3, 3))


def stations(arm=NO_VECTOR, turn=NO_VECTOR, shifts=NO_TABLE, drifts=NO_TABLE, error=0.01, **more):
    """Return the stations of the block without errors, computed with scipy's rotations."""
    found = []
    centres = MADE.orientations[:, :3]
    time = np.zeros(15)
    for strip in range(3):
        mine = np.flatnonzero(strip == STRIP)
        length = np.linalg.norm(np.diff(centres[mine], axis=0), axis=1)
        time[mine] = 1000.0 * strip + np.concatenate([[0.0], np.cumsum(length)]) / SPEED
    for row, orientation in enumerate(MADE.orientations):
        rotation = Rotation.from_euler("XYZ", orientation[3:])
        navigation = rotation * Rotation.from_euler("XYZ", turn, degrees=True).inv()
        elapsed = time[row] - time[STRIP[row] == STRIP].mean()
        position = orientation[:3] + rotation.apply(arm) + shifts[STRIP[row]] + elapsed * drifts[STRIP[row]]
        found.append(
            Station(
                f"p{row + 1}", tuple(position.tolist()), (error,) * 3, tuple(navigation.as_euler("XYZ").tolist()),
                (1e-5,) * 3, time=float(time[row]), strip=str(STRIP[row] + 1), **more,
            )
        )  # fmt: skip
    return tuple(found)


def with_stations(observed, antenna=None, block=None):
    block = MADE.block if block is None else block
    return replace(redefined(block, **OFF), stations=observed, antennas=() if antenna is None else (antenna,))
