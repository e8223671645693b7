"""The camera model's distortion: radial (A1, A3, A5, A7), tangential (P1, P2) and affine (B1, B2).

Coordinates are millimetres reduced to the principal point; r is their radius:

    dx = x (A1 + A3 r² + A5 r⁴ + A7 r⁶) + P1 (r² + 2 x²) + 2 P2 x y + B1 x + B2 y
    dy = y (A1 + A3 r² + A5 r⁴ + A7 r⁶) + P2 (r² + 2 y²) + 2 P1 x y

With the argument "ideal" the measured coordinates are the ideal ones plus (dx, dy); with "measured" the ideal ones are
the measured ones, first freed of the affinity, minus (dx, dy) without its B terms.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray

DISTORTION_PARAMETERS = ("A1", "A3", "A5", "A7", "P1", "P2", "B1", "B2")
_NEWTON_STEPS = 20
_NEWTON_TOLERANCE_MM = 1e-12
_FOUND_MM = 1e-9
"""A thousandth of a thousandth of what can be measured; rounding may keep Newton's steps above their tolerance."""


class Distorted(NamedTuple):
    """A value (n, 2) in mm with its partials by the coordinates (n, 2, 2) and by the 8 coefficients (n, 2, 8)."""

    value: FloatArray
    by_xy: FloatArray
    by_coefficients: FloatArray


def distortion_with_partials(xy: FloatArray, coefficients: FloatArray) -> Distorted:
    """Return (dx, dy) at the coordinates.

    Parameters
    ----------
    xy : array (n, 2)
        Reduced to the principal point, mm.
    coefficients : array (n, 8) or (8,)
        In the order of `DISTORTION_PARAMETERS`.

    Returns
    -------
    Distorted
    """
    a1, a3, a5, a7, p1, p2, b1, b2 = np.broadcast_to(coefficients, (len(xy), 8)).T
    x, y = xy.T
    s = x * x + y * y
    radial = a1 + s * (a3 + s * (a5 + s * a7))
    radial_by_s = a3 + s * (2.0 * a5 + s * 3.0 * a7)
    dx = x * radial + p1 * (s + 2.0 * x * x) + 2.0 * p2 * x * y + b1 * x + b2 * y
    dy = y * radial + p2 * (s + 2.0 * y * y) + 2.0 * p1 * x * y

    by_xy = np.empty((len(xy), 2, 2))
    by_xy[:, 0, 0] = radial + 2.0 * x * x * radial_by_s + 6.0 * p1 * x + 2.0 * p2 * y + b1
    by_xy[:, 0, 1] = 2.0 * x * y * radial_by_s + 2.0 * p1 * y + 2.0 * p2 * x + b2
    by_xy[:, 1, 0] = 2.0 * x * y * radial_by_s + 2.0 * p2 * x + 2.0 * p1 * y
    by_xy[:, 1, 1] = radial + 2.0 * y * y * radial_by_s + 6.0 * p2 * y + 2.0 * p1 * x

    by_coefficients = np.zeros((len(xy), 2, 8))
    by_coefficients[:, :, 0] = xy
    for power in (1, 2, 3):
        by_coefficients[:, :, power] = xy * (s**power)[:, None]
    by_coefficients[:, 0, 4] = s + 2.0 * x * x
    by_coefficients[:, 1, 4] = by_coefficients[:, 0, 5] = 2.0 * x * y
    by_coefficients[:, 1, 5] = s + 2.0 * y * y
    by_coefficients[:, 0, 6] = x
    by_coefficients[:, 0, 7] = y
    return Distorted(np.stack([dx, dy], axis=1), by_xy, by_coefficients)


def correction_with_partials(xy: FloatArray, coefficients: FloatArray) -> Distorted:
    """Return the corrected coordinates of measured ones, for a polynomial given at "measured" coordinates.

    The affinity comes first: x' = x - B1 x - B2 y, y' = y; then (x', y') minus (dx, dy)(x', y') without the B terms.

    Parameters
    ----------
    xy : array (n, 2)
        Measured coordinates reduced to the principal point, mm.
    coefficients : array (n, 8) or (8,)

    Returns
    -------
    Distorted
        Value: the corrected coordinates.
    """
    coefficients = np.broadcast_to(coefficients, (len(xy), 8))
    b1, b2 = coefficients[:, 6], coefficients[:, 7]
    freed = xy.copy()
    freed[:, 0] -= b1 * xy[:, 0] + b2 * xy[:, 1]
    without_affinity = coefficients.copy()
    without_affinity[:, 6:] = 0.0
    polynomial = distortion_with_partials(freed, without_affinity)

    by_freed = np.eye(2) - polynomial.by_xy
    by_xy = by_freed.copy()
    by_xy[:, :, 0] = by_freed[:, :, 0] * (1.0 - b1)[:, None]
    by_xy[:, :, 1] = by_freed[:, :, 1] - by_freed[:, :, 0] * b2[:, None]
    by_coefficients = -polynomial.by_coefficients
    by_coefficients[:, :, 6] = -by_freed[:, :, 0] * xy[:, 0, None]
    by_coefficients[:, :, 7] = -by_freed[:, :, 0] * xy[:, 1, None]
    return Distorted(freed - polynomial.value, by_xy, by_coefficients)


def remove_distortion(xy: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return the ideal coordinates whose distorted ones (polynomial at "ideal") are the given ones.

    Parameters
    ----------
    xy : array (n, 2)
        Measured coordinates reduced to the principal point, mm.
    coefficients : array (n, 8) or (8,)

    Returns
    -------
    array (n, 2)
        NaN where there is none: the polynomial is not monotone up to there.
    """
    ideal = xy.copy()
    misfit, by_ideal = np.zeros_like(xy), np.broadcast_to(np.eye(2), (len(xy), 2, 2))
    # a point that runs away must not stop the others, nor warn
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        for _ in range(_NEWTON_STEPS):
            distorted = distortion_with_partials(ideal, coefficients)
            misfit, by_ideal = ideal + distorted.value - xy, np.eye(2) + distorted.by_xy
            if not (np.abs(misfit) >= _NEWTON_TOLERANCE_MM).any():
                break
            ideal = ideal - _solve_2x2(by_ideal, misfit)
        found = np.abs(misfit).max(axis=1, initial=0.0) < _FOUND_MM
        # beyond the maximum of the polynomial, or mirrored at the centre, an image would be shown twice
        found &= (_determinant(by_ideal) > 0.0) & (np.sum(ideal * xy, axis=1) >= 0.0)
    ideal[~found] = np.nan
    return ideal


def _determinant(matrix: FloatArray) -> FloatArray:
    return np.asarray(matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0])


def _solve_2x2(matrix: FloatArray, right: FloatArray) -> FloatArray:
    determinant = _determinant(matrix)
    x = (matrix[:, 1, 1] * right[:, 0] - matrix[:, 0, 1] * right[:, 1]) / determinant
    y = (matrix[:, 0, 0] * right[:, 1] - matrix[:, 1, 0] * right[:, 0]) / determinant
    return np.stack([x, y], axis=1)
