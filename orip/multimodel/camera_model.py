"""Cameras of the drive table: their image equation, the frame lines, and how far the lens polynomial can be used.

A polynomial is a model of a lens as far as it rises. Where it falls again a second point of the object would be imaged
at the same place in the photo; such points count as not shown. The radius where that begins is the reach. Additional
parameters, which have even higher degrees, mean nothing beyond the photo; with them the reach is limited to slightly
more than the photo.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.geometry.projection import PROJECTIONS, Projection
from orip.interior.distortion import image_polynomial
from orip.interior.image_coordinates import ImageEquation
from orip.records.drive_table import DriveCamera
from orip.records.project.camera import RADIAL_PLACES
from orip.structs import replace

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
    image : ImageEquation
    half_frame : tuple (x, y)
        mm; infinite where there is no frame line.
    projection : Projection
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
