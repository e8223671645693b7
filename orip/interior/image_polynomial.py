"""A set of additional parameters with its values as polynomials in x and y: the form for the real-time loop.

It follows from the sets of `orip.interior.additional_parameters`, which have the partials by the parameters.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray, Number
from orip.interior.additional_parameters import PARAMETER_SETS, basis_by_powers
from orip.interior.distortion import Mapped
from orip.records.project.camera import AdditionalSet

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
