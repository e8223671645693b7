"""Constants that are no unknowns less, but equations that are met exactly.

A weight large enough to hold them would eat the digits of the normal equations. Such an equation has a moderate error
instead, and after each iteration its value is shifted by what the constant still misses (an augmented Lagrangian),
until it misses nothing.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.kinds.observation import Observations
from orip.bundle.state import State
from orip.records.block import Block

_PART_OF_PHOTO_ERROR = 0.01
"""Error of a constant in its equation, as a part of what a photo error does to it."""


class ExactObservations(Observations):
    """A kind of observation that is met exactly; goes before the kind that it is made of."""

    exact: ClassVar[bool] = True

    def remembered(self, state: State) -> FloatArray:
        """Return the shifts of the equations: grown by what the constants still miss."""
        missing = self.linearise_with_partials(state).residual
        return np.asarray(state.memory.get(self.rows.kind.name, 0.0) + missing)


def error_of_constant_lengths(block: Block) -> float:
    """Return 1 % of what a photo error means on the ground at the mean distance of the points from their photos."""
    points = block.photo_points
    distance = np.linalg.norm(block.point_start[points.point] - block.photo_orientation[points.photo, :3], axis=1)
    principal = np.array([camera.parameters[0] for camera in block.cameras])[block.photo_camera[points.photo]]
    return float(_PART_OF_PHOTO_ERROR * np.mean(points.error) * np.mean(distance / principal))


def error_of_constant_angles(block: Block) -> float:
    """Return 1 % of the angle (radians) of a photo error in the mean camera."""
    principal = np.array([camera.parameters[0] for camera in block.cameras])[block.photo_camera]
    return float(_PART_OF_PHOTO_ERROR * np.mean(block.photo_points.error) / np.mean(principal))
