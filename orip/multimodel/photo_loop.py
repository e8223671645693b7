"""The loop equations of one photo: from the object to the place on its stage plate, and from there to a ray.

U = Rᵀ (X − X0)                 in the photo's axes
x, y                            the ideal coordinates, by the camera's projection
xf, yf                          the photo coordinates, by the camera model
xp = a0 + a1 xf + a2 yf         the plate coordinates, by the interior orientation
yp = b0 + b1 xf + b2 yf
"""

from __future__ import annotations

from math import isnan
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, Number
from orip.geometry.rotation import rotated, rotated_back
from orip.multimodel.camera_model import CameraModel
from orip.records.drive_table import DriveCode, DrivePhoto, StageLimits
from orip.records.project.photo import Stage


class PlatePlaces(NamedTuple):
    """Where n points of the object are shown.

    Attributes
    ----------
    plate : array (n, 2)
        Plate coordinates, also of points beyond the limits; NaN where the photo shows nothing.
    code : array (n,) of int
        A `DriveCode`: 0, or why the stage cannot be driven there.
    inside : array (n,) of bool
        The code is 0 and the point is within the frame lines.
    ratio : array (n,)
        The larger of |xf| / (FX / 2) and |yf| / (FY / 2).
    """

    plate: FloatArray
    code: NDArray[np.int64]
    inside: BoolArray
    ratio: FloatArray


class PlatePlace(NamedTuple):
    """Where one point of the object is shown: as `PlatePlaces`."""

    plate: tuple[float, float]
    code: DriveCode
    inside: bool
    ratio: float


class Rays(NamedTuple):
    """Directions (n, 3) of rays in the object system, of any length, and a `DriveCode` of each (n,)."""

    direction: FloatArray
    code: NDArray[np.int64]


class DrivenPhoto(Struct, frozen=True):
    """One photo, ready for driving.

    Parameters
    ----------
    name : str
    stage : {"UPPER", "LOWER"}
    limits : StageLimits
        Of its stage.
    camera : CameraModel
    centre : tuple (X0, Y0, Z0)
    rotation : tuple of 9 floats
        Photo axes to ground axes, row by row.
    affine, inverse : tuples of 6 floats
        Photo to plate and back: the shift and the two factors of x, then those of y.
    """

    name: str
    stage: Stage
    limits: StageLimits
    camera: CameraModel
    centre: tuple[float, float, float]
    rotation: tuple[float, ...]
    affine: tuple[float, ...]
    inverse: tuple[float, ...]

    def plate_place(self, x: float, y: float, z: float) -> PlatePlace:
        """Return where a point of the object is shown."""
        u1, u2, u3 = self._photo_axes(x, y, z)
        projection = self.camera.projection
        if not projection.is_in_front(u1, u2, u3):
            return PlatePlace((np.nan, np.nan), DriveCode.BEHIND_CAMERA, False, np.nan)
        xf, yf = self.camera.image.measured(*projection.ideal_coordinates(self.camera.principal_distance, u1, u2, u3))
        xp, yp = self.plate_of_photo(xf, yf)
        if isnan(xp) or isnan(yp):
            return PlatePlace((xp, yp), DriveCode.NOT_INVERTIBLE, False, np.nan)
        ratio = self.frame_ratio(xf, yf)
        if not self.is_on_stage(xp, yp):
            return PlatePlace((xp, yp), DriveCode.OUTSIDE_STAGE, False, ratio)
        return PlatePlace((xp, yp), DriveCode.NONE, ratio <= 1.0 and bool(self._is_near(u1, u2, u3)), ratio)

    def plate_places(self, xyz: FloatArray) -> PlatePlaces:
        """Return where points (n, 3) of the object are shown."""
        with np.errstate(all="ignore"):  # points that are not shown may have any values; the codes say which
            u1, u2, u3 = self._photo_axes(*np.ascontiguousarray(xyz.T))
            projection, near = self.camera.projection, self._is_near(u1, u2, u3)
            in_front = projection.is_in_front(u1, u2, u3)
            depth = np.where(in_front, u3, np.nan)
            ideal = projection.ideal_coordinates(self.camera.principal_distance, u1, u2, depth)
            xf, yf = self.camera.image.measured(*ideal)
            xp, yp = self.plate_of_photo(xf, yf)
            ratio = self.frame_ratio(xf, yf)
        code = np.where(self.is_on_stage(xp, yp), DriveCode.NONE, DriveCode.OUTSIDE_STAGE)
        code[np.isnan(xp) | np.isnan(yp)] = DriveCode.NOT_INVERTIBLE
        code[~in_front] = DriveCode.BEHIND_CAMERA
        inside = (code == DriveCode.NONE) & (ratio <= 1.0) & near
        return PlatePlaces(np.stack([xp, yp], axis=1), code, inside, ratio)

    def may_be_inside(self, x: Number, y: Number, z: Number) -> bool | BoolArray:
        """Tell quickly whether a point of the object may be within the frame; False is certain."""
        return self._is_near(*self._photo_axes(x, y, z))

    def ray(self, xp: float, yp: float) -> tuple[float, float, float] | None:
        """Return the direction of the ray of a plate position; None where the camera model has no inverse."""
        x, y = self.camera.image.ideal(*self.photo_of_plate(xp, yp))
        if isnan(x) or isnan(y):
            return None
        return self._object_axes(x, y)

    def rays(self, plate: FloatArray) -> Rays:
        """Return the rays of plate positions (n, 2)."""
        with np.errstate(all="ignore"):  # NaN positions give NaN rays, and their code
            x, y = self.camera.image.ideal(*self.photo_of_plate(*np.ascontiguousarray(plate.T)))
            direction = np.stack(self._object_axes(x, y), axis=1)
        return Rays(direction, np.where(np.isnan(direction).any(axis=1), DriveCode.NOT_INVERTIBLE, DriveCode.NONE))

    def plate_of_photo(self, xf: Number, yf: Number) -> tuple[Number, Number]:
        """Return plate coordinates of photo coordinates."""
        return _transformed(self.affine, xf, yf)

    def photo_of_plate(self, xp: Number, yp: Number) -> tuple[Number, Number]:
        """Return photo coordinates (mm) of plate coordinates."""
        return _transformed(self.inverse, xp, yp)

    def is_on_stage(self, xp: Number, yp: Number) -> bool | BoolArray:
        """Tell whether the stage can be driven to a position; never to NaN."""
        limits = self.limits
        return (limits.x_min <= xp) & (xp <= limits.x_max) & (limits.y_min <= yp) & (yp <= limits.y_max)

    def frame_ratio(self, xf: Number, yf: Number) -> Number:
        """Return the larger of |xf| / (FX / 2) and |yf| / (FY / 2): up to 1 within the frame lines."""
        half_x, half_y = self.camera.half_frame
        of_x, of_y = abs(xf) / half_x, abs(yf) / half_y
        if isinstance(of_x, float) and isinstance(of_y, float):
            return max(of_x, of_y)
        return np.maximum(of_x, of_y)

    def _photo_axes(self, x: Number, y: Number, z: Number) -> tuple[Number, Number, Number]:
        """Return the coordinates U of a point of the object in the photo's axes."""
        x0, y0, z0 = self.centre
        return rotated_back(self.rotation, x - x0, y - y0, z - z0)

    def _object_axes(self, x: Number, y: Number) -> tuple[Number, Number, Number]:
        """Return the direction of ideal coordinates in the object system."""
        return rotated(self.rotation, *self.camera.projection.image_vector(self.camera.principal_distance, x, y))

    def _is_near(self, u1: Number, u2: Number, u3: Number) -> bool | BoolArray:
        near: bool | BoolArray = -u3 >= self.camera.least_cosine * (u1 * u1 + u2 * u2 + u3 * u3) ** 0.5
        return near


def driven_photo(photo: DrivePhoto, camera: CameraModel, limits: StageLimits) -> DrivenPhoto:
    """Make a photo of the drive table ready for driving.

    Parameters
    ----------
    photo : DrivePhoto
        Its affine transformation has an inverse.
    camera : CameraModel
        Of the photo.
    limits : StageLimits
        Of the photo's stage.
    """
    a0, a1, a2, b0, b1, b2 = photo.affine
    determinant = a1 * b2 - a2 * b1
    a1i, a2i, b1i, b2i = b2 / determinant, -a2 / determinant, -b1 / determinant, a1 / determinant
    inverse = (-(a1i * a0 + a2i * b0), a1i, a2i, -(b1i * a0 + b2i * b0), b1i, b2i)
    return DrivenPhoto(photo.name, photo.stage, limits, camera, photo.centre, photo.rotation, photo.affine, inverse)


def _transformed(factors: tuple[float, ...], x: Number, y: Number) -> tuple[Number, Number]:
    a0, a1, a2, b0, b1, b2 = factors
    return a0 + a1 * x + a2 * y, b0 + b1 * x + b2 * y
