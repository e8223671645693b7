"""Constants that cannot be removed from the unknowns: enforced as exact equations.

A weight large enough to enforce them would cost the normal equations their digits. Such an equation has a moderate
error instead, and after each iteration its value is shifted by the remaining misclosure (an augmented Lagrangian).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.kinds.observation import Observations
from orip.bundle.state import BlockState
from orip.records.block import Block

_PART_OF_PHOTO_ERROR = 0.01
"""Error that the equation of a constant has, as a part of what a photo error changes of it."""


class ExactObservations(Observations, frozen=True):
    """Exact constraints: the first base class, before the kind of observation whose equations they have."""

    exact: ClassVar[bool] = True

    def remembered(self, state: BlockState) -> FloatArray:
        """Return the shifts of the equations, increased by the remaining misclosures."""
        missing = self.linearise_with_partials(state).residual
        return np.asarray(state.memory.get(self.rows.kind.name, 0.0) + missing)


def photo_error_on_ground(block: Block) -> float:
    """Return the size of a photo error on the ground at the mean distance of the points from their photos."""
    points = block.photo_points
    distance = np.linalg.norm(block.point_start[points.point] - block.photo_orientation[points.photo, :3], axis=1)
    principal = np.array([camera.parameters[0] for camera in block.cameras])[block.photo_camera[points.photo]]
    return float(np.mean(points.error) * np.mean(distance / principal))


def error_of_constant_lengths(block: Block) -> float:
    """Return 1 % of the size of a photo error on the ground."""
    return _PART_OF_PHOTO_ERROR * photo_error_on_ground(block)


def error_of_constant_angles(block: Block) -> float:
    """Return 1 % of the angle (radians) of a photo error in the mean camera."""
    principal = np.array([camera.parameters[0] for camera in block.cameras])[block.photo_camera]
    return float(_PART_OF_PHOTO_ERROR * np.mean(block.photo_points.error) / np.mean(principal))
