"""Ground coordinates: those of the project, and those that a block is adjusted in; models of the terrain.

Without a coordinate reference system the two are the same. With one the project's are eastings, northings and heights,
and the block is adjusted in a Cartesian frame; what relates the two is a `GroundSystem`.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple, Protocol

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.errors import ProjectWarning
from orip.records.figures import Terrain


class ProjectCoordinates(NamedTuple):
    """The project's coordinates (n, 3) of n places, and their partials (n, 3, 3) by the places' local ones."""

    value: FloatArray
    by_local: FloatArray


class GroundSystem(Protocol):
    """The project's coordinates as functions of the local ones, in one unit; arrays (n, 3) of n places."""

    @property
    def warnings(self) -> tuple[ProjectWarning, ...]:
        """Return warnings of what was assumed."""

    @property
    def dependence(self) -> BoolArray:
        """Return which local coordinates (columns) each of X, Y, Z (rows) depends on, array (3, 3)."""

    @abstractmethod
    def to_local(self, xyz: FloatArray) -> FloatArray:
        """Return local coordinates; NaN throughout for a place that has none."""

    @abstractmethod
    def to_project(self, local: FloatArray) -> FloatArray:
        """Return coordinates in the project; NaN throughout for a place that has none."""

    @abstractmethod
    def axes_at(self, xyz: FloatArray) -> FloatArray:
        """Return the rotations (n, 3, 3) from local to the project's axes at places of the project."""

    @abstractmethod
    def project_with_partials(self, local: FloatArray) -> ProjectCoordinates:
        """Return coordinates in the project and their partials by local ones."""

    @abstractmethod
    def cofactors_to_project(self, local: FloatArray, cofactors: FloatArray, /) -> FloatArray:
        """Return the cofactors (n, 3, 3) of the project's coordinates of places from those of local ones."""

    @abstractmethod
    def description(self) -> tuple[str, ...]:
        """Return lines for a listing."""


class PlainGround(Struct, frozen=True):
    """A plain right-handed system: the project's coordinates are the local ones."""

    @property
    def warnings(self) -> tuple[ProjectWarning, ...]:
        """Return none."""
        return ()

    @property
    def dependence(self) -> BoolArray:
        """Return that each coordinate depends on itself alone."""
        return np.eye(3, dtype=np.bool_)

    def to_local(self, xyz: FloatArray) -> FloatArray:
        """Return the coordinates."""
        return xyz

    def to_project(self, local: FloatArray) -> FloatArray:
        """Return the coordinates."""
        return local

    def axes_at(self, xyz: FloatArray) -> FloatArray:
        """Return unit matrices."""
        return _unit_matrices(xyz)

    def project_with_partials(self, local: FloatArray) -> ProjectCoordinates:
        """Return the coordinates, and unit matrices."""
        return ProjectCoordinates(local, _unit_matrices(local))

    def cofactors_to_project(self, _local: FloatArray, cofactors: FloatArray, /) -> FloatArray:
        """Return the cofactors."""
        return cofactors

    def description(self) -> tuple[str, ...]:
        """Return no lines: there is nothing to say."""
        return ()


PLAIN = PlainGround()


def _unit_matrices(places: FloatArray) -> FloatArray:
    return np.broadcast_to(np.eye(3), (len(places), 3, 3))


class HeightGrid(Struct, frozen=True):
    """Heights in a raster.

    Parameters
    ----------
    heights : array (rows, columns)
        NaN: none.
    to_pixels : tuple of 6 float
        a, b, c, d, e, f: column = a X + b Y + c, row = d X + e Y + f, from the outer corner of the first pixel.
    crs : str or None
        Its system as WKT, if it says which.
    """

    heights: FloatArray
    to_pixels: tuple[float, float, float, float, float, float]
    crs: str | None = None


class TerrainModel(Struct, frozen=True):
    """A terrain model with its heights."""

    terrain: Terrain
    grid: HeightGrid


class TerrainHeight(Struct, frozen=True):
    """An observation that a point lies on a terrain model.

    The a-priori error, ground units, is that of the height there with the part of the slope: negative disregarded.
    """

    terrain: str
    point: str
    error: float
