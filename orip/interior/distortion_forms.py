"""Other forms of giving a radial distortion, taken to the polynomial D = A1 R + A3 R³ + A5 R⁵ + A7 R⁷."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def polynomial_from_isp(parameters: Sequence[float]) -> FloatArray:
    """Return A1, A3, A5, A7 of D = R (a1 (R² - R0²) + a2 (R⁴ - R0⁴) + a3 (R⁶ - R0⁶)).

    Parameters
    ----------
    parameters : (R0, a1, a2, a3)
        Form of the ISP regulations; R0 in mm.

    Returns
    -------
    array (4,)
    """
    r0, a1, a2, a3 = parameters
    square = r0 * r0
    return np.array([-(a1 * square + a2 * square**2 + a3 * square**3), a1, a2, a3])


def polynomial_from_curve(points: Sequence[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
    """Fit A1, A3, A5, A7 to points of the distortion curve by least squares with unit weights.

    Parameters
    ----------
    points : sequence of (radius, distortion)
        mm; at least 4 different radii greater than zero.

    Returns
    -------
    coefficients : array (4,)
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
    powers = (radius[:, None] / largest) ** np.array([1, 3, 5, 7])
    scaled, *_ = np.linalg.lstsq(powers[used], distortion[used], rcond=None)
    return scaled / largest ** np.array([1, 3, 5, 7]), powers @ scaled - distortion
