"""The loop equations of one photo, from the object to its stage plate and back, and its camera's image equation."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, Number
from orip.geometry.projection import PROJECTIONS, Projection
from orip.geometry.rotation import rotated, rotated_back
from orip.interior.distortion import image_polynomial
from orip.interior.image_coordinates import ImageEquation
from orip.records.camera import RADIAL_PLACES
from orip.records.drive_table import DriveCamera, DriveCode, DrivePhoto, StageLimits
from orip.records.photo import Stage
from orip.structs import replace

# A polynomial is a model of a lens as far as it rises. Where it falls again a second point of the object would be
# imaged at the same place in the photo; such points count as not shown. The radius where that begins is the reach.
# Additional parameters, which have even higher degrees, mean nothing beyond the photo; with them the reach is limited
# to slightly more than the photo.

_REACH_IN_HALF_DIAGONALS = 1.5
_REACH_IN_BASES = 4.0
"""Where no frame is known: the base is 0.4 of its shorter side, half the diagonal of a usual one some two bases."""

_BORDER_PLACES = 33
_BEYOND_BORDER = 1.05
"""The border of the frame is sampled; between the samples the ideal radius is not larger by more than this factor."""


class CameraModel(Struct, frozen=True):
    """One camera.

    Parameters
    ----------
    principal_distance : float
        mm.
    half_frame : tuple (x, y)
        mm; infinite where there is no frame line.
    least_cosine : float
        Of the angle from the axis beyond which nothing is within the frame; that of the projection where there is none.
    """

    principal_distance: float
    image: ImageEquation
    half_frame: tuple[float, float]
    projection: Projection
    least_cosine: float

    def is_one_to_one(self, x: FloatArray, y: FloatArray) -> bool:
        """Tell whether the polynomials rise at all places (n,), mm from the principal point."""
        _, _, xx, xy, yx, yy = self.image.explicit_with_partials(x, y)
        within = np.all(self.image.is_within_reach(x, y))
        return bool(within and np.all(xx > 0.0) and np.all(xx * yy - xy * yx > 0.0))


def camera_model(camera: DriveCamera) -> CameraModel:
    """Make a camera of the drive table ready for driving."""
    principal_distance, x0, y0, *coefficients = camera.parameters
    half_x, half_y = (side / 2.0 if side > 0.0 else np.inf for side in camera.frame)
    at_measured = camera.distortion_at == "measured"
    reach_square, additional = _reach_square(camera.parameters[RADIAL_PLACES], -1.0 if at_measured else 1.0), None
    if camera.additional is not None:
        half_diagonal = _REACH_IN_HALF_DIAGONALS * np.hypot(half_x, half_y)
        reach = half_diagonal if np.isfinite(half_diagonal) else _REACH_IN_BASES * camera.additional.base
        reach_square = min(reach_square, float(reach * reach))
        values = np.array(camera.additional.values)
        additional = image_polynomial(camera.additional.name, camera.additional.base, values)
    image = ImageEquation(x0, y0, tuple(coefficients), at_measured, additional, reach_square)
    projection = PROJECTIONS[camera.projection]
    model = CameraModel(principal_distance, image, (half_x, half_y), projection, projection.least_cosine)
    return replace(model, least_cosine=_least_cosine(model))


def _least_cosine(camera: CameraModel) -> float:
    """Return the cosine of the largest angle from the axis within the frame, with a margin; of all without a frame."""
    half_x, half_y = camera.half_frame
    if not np.isfinite(half_x) or not np.isfinite(half_y):
        return camera.least_cosine
    side = np.linspace(-1.0, 1.0, _BORDER_PLACES)
    end = np.ones_like(side)
    border_x, border_y = np.concatenate([[side, end], [side, -end], [end, side], [-end, side]], axis=1)
    with np.errstate(all="ignore"):
        x, y = camera.image.ideal(half_x * border_x, half_y * border_y)
        vectors = camera.projection.image_vector(camera.principal_distance, _BEYOND_BORDER * x, _BEYOND_BORDER * y)
        largest = float(np.min(-vectors[2] / np.sqrt(sum(component**2 for component in vectors))))
    # NaN: the border is not shown everywhere
    return largest if largest > camera.least_cosine else camera.least_cosine


def _reach_square(radial: Sequence[float], sign: float) -> float:
    """Return the smallest r² at which r + sign (A1 r + A3 r³ + … + A9 r⁹) stops rising, infinite if none."""
    rising = sign * np.array([1.0, 3.0, 5.0, 7.0, 9.0]) * radial
    rising[0] += 1.0
    if not rising[0] > 0.0:
        return 0.0
    try:
        roots = np.roots(rising[::-1])
    except np.linalg.LinAlgError:  # no lens has coefficients that overflow
        return 0.0
    # a double root, at an inflection, may be computed with an imaginary part of the size of the root of the rounding
    turning = roots.real[(np.abs(roots.imag) <= 1e-7 * np.abs(roots)) & (roots.real > 0.0)]
    return float(turning.min(initial=np.inf))


# U = Rᵀ (X − X0)                 in the photo's axes
# x, y                            the ideal coordinates, by the camera's projection
# xf, yf                          the photo coordinates, by the camera model
# xp = a0 + a1 xf + a2 yf         the plate coordinates, by the interior orientation
# yp = b0 + b1 xf + b2 yf


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
    stage : {"UPPER", "LOWER"}
    limits : StageLimits
        Of its stage.
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
