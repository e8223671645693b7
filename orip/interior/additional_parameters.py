"""Additional parameters of self-calibration: Ebner's 12 and Gruen's 44.

Both sets take up image deformation that the points of a regular grid in the photo can show and that the orientation
cannot absorb: two shifts, rotation, scale and the two tilts are left out. On its grid each term is orthogonal to every
other and to these six. With x, y in mm from the fiducial centre and the base b (mm), all terms are products of a
polynomial B_i(y) and a polynomial A_j(x).

Ebner, 3 x 3 points at x, y = -b, 0, b, with k = x² - 2b²/3 and l = y² - 2b²/3:

    dx =  b1 x + b2 y - 2 b3 k + b4 x y + b5 l        + b7 x l        + b9 y k         + b11 k l
    dy = -b1 y + b2 x + b3 x y - 2 b4 l        + b6 k         + b8 y k        + b10 x l         + b12 k l

Gruen, 5 x 5 points at x, y = -b, -b/2, 0, b/2, b:

    A_1..5(x) = 1, x, k, p, r                           B_1..5(y) = 1, y, l, q, s
    k = x² - b²/2                                       l, q, s: the same of y
    p = x³ - 17/20 b² x
    r = x⁴ - 31/28 b² x² + 9/70 b⁴

    dx =  a12 x + a21 y + a22 x y - 10/7 b22 k + a31 l           + sum of a_ij B_i(y) A_j(x)
    dy = -a12 y + a21 x - 10/7 a22 l + b22 x y           + b13 k + sum of b_ij B_i(y) A_j(x)

with each sum over the 19 pairs i, j = 1..5 with i + j >= 5. The first index counts in y and the second in x, in the
low terms too: a31 belongs to B_3 A_1 = l, b13 to B_1 A_3 = k.

Sources: H. Ebner, Self calibrating block adjustment, ISP Congress, Helsinki 1976. Gruen's set of 1978 is written here
from its construction: complete and orthogonal on the 5 x 5 points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.records.camera import AdditionalSet, Camera

Term = tuple[int, int, float]
"""i, j and factor of a product B_i(y) A_j(x), counted from 1."""

_BASE_OF_FRAME = 0.4
_DEFAULT_REACH = 10.0


class Additional(NamedTuple):
    """A value (n, 2) in mm with its partials by the coordinates (n, 2, 2) and by the k parameters (n, 2, k)."""

    value: FloatArray
    by_xy: FloatArray
    by_values: FloatArray


class Basis(NamedTuple):
    """The m polynomials in one coordinate at n points and their derivatives by it, each (n, m)."""

    value: FloatArray
    derivative: FloatArray


class ParameterSet(Struct, frozen=True):
    """One set of additional parameters.

    Parameters
    ----------
    name : {"EBNER", "GRUEN"}
    parameter_names : tuple of k str
        As unknowns are named, `EBNER.1`; the order of every array of values.
    grid : tuple of float
        The coordinates of the grid of definition along an axis, in units of the base.
    basis : callable
        (coordinates (n,) mm, bases (n,) mm) -> Basis; the A_j of x, and the B_i of y.
    factors : array (2, k, m, m)
        Factor of B_i(y) A_j(x) in dx and dy of each parameter.
    """

    name: AdditionalSet
    parameter_names: tuple[str, ...]
    grid: tuple[float, ...]
    basis: Callable[[FloatArray, FloatArray], Basis]
    factors: FloatArray


def additional_with_partials(
    set_name: AdditionalSet, xy: FloatArray, base_mm: float | FloatArray, values: FloatArray
) -> Additional:
    """Return the image deformation (dx, dy) at the coordinates.

    Parameters
    ----------
    set_name : {"EBNER", "GRUEN"}
    xy : array (n, 2)
        Relative to the fiducial centre, mm.
    base_mm : float or array (n,)
        The base b, see `base_of_frame`.
    values : array (n, k) or (k,)
        In the order of the set's `parameter_names`; 1/mm to the power that makes dx, dy millimetres.
    """
    factors = PARAMETER_SETS[set_name].factors
    basis = PARAMETER_SETS[set_name].basis
    n, k, m = len(xy), factors.shape[1], factors.shape[2]
    values = np.broadcast_to(values, (n, k))
    bases = np.broadcast_to(np.asarray(base_mm, dtype=np.float64), (n,))
    of_x = basis(xy[:, 0], bases)
    of_y = basis(xy[:, 1], bases)

    by_values = (_products(of_y.value, of_x.value) @ factors.reshape(2 * k, m * m).T).reshape(n, 2, k)
    product_factors = np.stack([values @ component.reshape(k, m * m) for component in factors], axis=1)
    by_x = np.einsum("ncp,np->nc", product_factors, _products(of_y.value, of_x.derivative))
    by_y = np.einsum("ncp,np->nc", product_factors, _products(of_y.derivative, of_x.value))
    return Additional(np.einsum("nck,nk->nc", by_values, values), np.stack([by_x, by_y], axis=2), by_values)


def basis_by_powers(set_name: AdditionalSet, base_mm: float) -> FloatArray:
    """Return the factors (m, m) of (t / b)^i, i = 0 .. m - 1, in each polynomial of a set (columns) for a base b (mm).

    The polynomials are of degree m - 1 at most, so that m places determine them.
    """
    parameter_set = PARAMETER_SETS[set_name]
    size = parameter_set.factors.shape[2]
    nodes = np.linspace(-1.0, 1.0, size)
    at_nodes = parameter_set.basis(base_mm * nodes, np.full(size, base_mm)).value
    return np.asarray(np.linalg.solve(np.vander(nodes, increasing=True), at_nodes), dtype=np.float64)


def base_of_frame(frame_x: float, frame_y: float) -> float:
    """Return the base b for a frame of this size, in its unit: 0.4 of the shorter side.

    The grid, from -b to b, then lies where points of a block are measured.
    """
    return _BASE_OF_FRAME * min(frame_x, frame_y)


def base_of_camera(camera: Camera) -> float:
    """Return the base (mm) of a camera's parameter set, from its frame or sensor; 0 where it has neither."""
    if camera.frame is not None:
        return base_of_frame(*camera.frame)
    return base_of_frame(camera.sensor.width, camera.sensor.height) if camera.sensor is not None else 0.0


def default_error(set_name: AdditionalSet, index: int, base_mm: float, photo_error_mm: float) -> float:
    """Return the a-priori error with which a parameter is observed as zero.

    A parameter as large as this error makes the larger of |dx| and |dy| ten times the a-priori error of a photo
    coordinate at (b, b), the corner of the grid. No term of either set vanishes there. Those with r or s are small in
    the corner, r(b) = 3/140 b⁴ against 9/70 b⁴ in the centre, so that their errors are the more generous.

    Parameters
    ----------
    set_name : {"EBNER", "GRUEN"}
    index : int
        Of the parameter in the set's `parameter_names`.

    Returns
    -------
    float
        In the unit of the parameter.
    """
    none = np.zeros(len(PARAMETER_SETS[set_name].parameter_names))
    by_values = additional_with_partials(set_name, np.full((1, 2), base_mm), base_mm, none).by_values
    return float(_DEFAULT_REACH * photo_error_mm / np.abs(by_values[0, :, index]).max())


def _products(of_y: FloatArray, of_x: FloatArray) -> FloatArray:
    """Return B_i(y) A_j(x), (n, m * m), j running fastest."""
    return (of_y[:, :, None] * of_x[:, None, :]).reshape(len(of_x), of_x.shape[1] * of_y.shape[1])


def _ebner_basis(t: FloatArray, b: FloatArray) -> Basis:
    one, zero = np.ones_like(t), np.zeros_like(t)
    return Basis(
        np.stack([one, t, t * t - 2.0 / 3.0 * b * b], axis=1),
        np.stack([zero, one, 2.0 * t], axis=1),
    )


def _gruen_basis(t: FloatArray, b: FloatArray) -> Basis:
    one, zero = np.ones_like(t), np.zeros_like(t)
    tt, bb = t * t, b * b
    third = t * (tt - 17.0 / 20.0 * bb)
    fourth = tt * (tt - 31.0 / 28.0 * bb) + 9.0 / 70.0 * bb * bb
    return Basis(
        np.stack([one, t, tt - 0.5 * bb, third, fourth], axis=1),
        np.stack([zero, one, 2.0 * t, 3.0 * tt - 17.0 / 20.0 * bb, t * (4.0 * tt - 31.0 / 14.0 * bb)], axis=1),
    )


def _ebner_terms() -> dict[str, tuple[Term | None, Term | None]]:
    """Return the term in dx and in dy of each parameter."""
    return {
        "EBNER.1": ((1, 2, 1.0), (2, 1, -1.0)),
        "EBNER.2": ((2, 1, 1.0), (1, 2, 1.0)),
        "EBNER.3": ((1, 3, -2.0), (2, 2, 1.0)),
        "EBNER.4": ((2, 2, 1.0), (3, 1, -2.0)),
        "EBNER.5": ((3, 1, 1.0), None),
        "EBNER.6": (None, (1, 3, 1.0)),
        "EBNER.7": ((3, 2, 1.0), None),
        "EBNER.8": (None, (2, 3, 1.0)),
        "EBNER.9": ((2, 3, 1.0), None),
        "EBNER.10": (None, (3, 2, 1.0)),
        "EBNER.11": ((3, 3, 1.0), None),
        "EBNER.12": (None, (3, 3, 1.0)),
    }


def _gruen_terms() -> dict[str, tuple[Term | None, Term | None]]:
    """Return the term in dx and in dy of each parameter; the pairs i, j by rising i + j, then by i."""
    pairs = [(i, total - i) for total in range(5, 11) for i in range(1, 6) if 1 <= total - i <= 5]
    return {
        "GRUEN.A12": ((1, 2, 1.0), (2, 1, -1.0)),
        "GRUEN.A21": ((2, 1, 1.0), (1, 2, 1.0)),
        "GRUEN.A22": ((2, 2, 1.0), (3, 1, -10.0 / 7.0)),
        "GRUEN.B22": ((1, 3, -10.0 / 7.0), (2, 2, 1.0)),
        "GRUEN.A31": ((3, 1, 1.0), None),
        "GRUEN.B13": (None, (1, 3, 1.0)),
        **{f"GRUEN.A{i}{j}": ((i, j, 1.0), None) for i, j in pairs},
        **{f"GRUEN.B{i}{j}": (None, (i, j, 1.0)) for i, j in pairs},
    }


def _factors(terms: Mapping[str, tuple[Term | None, Term | None]], m: int) -> FloatArray:
    factors = np.zeros((2, len(terms), m, m))
    for parameter, of_components in enumerate(terms.values()):
        for component, term in enumerate(of_components):
            if term is not None:
                i, j, factor = term
                factors[component, parameter, i - 1, j - 1] = factor
    factors.flags.writeable = False
    return factors


PARAMETER_SETS: Mapping[AdditionalSet, ParameterSet] = MappingProxyType(
    {
        "EBNER": ParameterSet(
            name="EBNER",
            parameter_names=tuple(_ebner_terms()),
            grid=(-1.0, 0.0, 1.0),
            basis=_ebner_basis,
            factors=_factors(_ebner_terms(), 3),
        ),
        "GRUEN": ParameterSet(
            name="GRUEN",
            parameter_names=tuple(_gruen_terms()),
            grid=(-1.0, -0.5, 0.0, 0.5, 1.0),
            basis=_gruen_basis,
            factors=_factors(_gruen_terms(), 5),
        ),
    }
)
"""The sets by name."""
