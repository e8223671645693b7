"""A ground coordinate X, Y or Z of the project as a function of local coordinates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.bundle.unknowns import CONSTANT
from orip.records.ground import GroundSystem


class Coordinates(NamedTuple):
    """Coordinates (n,) of the project, their partials (n, 3) by local ones, and which of them exist (n,)."""

    value: FloatArray
    by_local: FloatArray
    known: NDArray[np.bool_]


def coordinates_with_partials(ground: GroundSystem, local: FloatArray, axis: IntArray) -> Coordinates:
    """Return one coordinate of each of n positions.

    Parameters
    ----------
    ground : GroundSystem
    local : array (n, 3)
        The positions in the local frame.
    axis : array (n,) of int
        0, 1, 2: X, Y, Z.

    Returns
    -------
    Coordinates
        Zero where the project's system does not reach.
    """
    found = ground.project_with_partials(local)
    rows = np.arange(len(axis))
    value, by_local = found.value[rows, axis], found.by_local[rows, axis]
    known = np.isfinite(value) & np.isfinite(by_local).all(axis=1)
    return Coordinates(np.where(known, value, 0.0), np.where(known[:, None], by_local, 0.0), known)


def columns_of_coordinates(ground: GroundSystem, columns: IntArray, axis: IntArray) -> IntArray:
    """Return the unknowns (n, 3) that coordinates depend on, out of those (n, 3) of their positions."""
    return np.where(ground.dependence[axis], columns, CONSTANT)
