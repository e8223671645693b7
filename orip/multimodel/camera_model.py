"""The camera model in the real-time loop: from ideal to measured photo coordinates and back.

The equations are those of docs/conventions.md; `orip.interior` has them with all the partials that an adjustment wants.
Here every function takes one point as plain numbers, or many as arrays, and computes nothing that driving does not
need: a measuring mark is moved thousands of times a second. Arrays may overflow where nothing is shown; their callers
silence numpy.

A polynomial is a model of a lens as far as it rises. Where it falls again a second point of the object would be shown
at the same place of the photo; such points count as not shown. The radius where that begins is the reach. Additional
parameters, of higher degree yet, say nothing beyond the photo; with them the reach is at most a little more than that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.interior.additional_parameters import PARAMETER_SETS
from orip.records.drive_table import DriveCamera, DriveParameterSet

Number = TypeVar("Number", float, FloatArray)
"""One coordinate of one point, or of n points as an array (n,)."""

IN_FRONT = 1e-6
"""Smallest part that the depth of a point has of its distance; the perspective of the adjustment has the same."""

_NEWTON_STEPS = 10
_STEP_ENOUGH_MM = 1e-12
_REACH_IN_HALF_DIAGONALS = 1.5
_REACH_IN_BASES = 4.0
"""Where no frame is known: the base is 0.4 of its shorter side, half the diagonal of a usual one some two bases."""

_BORDER_PLACES = 33
_BEYOND_BORDER = 1.05
"""The border of the frame is looked at in places; between them the ideal radius is not larger by this factor."""

_FOUND_MM = 1e-9
"""A thousandth of a thousandth of what a stage can be read to."""


class ImagePolynomial(NamedTuple):
    """Coefficients (m, m) of x^i y^j in dx and dy and in their derivatives by x and y, as nested tuples, with the unit.

    Coordinates are divided by `unit` (mm) first; dx and dy are mm.
    """

    unit: float
    dx: tuple[tuple[float, ...], ...]
    dy: tuple[tuple[float, ...], ...]
    dx_by_x: tuple[tuple[float, ...], ...]
    dx_by_y: tuple[tuple[float, ...], ...]
    dy_by_x: tuple[tuple[float, ...], ...]
    dy_by_y: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class CameraModel:
    """One camera.

    Parameters
    ----------
    principal_distance, x0, y0 : float
        mm; x0, y0 is the principal point in the fiducial system.
    coefficients : tuple of 8 floats
        In the order of `DISTORTION_PARAMETERS`.
    at_measured : bool
        The polynomial is given at measured coordinates.
    additional : ImagePolynomial or None
    reach_square : float
        Square of the reach, mm²; infinite for a polynomial that never falls.
    half_frame : tuple (x, y)
        mm; infinite where there is no frame line.
    bound_square : float
        Square of (x, y) / C beyond which nothing is within the frame; that of all in front where there is no frame.
    """

    principal_distance: float
    x0: float
    y0: float
    coefficients: tuple[float, ...]
    at_measured: bool
    additional: ImagePolynomial | None
    reach_square: float
    half_frame: tuple[float, float]
    bound_square: float = IN_FRONT**-2

    def measured(self, x: Number, y: Number) -> tuple[Number, Number]:
        """Return photo coordinates (fiducial system, mm) of ideal ones; NaN for what the photo does not show."""
        if self.at_measured:
            x, y = self._inverse(self._corrected_with_partials, x, y)
        else:
            x, y = _where(x * x + y * y < self.reach_square, *self._distorted_with_partials(x, y)[:2])
        return x + self.x0, y + self.y0

    def ideal(self, xf: Number, yf: Number) -> tuple[Number, Number]:
        """Return ideal coordinates (from the principal point, mm) of photo coordinates; NaN where there are none."""
        x, y = xf - self.x0, yf - self.y0
        if not self.at_measured:
            return self._inverse(self._distorted_with_partials, x, y)
        return _where(self._within_reach(x, y), *self._corrected_with_partials(x, y)[:2])

    def is_one_to_one(self, x: FloatArray, y: FloatArray) -> bool:
        """Tell whether the polynomials rise all over the places (n,), mm from the principal point."""
        function = self._corrected_with_partials if self.at_measured else self._distorted_with_partials
        _, _, xx, xy, yx, yy = function(x, y)
        return bool(np.all(self._within_reach(x, y)) and np.all(xx > 0.0) and np.all(xx * yy - xy * yx > 0.0))

    def _within_reach(self, x: Number, y: Number) -> bool | NDArray[np.bool_]:
        """Tell whether the argument of the polynomial is within the reach, for coordinates that `_inverse` finds."""
        if self.at_measured:
            x = x - self.coefficients[6] * x - self.coefficients[7] * y
        within: bool | NDArray[np.bool_] = x * x + y * y < self.reach_square
        return within

    def _distorted_with_partials(self, x: Number, y: Number) -> tuple[Number, ...]:
        """Return measured coordinates of ideal ones, both from the principal point, and xx, xy, yx, yy.

        The partials are those of x by x, x by y, y by x and y by y.
        """
        b1, b2 = self.coefficients[6:]
        dx, dy, xx, xy, yx, yy = _distortion_with_partials(self.coefficients, x, y)
        found = (x + dx + b1 * x + b2 * y, y + dy, 1.0 + xx + b1, xy + b2, yx, 1.0 + yy)
        if self.additional is None:
            return found
        added = _additional_with_partials(self.additional, x + self.x0, y + self.y0)
        return tuple(each + more for each, more in zip(found, added, strict=True))

    def _corrected_with_partials(self, x: Number, y: Number) -> tuple[Number, ...]:
        """Return ideal coordinates of measured ones, for a polynomial at measured coordinates; else as above."""
        b1, b2 = self.coefficients[6:]
        freed = x - b1 * x - b2 * y
        dx, dy, xx, xy, yx, yy = _distortion_with_partials(self.coefficients, freed, y)
        by_freed, along = 1.0 - xx, 1.0 - b1
        found = (freed - dx, y - dy, by_freed * along, -by_freed * b2 - xy, -yx * along, 1.0 - yy + yx * b2)
        if self.additional is None:
            return found
        added = _additional_with_partials(self.additional, x + self.x0, y + self.y0)
        return tuple(each - more for each, more in zip(found, added, strict=True))

    def _inverse(
        self, function: Callable[[Number, Number], tuple[Number, ...]], u: Number, v: Number
    ) -> tuple[Number, Number]:
        """Return x, y with function(x, y) = u, v by Newton's method; NaN where there are none within the reach."""
        x, y = u, v
        for _ in range(_NEWTON_STEPS):
            fu, fv, xx, xy, yx, yy = function(x, y)
            # a floor keeps plain numbers from dividing by zero; such a step finds nothing
            du, dv, determinant = fu - u, fv - v, xx * yy - xy * yx + 1e-300
            misfit = abs(du) + abs(dv)
            if not _any_above(misfit, _STEP_ENOUGH_MM):
                break
            x, y = x - (yy * du - xy * dv) / determinant, y - (xx * dv - yx * du) / determinant
        return _where((misfit < _FOUND_MM) & (determinant > 0.0) & self._within_reach(x, y), x, y)


def camera_model(camera: DriveCamera) -> CameraModel:
    """Make a camera of the drive table ready for driving."""
    principal_distance, x0, y0, *coefficients = camera.parameters
    half_x, half_y = (side / 2.0 if side > 0.0 else np.inf for side in camera.frame)
    reach_square = _reach_square(coefficients[:4], -1.0 if camera.distortion_at == "measured" else 1.0)
    if camera.additional is not None:
        half_diagonal = _REACH_IN_HALF_DIAGONALS * np.hypot(half_x, half_y)
        reach = half_diagonal if np.isfinite(half_diagonal) else _REACH_IN_BASES * camera.additional.base
        reach_square = min(reach_square, float(reach * reach))
    model = CameraModel(
        principal_distance,
        x0,
        y0,
        tuple(coefficients),
        camera.distortion_at == "measured",
        image_polynomial(camera.additional) if camera.additional is not None else None,
        reach_square,
        (half_x, half_y),
    )
    return replace(model, bound_square=_bound_square(model))


def image_polynomial(parameters: DriveParameterSet) -> ImagePolynomial:
    """Write a parameter set with its values as polynomials in x and y.

    Each term of a set is a product of a polynomial in x and one in y, of degree m - 1 at most; m places determine them.
    """
    parameter_set = PARAMETER_SETS[parameters.name]
    size = parameter_set.factors.shape[2]
    nodes = np.linspace(-1.0, 1.0, size)
    at_nodes = parameter_set.basis(parameters.base * nodes, np.full(size, parameters.base)).value
    powers = np.linalg.solve(np.vander(nodes, increasing=True), at_nodes)
    # factors are of B_i(y) A_j(x)
    by_product = np.einsum("k,ckij->cij", np.array(parameters.values), parameter_set.factors)
    dx, dy = np.einsum("pj,cij,qi->cpq", powers, by_product, powers)
    degrees = np.arange(1.0, size) / parameters.base
    parts = dx, dy, degrees[:, None] * dx[1:], dx[:, 1:] * degrees, degrees[:, None] * dy[1:], dy[:, 1:] * degrees
    return ImagePolynomial(parameters.base, *(tuple(map(tuple, part.tolist())) for part in parts))


def _distortion_with_partials(coefficients: tuple[float, ...], x: Number, y: Number) -> tuple[Number, ...]:
    """Return dx, dy without the affinity, and their partials by x and y in the order xx, xy, yx, yy."""
    a1, a3, a5, a7, p1, p2 = coefficients[:6]
    x2, y2, product = x * x, y * y, 2.0 * x * y
    s = x2 + y2
    radial = a1 + s * (a3 + s * (a5 + s * a7))
    by_s = a3 + s * (2.0 * a5 + s * (3.0 * a7))
    cross = product * by_s + 2.0 * (p1 * y + p2 * x)
    return (
        x * radial + p1 * (s + 2.0 * x2) + p2 * product,
        y * radial + p2 * (s + 2.0 * y2) + p1 * product,
        radial + 2.0 * x2 * by_s + 6.0 * p1 * x + 2.0 * p2 * y,
        cross,
        cross,
        radial + 2.0 * y2 * by_s + 6.0 * p2 * y + 2.0 * p1 * x,
    )


def _additional_with_partials(polynomial: ImagePolynomial, xf: Number, yf: Number) -> tuple[Number, ...]:
    """Return dx, dy and their partials by x and y in the order xx, xy, yx, yy."""
    x, y = xf / polynomial.unit, yf / polynomial.unit
    return tuple(_horner(coefficients, x, y) for coefficients in polynomial[1:])


def _horner(coefficients: tuple[tuple[float, ...], ...], x: Number, y: Number) -> Number:
    total = 0.0 * x
    for row in reversed(coefficients):
        of_y = 0.0 * y
        for coefficient in reversed(row):
            of_y = of_y * y + coefficient
        total = total * x + of_y
    return total


def _bound_square(camera: CameraModel) -> float:
    """Return the largest square of (x, y) / C within the frame, with something to spare; that of all in front else."""
    half_x, half_y = camera.half_frame
    if not np.isfinite(half_x) or not np.isfinite(half_y):
        return camera.bound_square
    side = np.linspace(-1.0, 1.0, _BORDER_PLACES)
    end = np.ones_like(side)
    border_x, border_y = np.concatenate([[side, end], [side, -end], [end, side], [-end, side]], axis=1)
    with np.errstate(all="ignore"):
        x, y = camera.ideal(half_x * border_x, half_y * border_y)
        largest = _BEYOND_BORDER**2 * float(np.max(x * x + y * y))
    bound = largest / camera.principal_distance / camera.principal_distance
    return bound if bound < camera.bound_square else camera.bound_square


def _reach_square(radial: list[float], sign: float) -> float:
    """Return the smallest r² at which r + sign (A1 r + A3 r³ + A5 r⁵ + A7 r⁷) stops rising, infinite if none."""
    rising = np.array([1.0, 0.0, 0.0, 0.0]) + sign * np.array([1.0, 3.0, 5.0, 7.0]) * radial
    if not rising[0] > 0.0:
        return 0.0
    try:
        roots = np.roots(rising[::-1])
    except np.linalg.LinAlgError:  # coefficients that overflow are those of no lens
        return 0.0
    # a double root, where the curve only rests, may come out with an imaginary part of the root of the rounding
    turning = roots.real[(np.abs(roots.imag) <= 1e-7 * np.abs(roots)) & (roots.real > 0.0)]
    return float(turning.min(initial=np.inf))


def _any_above(values: float | FloatArray, limit: float) -> bool:
    """Tell whether any is above; what has run away to NaN is not, and does not keep the others waiting."""
    return values > limit if isinstance(values, float) else bool(np.any(values > limit))


def _where(holds: bool | NDArray[np.bool_], x: Number, y: Number) -> tuple[Number, Number]:
    """Return x, y where a condition holds, NaN elsewhere."""
    if isinstance(x, float) and isinstance(y, float):
        return (x, y) if holds else (np.nan, np.nan)
    return np.where(holds, x, np.nan), np.where(holds, y, np.nan)
