"""The camera's image equation: ideal and measured photo coordinates, pixels, and image vectors freed of distortion."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, Number, parts
from orip.geometry.plane import PlaneTransformation
from orip.geometry.projection import PROJECTIONS
from orip.interior.additional_parameters import additional_with_partials
from orip.interior.distortion import (
    ImagePolynomial,
    Mapped,
    corrected_by_coefficients,
    corrected_with_partials,
    deformation_with_partials,
    distorted_by_coefficients,
    distorted_with_partials,
    inverse,
    remove_distortion,
)
from orip.records.block import Block
from orip.records.camera import READOUT, AdditionalSet, Camera, Sensor
from orip.records.photo import Photo, Scan, Template
from orip.structs import replace
from orip.threads import by_threads

# A polynomial at "ideal" coordinates gives the measured ones by a formula, one at "measured" coordinates the ideal
# ones. Additional parameters deform the image at the same place, relative to the fiducial centre:
#
#     measured = principal point + distorted(ideal) + deformation(principal point + ideal)
#     ideal    = corrected(measured - principal point) - deformation(measured)
#
# The other direction is found by Newton's method. The adjustment, the prediction of photo coordinates and the real-time
# loop have these equations from here; the compiled loops are held to them by tests.


class ImageEquation(Struct, frozen=True):
    """The image equation of one camera, for one point as plain numbers or n points as arrays (n,).

    Parameters
    ----------
    x0, y0 : float
        Principal point in the fiducial system, mm.
    coefficients : tuple of 9 floats
        A1, A3, A5, A7, A9, P1, P2, B1, B2.
    at_measured : bool
        The polynomial is given at measured coordinates.
    reach_square : float
        Square of the radius (mm²) up to which the polynomial is a model of the lens; nothing is shown beyond.
    """

    x0: float
    y0: float
    coefficients: tuple[float, ...]
    at_measured: bool
    additional: ImagePolynomial | None
    reach_square: float = np.inf

    def measured(self, x: Number, y: Number) -> tuple[Number, Number]:
        """Return photo coordinates (fiducial system, mm) of ideal ones; NaN for what the photo does not show.

        Arrays may overflow where nothing is shown; callers silence numpy.
        """
        if self.at_measured:
            x, y = self._inverse(x, y)
        else:
            x, y = _where(self.is_within_reach(x, y), *self.explicit_with_partials(x, y)[:2])
        return x + self.x0, y + self.y0

    def ideal(self, xf: Number, yf: Number) -> tuple[Number, Number]:
        """Return ideal coordinates (from the principal point, mm) of photo coordinates; NaN where there are none."""
        x, y = xf - self.x0, yf - self.y0
        if self.at_measured:
            return _where(self.is_within_reach(x, y), *self.explicit_with_partials(x, y)[:2])
        return self._inverse(x, y)

    def explicit_with_partials(self, x: Number, y: Number) -> Mapped[Number]:
        """Return what the formula gives: measured coordinates of ideal ones, or ideal ones of measured ones.

        Both are reduced to the principal point, mm.
        """
        if self.additional is None:
            return _formula(self.at_measured)(self.coefficients, x, y)
        deformation = deformation_with_partials(self.additional, x + self.x0, y + self.y0)
        return _deformed(self.at_measured, _formula(self.at_measured)(self.coefficients, x, y), deformation)

    def _inverse(self, u: Number, v: Number) -> tuple[Number, Number]:
        """Return what the formula gives u and v of; NaN where there is nothing within the reach."""
        if self.additional is None:
            # called some thousand times a second: without the calls in between; mypy forgets that it takes arrays too
            formula: Any = partial(_formula(self.at_measured), self.coefficients)
            x, y, found = inverse(formula, u, v)
        else:
            x, y, found = inverse(self.explicit_with_partials, u, v)
        return _where(found & self.is_within_reach(x, y), x, y)

    def is_within_reach(self, x: Number, y: Number) -> bool | BoolArray:
        """Tell whether the polynomial is evaluated within its reach for x, y (mm; numbers or arrays (n,))."""
        if self.at_measured:
            x = x - self.coefficients[7] * x - self.coefficients[8] * y
        within: bool | BoolArray = x * x + y * y < self.reach_square
        return within


class SetValues(NamedTuple):
    """Additional parameters of a camera: name of the set, base (mm) and values (k,)."""

    name: AdditionalSet
    base_mm: float
    values: FloatArray


class ImageResiduals(NamedTuple):
    """Residuals of n photo points, computed minus measured, and their partials.

    Attributes
    ----------
    value : array (n, 2)
        mm.
    by_ideal : array (n, 2, 2)
        Partials by the ideal coordinates.
    by_principal_point : array (n, 2, 2)
    by_coefficients : array (n, 2, 9)
    by_additional : array (n, 2, k)
        Without a set, k is 0.
    """

    value: FloatArray
    by_ideal: FloatArray
    by_principal_point: FloatArray
    by_coefficients: FloatArray
    by_additional: FloatArray


def image_residuals_with_partials(
    ideal: FloatArray, measured: FloatArray, camera: FloatArray, at_measured: bool, additional: SetValues | None
) -> ImageResiduals:
    """Return the residuals of photo points of cameras of one form.

    For a polynomial at "measured" coordinates the residual is that of the corrected coordinate.

    Parameters
    ----------
    ideal : array (n, 2)
        Computed by the perspective, mm.
    measured : array (n, 2)
        Photo coordinates, fiducial system, mm.
    camera : array (n, 11)
        Principal point and coefficients of each point's camera.
    at_measured : bool
        The polynomials are given at measured coordinates.
    additional : SetValues or None
        Of the camera, where all points are of one.
    """
    principal_point, coefficients = camera[:, :2], tuple(camera[:, 2:].T)
    argument = measured - principal_point if at_measured else ideal
    by_additional, by_place = np.empty((len(ideal), 2, 0)), np.zeros((1, 2, 2))
    x, y = np.ascontiguousarray(argument.T)
    mapped = _formula(at_measured)(coefficients, x, y)
    if additional is not None:
        place = measured if at_measured else principal_point + ideal
        found = additional_with_partials(additional.name, place, additional.base_mm, additional.values)
        by_additional, by_place = found.by_values, found.by_xy
        mapped = _deformed(at_measured, mapped, (*found.value.T, *found.by_xy.reshape(-1, 4).T))
    stacked = np.stack(mapped, axis=1)
    to, by_argument = stacked[:, :2], stacked[:, 2:].reshape(-1, 2, 2)
    unit = np.broadcast_to(np.eye(2), by_argument.shape)
    if at_measured:
        by_coefficients = -corrected_by_coefficients(coefficients, x, y)
        # the place of the deformation is measured, and does not move with the principal point
        return ImageResiduals(ideal - to, unit, by_argument + by_place, by_coefficients, by_additional)
    by_coefficients = distorted_by_coefficients(x, y)
    return ImageResiduals(principal_point + to - measured, by_argument, unit + by_place, by_coefficients, by_additional)


def _formula(at_measured: bool) -> Callable[[Sequence[float] | Sequence[Number], Number, Number], Mapped[Number]]:
    """Return the formula of the polynomial's form: from the argument of the polynomial to the other side."""
    return corrected_with_partials if at_measured else distorted_with_partials


def _deformed(at_measured: bool, mapped: Mapped[Number], deformation: Mapped[Number]) -> Mapped[Number]:
    """Return what a formula gives, with additional parameters: an image is deformed, an ideal place is corrected."""
    to_x, to_y, xx, xy, yx, yy = mapped
    dx, dy, dxx, dxy, dyx, dyy = deformation
    if at_measured:
        return to_x - dx, to_y - dy, xx - dxx, xy - dxy, yx - dyx, yy - dyy
    return to_x + dx, to_y + dy, xx + dxx, xy + dxy, yx + dyx, yy + dyy


def _where(holds: bool | BoolArray, x: Number, y: Number) -> tuple[Number, Number]:
    """Return x, y where a condition holds, NaN elsewhere."""
    if isinstance(x, float) and isinstance(y, float):
        return (x, y) if holds else (np.nan, np.nan)
    return np.where(holds, x, np.nan), np.where(holds, y, np.nan)


_PLANE_UP_TO = math.radians(70.0)
"""Angle from the axis up to which a ray of a fisheye photo is compared in a plane image."""


def image_vectors(block: Block) -> FloatArray:
    """Return the image vectors of all photo points of a block, mm.

    Returns
    -------
    array (n, 3)
        (x, y, -C) of ideal coordinates reduced to the principal point; of an equidistant camera a vector of the length
        C in the direction of the ray, which may be more than 90 degrees from the axis. NaN where the distortion
        cannot be removed.
    """
    points = block.photo_points
    vectors = np.empty((len(points.photo), 3))

    def put(rows: slice) -> None:
        vectors[rows] = _vectors_at_once(replace(block, photo_points=points.of(rows)))

    by_threads(put, parts(len(points.photo)))
    return vectors


def _vectors_at_once(block: Block) -> FloatArray:
    points = block.photo_points
    camera = block.photo_camera[points.photo]
    parameters = np.array([record.parameters for record in block.cameras])
    distorting = parameters[:, 3:READOUT].any(axis=1)
    at_measured = np.array([record.distortion_at == "measured" for record in block.cameras])
    vectors = np.column_stack([points.xy - parameters[camera, 1:3], -parameters[camera, 0]])
    rows = np.flatnonzero((distorting & at_measured)[camera])
    corrected = corrected_with_partials(
        tuple(parameters[camera[rows], 3:READOUT].T), vectors[rows, 0], vectors[rows, 1]
    )
    vectors[rows, :2] = np.stack(corrected[:2], axis=1)
    rows = np.flatnonzero((distorting & ~at_measured)[camera])
    vectors[rows, :2] = remove_distortion(vectors[rows, :2], parameters[camera[rows], 3:READOUT])
    rows = np.flatnonzero(are_equidistant(block))
    x, y, z = vectors[rows].T
    vectors[rows] = np.stack(PROJECTIONS["equidistant"].image_vector(-z, x, y), axis=1)
    return vectors


def suit_plane_image(vectors: FloatArray, is_equidistant: BoolArray) -> BoolArray:
    """Return which image vectors (n, 3) can be compared in a plane image: of fisheyes those near the axis."""
    near: BoolArray = -vectors[:, 2] > math.cos(_PLANE_UP_TO) * np.linalg.norm(vectors, axis=1)
    return ~is_equidistant | near


def are_equidistant(block: Block) -> BoolArray:
    """Return which photo points (n,) of a block are of cameras with equidistant projection."""
    cameras: BoolArray = np.array([camera.projection == "equidistant" for camera in block.cameras], dtype=bool)
    return cameras[block.photo_camera[block.photo_points.photo]]


def sensor_transformation(sensor: Sensor) -> PlaneTransformation:
    """Return the transformation from pixels (outer corner of the upper left pixel, rows down) to photo millimetres."""
    x_pixel, y_pixel = sensor.width / sensor.columns, sensor.height / sensor.rows
    return PlaneTransformation(
        np.array([[x_pixel, 0.0], [0.0, -y_pixel]]), np.array([-sensor.width / 2.0, sensor.height / 2.0])
    )


def scan_transformation(scan: Scan) -> PlaneTransformation:
    """Return the transformation from scan pixels (column right, row down) to plate millimetres (y up)."""
    x_pixel, y_pixel = scan.pixel
    to_corner = 0.5 if scan.origin == "centre" else 0.0
    return PlaneTransformation(
        np.array([[x_pixel, 0.0], [0.0, -y_pixel]]), np.array([to_corner * x_pixel, -to_corner * y_pixel])
    )


def pixel_size(
    photo: Photo, camera: Camera, template: Template | None, plate_to_photo: PlaneTransformation | None
) -> tuple[float, float] | None:
    """Return the size (mm) of a photo's pixels along its x and y axes, or None where it has neither sensor nor scan.

    Parameters
    ----------
    template : Template or None
        The template that the photo is on.
    plate_to_photo : PlaneTransformation or None
        How the photo lies in its scan: columns may run along its y axis. None, where that is not known, stands for an
        upright one.

    Notes
    -----
    Columns and rows are taken as equally precise, in pixels: where the photo lies askew, the size along an axis is the
    root of the square sum of what a column and a row contribute to it.
    """
    if camera.sensor is not None:
        sensor = camera.sensor
        return sensor.width / sensor.columns, sensor.height / sensor.rows
    scan = photo.scan or (template.scan if template else None)
    if scan is None or plate_to_photo is None:
        return scan.pixel if scan else None
    along_x, along_y = np.hypot(*(plate_to_photo.matrix * scan.pixel).T)
    return float(along_x), float(along_y)
