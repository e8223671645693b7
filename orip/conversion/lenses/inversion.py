"""The other direction of a camera's formula, by Newton's method with partials by a complex step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from orip.arrays import FloatArray

STEP = 1e-30
"""f(x + ih) has the imaginary part h f'(x), to all digits (Squire and Trapp, SIAM Review 1998)."""

_ITERATIONS = 50
_ENOUGH = 1e-13
"""Of the largest value."""

_FOUND = 1e-10
"""Of the largest value: a millionth of a pixel."""

Map = Callable[[Any, Any], tuple[Any, Any]]


def inverse_of(function: Map, image: FloatArray, start: FloatArray) -> FloatArray:
    """Return the places (n, 2) that a function of the plane takes to given ones.

    Parameters
    ----------
    function : callable
        From x and y, arrays (n,), to two arrays (n,); analytic.
    image : array (n, 2)
    start : array (n, 2)
        Approximations.

    Returns
    -------
    array (n, 2)
        NaN where there is none, or where the function mirrors the plane.
    """
    place = start.astype(np.float64)
    largest = max(float(np.abs(image).max(initial=0.0)), 1e-300)
    with np.errstate(all="ignore"):  # single points may run away
        for _ in range(_ITERATIONS):
            misfit, partials = _misfit(function, place, image)
            if not np.any(np.abs(misfit) > _ENOUGH * largest):
                break
            place = place - _solved(partials, misfit)
        misfit, partials = _misfit(function, place, image)
        found = np.all(np.abs(misfit) <= _FOUND * largest, axis=1) & (np.linalg.det(partials) > 0.0)
    place[~found] = np.nan
    return place


def _misfit(function: Map, place: FloatArray, image: FloatArray) -> tuple[FloatArray, FloatArray]:
    by_x = np.stack(function(place[:, 0] + 1j * STEP, place[:, 1] + 0j), axis=1)
    by_y = np.stack(function(place[:, 0] + 0j, place[:, 1] + 1j * STEP), axis=1)
    return by_x.real - image, np.stack([by_x.imag, by_y.imag], axis=2) / STEP


def _solved(partials: FloatArray, misfit: FloatArray) -> FloatArray:
    (a, b), (c, d) = partials.transpose(1, 2, 0)
    determinant = a * d - b * c
    u, v = misfit.T
    return np.stack([(d * u - b * v) / determinant, (a * v - c * u) / determinant], axis=1)
