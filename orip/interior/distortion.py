"""The camera model's distortion, other forms of giving it, and the polynomials of additional parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, Number
from orip.interior.additional_parameters import PARAMETER_SETS, basis_by_powers
from orip.records.camera import AdditionalSet

# Coordinates are millimetres reduced to the principal point; r is their radius:
#
#     dx = x (A1 + A3 r² + A5 r⁴ + A7 r⁶ + A9 r⁸) + P1 (r² + 2 x²) + 2 P2 x y + B1 x + B2 y
#     dy = y (A1 + A3 r² + A5 r⁴ + A7 r⁶ + A9 r⁸) + P2 (r² + 2 y²) + 2 P1 x y
#
# With the argument "ideal" the measured coordinates are the ideal ones plus (dx, dy); with "measured" the ideal ones
# are the measured ones, first freed of the affinity, minus (dx, dy) without its B terms.
#
# The formulas take one point as plain numbers, or n points as arrays (n,): a plate processor moves its measuring mark
# thousands of times a second, and arrays of one point would be far slower. Coefficients are 9 numbers, or 9 arrays
# (n,): A1, A3, A5, A7, A9, P1, P2, B1, B2.

Mapped = tuple[Number, Number, Number, Number, Number, Number]
"""x and y that a point is mapped to, and their partials: x by x, x by y, y by x and y by y.

A plain tuple: making a named one takes as long as a tenth of the formulas.
"""

_NEWTON_STEPS = 10
_STEP_ENOUGH_MM = 1e-12
_FOUND_MM = 1e-9
"""A thousandth of a thousandth of what can be measured; rounding may keep Newton's steps above their tolerance."""


def distorted_with_partials(coefficients: Sequence[float] | Sequence[Number], x: Number, y: Number) -> Mapped[Number]:
    """Return measured coordinates of ideal ones, for a polynomial at "ideal" coordinates."""
    b1, b2 = coefficients[7:]
    dx, dy, xx, xy, yx, yy = lens_distortion_with_partials(coefficients, x, y)
    return x + dx + b1 * x + b2 * y, y + dy, 1.0 + xx + b1, xy + b2, yx, 1.0 + yy


def corrected_with_partials(coefficients: Sequence[float] | Sequence[Number], x: Number, y: Number) -> Mapped[Number]:
    """Return ideal coordinates of measured ones, for a polynomial at "measured" coordinates.

    The affinity comes first: x' = x - B1 x - B2 y, y' = y; then (x', y') minus (dx, dy)(x', y') without the B terms.
    """
    b1, b2 = coefficients[7:]
    freed = x - b1 * x - b2 * y
    dx, dy, xx, xy, yx, yy = lens_distortion_with_partials(coefficients, freed, y)
    by_freed, along = 1.0 - xx, 1.0 - b1
    return freed - dx, y - dy, by_freed * along, -by_freed * b2 - xy, -yx * along, 1.0 - yy + yx * b2


def lens_distortion_with_partials(
    coefficients: Sequence[float] | Sequence[Number], x: Number, y: Number
) -> Mapped[Number]:
    """Return dx and dy without the affinity."""
    a1, a3, a5, a7, a9, p1, p2 = coefficients[:7]
    x2, y2, product = x * x, y * y, 2.0 * x * y
    s = x2 + y2
    radial = a1 + s * (a3 + s * (a5 + s * (a7 + s * a9)))
    by_s = a3 + s * (2.0 * a5 + s * (3.0 * a7 + s * (4.0 * a9)))
    cross = product * by_s + 2.0 * (p1 * y + p2 * x)
    return (
        x * radial + p1 * (s + 2.0 * x2) + p2 * product,
        y * radial + p2 * (s + 2.0 * y2) + p1 * product,
        radial + 2.0 * x2 * by_s + 6.0 * p1 * x + 2.0 * p2 * y,
        cross,
        cross,
        radial + 2.0 * y2 * by_s + 6.0 * p2 * y + 2.0 * p1 * x,
    )


def distorted_by_coefficients(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the partials (n, 2, 9) of `distorted_with_partials` by the coefficients, in which it is linear."""
    s, product = x * x + y * y, 2.0 * x * y
    partials = np.zeros((len(x), 2, 9))
    partials[:, 0, 0], partials[:, 1, 0] = x, y
    for power in (1, 2, 3, 4):
        partials[:, :, power] = partials[:, :, power - 1] * s[:, None]
    partials[:, 0, 5], partials[:, 1, 5] = s + 2.0 * x * x, product
    partials[:, 0, 6], partials[:, 1, 6] = product, s + 2.0 * y * y
    partials[:, 0, 7], partials[:, 0, 8] = x, y
    return partials


def corrected_by_coefficients(
    coefficients: Sequence[float] | Sequence[FloatArray], x: FloatArray, y: FloatArray
) -> FloatArray:
    """Return the partials (n, 2, 9) of `corrected_with_partials` by the coefficients."""
    freed = x - coefficients[7] * x - coefficients[8] * y
    _, _, xx, _, yx, _ = lens_distortion_with_partials(coefficients, freed, y)
    partials = -distorted_by_coefficients(freed, y)
    # what the affinity takes off x changes the argument of the polynomial as well
    by_freed = np.stack([1.0 - xx, -yx], axis=1)
    partials[:, :, 7], partials[:, :, 8] = -by_freed * x[:, None], -by_freed * y[:, None]
    return partials


def inverse(
    function: Callable[[Number, Number], Mapped[Number]], u: Number, v: Number
) -> tuple[Number, Number, bool | BoolArray]:
    """Return x and y that a function maps to u and v, by Newton's method, and whether they were found.

    A point at which the function mirrors the plane is not found: it has folded over before. Arrays may overflow where
    there is nothing to find; callers silence numpy.

    Parameters
    ----------
    function : callable
        Maps a point to a place not far from it.
    u, v : floats, or arrays (n,)
        mm.
    """
    x, y = u, v
    for _ in range(_NEWTON_STEPS):
        fu, fv, xx, xy, yx, yy = function(x, y)
        # a floor keeps plain numbers from dividing by zero; such a step finds nothing
        du, dv, determinant = fu - u, fv - v, xx * yy - xy * yx + 1e-300
        misfit = abs(du) + abs(dv)
        if not _any_above(misfit, _STEP_ENOUGH_MM):
            break
        x, y = x - (yy * du - xy * dv) / determinant, y - (xx * dv - yx * du) / determinant
    return x, y, (misfit < _FOUND_MM) & (determinant > 0.0)


def remove_distortion(xy: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return the ideal coordinates whose distorted ones (polynomial at "ideal") are the given ones.

    Parameters
    ----------
    xy : array (n, 2)
        Measured coordinates reduced to the principal point, mm.
    coefficients : array (n, 9) or (9,)
        A1, A3, A5, A7, A9, P1, P2, B1, B2.

    Returns
    -------
    array (n, 2)
        NaN where there is none: the polynomial is not monotone up to there.
    """
    of_points = tuple(np.broadcast_to(coefficients, (len(xy), 9)).T)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # one point may run away
        x, y, found = inverse(lambda x, y: distorted_with_partials(of_points, x, y), *np.ascontiguousarray(xy.T))
        ideal = np.stack([x, y], axis=1)
        # an image mirrored at the centre would be shown twice
        found &= np.sum(ideal * xy, axis=1) >= 0.0
    ideal[~found] = np.nan
    return ideal


def _any_above(values: float | FloatArray, limit: float) -> bool:
    """Tell whether any value is above; NaN is not, so that a point that has run away does not delay the others."""
    return values > limit if isinstance(values, float) else bool(np.any(values > limit))


# Neither form has the term of A9: of what is taken to a polynomial it is 0.

_POWERS = np.array([1, 3, 5, 7, 9])
_FITTED = 4
"""Terms that are fitted to a curve: A1, A3, A5, A7."""

_REAL = 1e-6
"""A double root comes out of an eigenvalue problem with an imaginary part of the root of the machine's precision."""


def polynomial_from_isp(parameters: Sequence[float]) -> FloatArray:
    """Return A1, A3, A5, A7, A9 of D = R (a1 (R² - R0²) + a2 (R⁴ - R0⁴) + a3 (R⁶ - R0⁶)).

    Parameters
    ----------
    parameters : (R0, a1, a2, a3)
        Form of the ISP regulations; R0 in mm.

    Returns
    -------
    array (5,)
    """
    r0, a1, a2, a3 = parameters
    square = r0 * r0
    return np.array([-(a1 * square + a2 * square**2 + a3 * square**3), a1, a2, a3, 0.0])


def isp_from_polynomial(coefficients: Sequence[float]) -> tuple[float, float, float, float]:
    """Return (R0, a1, a2, a3) of the ISP form of a polynomial; R0 is the least radius at which it has no distortion.

    Parameters
    ----------
    coefficients : (A1, A3, A5, A7, A9)

    Raises
    ------
    ValueError
        If A9 is not 0, or the distortion vanishes nowhere but at the centre: the ISP form has no such curve, unless
        A1 is 0 and with it R0.
    """
    a1, a3, a5, a7, a9 = (float(value) for value in coefficients)
    if a9 != 0.0:
        message = "the ISP form (R0, a1, a2, a3) has no term of A9"
        raise ValueError(message)
    if a1 == 0.0:
        return 0.0, a3, a5, a7
    # A1 + A3 s + A5 s² + A7 s³ = 0 with s = R²; scaled so that coefficients of such different size do no harm
    size = max(abs(value / a1) ** (1.0 / power) for power, value in ((1, a3), (2, a5), (3, a7)))
    if size == 0.0:
        message = "a distortion of A1 alone grows with the radius and has no ISP form; give C its scale instead"
        raise ValueError(message)
    roots = np.roots([a7 / a1 / size**3, a5 / a1 / size**2, a3 / a1 / size, 1.0])
    real = roots.real[(np.abs(roots.imag) <= _REAL * np.abs(roots)) & (roots.real > 0.0)]
    if not real.size:
        message = "the distortion is zero at no radius, and the ISP form (R0, a1, a2, a3) needs one"
        raise ValueError(message)
    return float(np.sqrt(real.min() / size)), a3, a5, a7


def curve_from_polynomial(coefficients: Sequence[float], radii: FloatArray) -> FloatArray:
    """Return the distortion (mm), array (n,), of (A1, A3, A5, A7, A9) at radii (n,) in mm."""
    return np.asarray(radii[:, None] ** _POWERS @ np.asarray(coefficients, dtype=np.float64))


def polynomial_from_curve(points: Sequence[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
    """Fit A1, A3, A5, A7 to points of the distortion curve by least squares with unit weights.

    Parameters
    ----------
    points : sequence of (radius, distortion)
        mm; at least 4 different radii greater than zero.

    Returns
    -------
    coefficients : array (5,)
        A1, A3, A5, A7, and 0 for A9.
    residuals : array (n,)
        Fitted minus given distortion, mm.

    Raises
    ------
    ValueError
        With fewer than 4 different radii.
    """
    radius, distortion = np.array(points, dtype=np.float64).reshape(-1, 2).T
    used = radius > 0.0
    if len(np.unique(radius[used])) < 4:
        message = f"{len(np.unique(radius[used]))} different radii greater than zero, 4 are needed"
        raise ValueError(message)
    largest = radius.max()
    # powers of R / Rmax keep the columns of one size; R⁷ in mm would span ten decades
    exponents = _POWERS[:_FITTED]
    powers = (radius[:, None] / largest) ** exponents
    scaled, *_ = np.linalg.lstsq(powers[used], distortion[used], rcond=None)
    return np.append(scaled / largest**exponents, 0.0), powers @ scaled - distortion


# It follows from the sets of `orip.interior.additional_parameters`, which have the partials by the parameters.

Factors = tuple[tuple[float, ...], ...]
"""Factors (m, m) of x^i y^j."""


class ImagePolynomial(NamedTuple):
    """The deformation dx, dy (mm) and its derivatives by x and y, in coordinates divided by `unit` (mm)."""

    unit: float
    dx: Factors
    dy: Factors
    dx_by_x: Factors
    dx_by_y: Factors
    dy_by_x: Factors
    dy_by_y: Factors


def image_polynomial(name: AdditionalSet, base_mm: float, values: FloatArray) -> ImagePolynomial:
    """Return the polynomials of a parameter set with its values (k,) for a base."""
    powers = basis_by_powers(name, base_mm)
    # factors are of B_i(y) A_j(x)
    by_product = np.einsum("k,ckij->cij", values, PARAMETER_SETS[name].factors)
    dx, dy = np.einsum("pj,cij,qi->cpq", powers, by_product, powers)
    degrees = np.arange(1.0, len(powers)) / base_mm
    parts = dx, dy, degrees[:, None] * dx[1:], dx[:, 1:] * degrees, degrees[:, None] * dy[1:], dy[:, 1:] * degrees
    return ImagePolynomial(base_mm, *(tuple(map(tuple, part.tolist())) for part in parts))


def deformation_with_partials(polynomial: ImagePolynomial, xf: Number, yf: Number) -> Mapped[Number]:
    """Return dx and dy (mm) at photo coordinates of the fiducial system."""
    x, y = xf / polynomial.unit, yf / polynomial.unit
    _, dx, dy, dx_by_x, dx_by_y, dy_by_x, dy_by_y = polynomial
    return (
        _horner(dx, x, y), _horner(dy, x, y),
        _horner(dx_by_x, x, y), _horner(dx_by_y, x, y), _horner(dy_by_x, x, y), _horner(dy_by_y, x, y),
    )  # fmt: skip


def _horner(factors: Factors, x: Number, y: Number) -> Number:
    total = 0.0 * x
    for row in reversed(factors):
        of_y = 0.0 * y
        for factor in reversed(row):
            of_y = of_y * y + factor
        total = total * x + of_y
    return total
