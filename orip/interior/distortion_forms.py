"""Other forms of giving a radial distortion, taken to the polynomial D = A1 R + A3 R³ + A5 R⁵ + A7 R⁷ + A9 R⁹ and back.

Neither form has the term of A9: of what is taken to a polynomial it is 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import FloatArray

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
