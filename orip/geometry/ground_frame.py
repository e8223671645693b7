"""The frame a block is adjusted in: local topocentric, where the project's coordinates are curved.

With a coordinate reference system the project's X, Y, Z are eastings, northings and heights: the grid has its own
scale and north, and heights follow the earth's curvature. Collinearity wants a Cartesian system. The local frame is
one: east, north and up at an origin in the middle of the block, in the project's unit. Nothing is approximated: the
project's coordinates are functions of the local ones, with partials.

"Place" below means east, north and up (along the ellipsoid's normal) at a point itself, not at the origin.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.errors import InputError, ProjectWarning
from orip.geometry.ground_crs import GroundCrs, degrees_at, ground_crs
from orip.geometry.ground_ellipsoid import geocentric_from_geographic, geographic_from_geocentric, place_axes
from orip.records.ground import ProjectCoordinates
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN

_STEP = 100.0
"""Metres to each side in the differences of a map projection.

The third derivatives of a projection are of the order of 1/R², so that a central difference is off by some
(100 m / R)² / 6 = 4e-11; the 1e-9 m to which coordinates are held add 1e-11. Both are far below 1e-9 rad.
"""

_CONFORMAL = 1e-6
"""Angular distortion (radians) below which the axes of the grid count as perpendicular: 0.2 seconds of arc."""


class GroundFrame(Struct, frozen=True):
    """A local topocentric frame: x east, y north, z up at its origin, in the project's ground unit.

    Parameters
    ----------
    origin : array (3,)
        In the project's coordinates; (0, 0, 0) in the local frame.
    geocentric_origin : array (3,)
        Metres.
    axes : array (3, 3)
        Rows are the local axes, geocentric.
    convergence : float
        Meridian convergence at the origin, radians: from true north to grid north, positive to the east.
    scale : float
        Lengths on the grid over lengths on the ground at the origin: scale of the map, and of its height.
    """

    crs: GroundCrs
    origin: FloatArray
    geocentric_origin: FloatArray
    axes: FloatArray
    convergence: float
    scale: float
    warnings: tuple[ProjectWarning, ...]

    @property
    def dependence(self) -> NDArray[np.bool_]:
        """Return that each of X, Y, Z depends on all three local coordinates, array (3, 3)."""
        return np.ones((3, 3), dtype=np.bool_)

    def to_local(self, xyz: FloatArray) -> FloatArray:
        """Return local coordinates of coordinates in the project.

        `xyz` is an array (n, 3), the result (n, 3): NaN throughout for a point with an unknown coordinate, or outside
        the system.
        """
        return self._local_of(self._geocentric_of(self.crs.to_geographic(xyz)))

    def to_project(self, local: FloatArray) -> FloatArray:
        """Return coordinates in the project of local coordinates; the inverse of `to_local`.

        `local` is an array (n, 3), the result (n, 3): NaN throughout for a point outside the system.
        """
        return self._project_of(self._geocentric(local))

    def axes_at(self, xyz: FloatArray) -> FloatArray:
        """Return the rotations from the local axes to the project's axes at places.

        With R_local from photo to local axes, the rotation in the project is ``axes_at(X0) @ R_local``, X0 the
        projection centre in the project. It has the meridian convergence and the tilt of the vertical against that of
        the origin; the latter is of the ellipsoid, not the plumb line's.

        Parameters
        ----------
        xyz : array (n, 3)
            In the project's coordinates.

        Returns
        -------
        array (n, 3, 3)
            Rows are the directions of grid east, grid north and up in the local frame; orthonormal to rounding.

        Notes
        -----
        Place axes follow from longitude and latitude in closed form. The turn from there to the grid is the rotation
        next to the derivative of the projection (its polar decomposition, closed in two dimensions): scale drops out,
        and for a conformal projection the grid's own right angle is left as it is, at any height. Where a projection is
        not conformal, its angular distortion is shared evenly between the two axes.
        """
        return np.asarray(self.grid_axes_at(xyz) @ self._place_of_local(self.crs.to_geographic(xyz)))

    def grid_axes_at(self, xyz: FloatArray) -> FloatArray:
        """Return the rotations (n, 3, 3) from east, north, up to grid east, grid north, up: the meridian convergence.

        Parameters
        ----------
        xyz : array (n, 3)
            In the project's coordinates.
        """
        angle = _turn(self._by_place(self.crs.to_geographic(xyz))[:, :2, :2])
        sine, cosine, zero, one = np.sin(angle), np.cos(angle), np.zeros_like(angle), np.ones_like(angle)
        rows = [[cosine, -sine, zero], [sine, cosine, zero], [zero, zero, one]]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def jacobian_at(self, xyz: FloatArray) -> FloatArray:
        """Return the partials (n, 3, 3) of the project's coordinates by local ones, at places (n, 3) in the project.

        A cofactor block Q of local coordinates is ``J @ Q @ J.T`` in the project.
        """
        return self._partials(self.crs.to_geographic(xyz))

    def project_with_partials(self, local: FloatArray) -> ProjectCoordinates:
        """Return the project's coordinates and their partials by local ones.

        Observations and constants in the project's coordinates are not transformed: each of X, Y and Z is a function of
        the three local unknowns of a point.

        Parameters
        ----------
        local : array (n, 3)
        """
        geocentric = self._geocentric(local)
        return ProjectCoordinates(self._project_of(geocentric), self._partials(self._geographic_of(geocentric)))

    def cofactors_to_project(self, local: FloatArray, cofactors: FloatArray, /) -> FloatArray:
        """Return the cofactors (n, 3, 3) of the project's coordinates of places from those of local ones."""
        by_local = self.project_with_partials(local).by_local
        return np.asarray(by_local @ cofactors @ by_local.transpose(0, 2, 1))

    def description(self) -> tuple[str, ...]:
        """Return lines for a listing: the frame, and what coordinates and rotations refer to."""
        longitude, latitude = degrees_at(self.crs, self.crs.to_geographic(self.origin[None])[0])
        at = f"{abs(latitude):.6f}° {'NS'[latitude < 0.0]} {abs(longitude):.6f}° {'EW'[longitude < 0.0]}"
        # adding zero takes the sign from a rounded -0
        convergence = round(self.convergence * DEGREES_PER_RADIAN, 5) + 0.0
        return (
            f"Adjusted in a local topocentric frame at {at} ({self.crs.ellipsoid})",
            f"Coordinates are in crs {self.crs.shown} ({self.crs.name}): X easting, Y northing, Z {self.crs.heights}",
            "Rotations refer to grid east, grid north and the ellipsoid's normal at each projection centre",
            f"At the origin: meridian convergence {convergence:.5f}°, grid over ground length {self.scale:.7f}",
        )

    def with_grid_of_origin(self) -> GroundFrame:
        """Return the frame with what the grid is like at its origin.

        Raises
        ------
        InputError
            If the grid is mirrored there.
        """
        place = self.crs.to_geographic(self.origin[None])
        grid = self._by_place(place)[:, :2, :2]
        if not np.isfinite(grid).all() or np.linalg.det(grid[0]) <= 0.0:
            message = (
                f"crs {self.crs.shown} ({self.crs.name}) has no right-handed grid in the middle of the block; X must "
                "grow to the east and Y to the north. Check the coordinates, or name another crs"
            )
            raise InputError.single(message)
        # on the ellipsoid: at a height, lengths to the east and to the north shrink by a little more and a little less
        on_ellipsoid = self._by_place(place * [1.0, 1.0, 0.0])[0, :2, :2]
        stretch = np.linalg.svd(on_ellipsoid, compute_uv=False)
        warnings = self.warnings
        distortion = 2.0 * float(np.arcsin((stretch[0] - stretch[1]) / (stretch[0] + stretch[1])))
        if distortion > _CONFORMAL:
            text = (
                f"is not conformal: in the middle of the block its grid changes angles by up to "
                f"{distortion * DEGREES_PER_RADIAN:.4f}°. Coordinates are right all the same; rotations refer to the "
                "rectangular axes nearest to the grid's"
            )
            warnings = (*warnings, ProjectWarning("crs-not-conformal", f"crs {self.crs.shown}", text))
        scale = float(np.sqrt(np.linalg.det(grid[0])))
        return replace(self, convergence=float(_turn(grid)[0]), scale=scale, warnings=warnings)

    def _project_of(self, geocentric: FloatArray) -> FloatArray:
        return self.crs.from_geographic(self._geographic_of(geocentric))

    def _geocentric_of(self, geographic: FloatArray) -> FloatArray:
        return geocentric_from_geographic(geographic, self.crs.semi_axes)

    def _geographic_of(self, geocentric: FloatArray) -> FloatArray:
        return geographic_from_geocentric(geocentric, self.crs.semi_axes)

    def _geocentric(self, local: FloatArray) -> FloatArray:
        return np.asarray(self.geocentric_origin + self.crs.metres_per_unit * local @ self.axes)

    def _local_of(self, geocentric: FloatArray) -> FloatArray:
        return np.asarray((geocentric - self.geocentric_origin) @ self.axes.T / self.crs.metres_per_unit)

    def _place_of_local(self, geographic: FloatArray) -> FloatArray:
        """Return the rotations (n, 3, 3) from local to place axes."""
        return np.asarray(place_axes(geographic) @ self.axes.T)

    def _partials(self, geographic: FloatArray) -> FloatArray:
        return np.asarray(self._by_place(geographic) @ self._place_of_local(geographic))

    def _by_place(self, geographic: FloatArray) -> FloatArray:
        """Return the partials (n, 3, 3) of the project's coordinates by lengths along place axes, ground units both.

        Differences to the east and north; upwards only Z changes, since projections and geoids do not know of height.
        """
        geocentric = self._geocentric_of(geographic)
        axes = place_axes(geographic)
        result = np.zeros((len(geographic), 3, 3))
        for column in (0, 1):
            step = _STEP * axes[:, column]
            difference = self._project_of(geocentric + step) - self._project_of(geocentric - step)
            result[:, :, column] = difference * (self.crs.metres_per_unit / (2.0 * _STEP))
        result[:, 2, 2] = 1.0
        return result


def ground_frame(crs: str, ground_unit: str, origin: FloatArray) -> GroundFrame:
    """Return the local frame of a project with a coordinate reference system.

    Parameters
    ----------
    crs : str
        A projected system, alone or with heights: ``EPSG:25832``, ``EPSG:25832+7837``.
    ground_unit : str
        Must be the unit of the system.
    origin : array (3,)
        X, Y, Z of a place in the middle of the block, in the system.

    Returns
    -------
    GroundFrame
        Its warnings say what was assumed.

    Raises
    ------
    InputError
        If the system does not fit (see `ground_crs`), is left-handed, or lacks a grid.
    """
    system = ground_crs(crs, ground_unit, origin)
    geographic = system.to_geographic(origin[None])
    at_origin = GroundFrame(
        crs=system,
        origin=origin,
        geocentric_origin=geocentric_from_geographic(geographic, system.semi_axes)[0],
        axes=place_axes(geographic)[0],
        convergence=0.0,
        scale=1.0,
        warnings=system.warnings,
    )
    return at_origin.with_grid_of_origin()


def _turn(grid: FloatArray) -> FloatArray:
    """Return the angles (n,) of the rotations next to matrices (n, 2, 2), counterclockwise."""
    return np.arctan2(grid[:, 1, 0] - grid[:, 0, 1], grid[:, 0, 0] + grid[:, 1, 1])
