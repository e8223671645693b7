"""The essential matrices of five points in two photos, and the poses that follow from one."""

from __future__ import annotations

from itertools import combinations_with_replacement, product

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.stereo import TwoPhotos

_NEARLY_REAL = 0.1
"""Largest relative imaginary part of a solution whose real part is used: measuring errors turn two solutions that are
close to each other into a complex pair."""


_GENERAL = np.array(
    [
        [0.59, 0.38, -0.52, 0.49],
        [-0.44, 0.73, 0.47, 0.24],
        [-0.33, 0.49, -0.63, -0.51],
        [-0.59, -0.29, -0.33, 0.67],
    ]
)
"""Any regular matrix: in a special null space (exact normal case) the last matrix alone may contribute nothing to E."""


_VARIABLES = "xyz1"


_CUBIC = ["xxx", "xxy", "xxz", "xyy", "xyz", "xzz", "yyy", "yyz", "yzz", "zzz"]


_LOWER = ["xx1", "xy1", "xz1", "yy1", "yz1", "zz1", "x11", "y11", "z11", "111"]


def _monomial(factors: tuple[str, ...]) -> str:
    return "".join(sorted(factors, key=_VARIABLES.index))


def _collecting() -> FloatArray:
    """Return the matrix (64, 20) that adds products of three variables up to coefficients of monomials."""
    monomials = _CUBIC + _LOWER
    assert set(monomials) == {_monomial(factors) for factors in combinations_with_replacement(_VARIABLES, 3)}
    result = np.zeros((64, 20))
    for row, factors in enumerate(product(_VARIABLES, repeat=3)):
        result[row, monomials.index(_monomial(factors))] = 1.0
    return result


_COLLECT = _collecting()


_TIMES_X = [_monomial(("x", *monomial.replace("1", "", 1))) for monomial in _LOWER]


def essential_matrices(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the essential matrices on which samples of five points lie.

    Parameters
    ----------
    left, right : arrays (s, 5, 3)
        Image vectors of s samples.

    Returns
    -------
    array (m, 3, 3)
        The solutions of all samples, up to ten for each, with norm 1. A pair of complex solutions that are nearly real
        is represented by its real part, which is only approximately essential. Where five points admit a curve of
        solutions (a repeated point, no base), some of them are returned, or none.

    Notes
    -----
    Nistér (2004) for the ten cubic equations det E = 0 and 2 E E^T E - tr(E E^T) E = 0; Stewénius, Engels and Nistér
    (2006) for their solution from the eigenvectors of the multiplication by x.
    """
    null_space = _null_space(_unit(left), _unit(right))
    equations = _cubic_equations(null_space)
    leading, lower = equations[:, :, :10], equations[:, :, 10:]
    solvable = np.linalg.det(leading) != 0.0
    null_space = null_space[solvable]
    reduced = -np.linalg.solve(leading[solvable], lower[solvable])
    multiplication = np.zeros_like(reduced)
    for row, monomial in enumerate(_TIMES_X):
        if monomial in _CUBIC:
            multiplication[:, row] = reduced[:, _CUBIC.index(monomial)]
        else:
            multiplication[:, row, _LOWER.index(monomial)] = 1.0
    eigenvalues, columns = np.linalg.eig(multiplication)
    eigenvectors = np.swapaxes(columns, 1, 2)
    last = eigenvectors[:, :, 9:]
    coefficients = eigenvectors[:, :, 6:] / np.where(last == 0.0, 1e-300, last)
    size = np.abs(coefficients).max(axis=2)
    # of a pair the one above the real axis
    real = (np.abs(coefficients.imag).max(axis=2) < _NEARLY_REAL * size) & (eigenvalues.imag >= 0.0) & np.isfinite(size)
    sample, solution = np.nonzero(real)
    found = np.einsum("mk,mkij->mij", coefficients[sample, solution].real, null_space[sample])
    return np.asarray(found / np.linalg.norm(found, axis=(1, 2), keepdims=True))


def two_photos_of(essential: FloatArray) -> TwoPhotos:
    """Return the four pairs of base and rotation of essential matrices.

    Parameters
    ----------
    essential : array (..., 3, 3)

    Returns
    -------
    TwoPhotos
        Of shape (..., 4, 3) and (..., 4, 3, 3): both signs of the base with each of the two rotations. The rotations
        are orthogonal even where the matrix is only approximately essential.

    Notes
    -----
    Hartley and Zisserman (2004), result 9.19.
    """
    u, _, vt = np.linalg.svd(essential)
    # determinants of 1; the sign of E itself means nothing
    u = u * np.linalg.det(u)[..., None, None]
    vt = vt * np.linalg.det(vt)[..., None, None]
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    one, other = u @ quarter @ vt, u @ quarter.T @ vt
    base = u[..., :, 2]
    return TwoPhotos(np.stack([base, -base, base, -base], axis=-2), np.stack([one, one, other, other], axis=-3))


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _null_space(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return four matrices (s, 4, 3, 3) whose sums are all E with left^T E right = 0 for five points."""
    rows = (left[..., :, None] * right[..., None, :]).reshape(-1, 5, 9)
    orthogonal = np.linalg.qr(np.swapaxes(rows, 1, 2), mode="complete")[0]
    return np.asarray(_GENERAL @ np.swapaxes(orthogonal[:, :, 5:], 1, 2)).reshape(-1, 4, 3, 3)


def _cubic_equations(null_space: FloatArray) -> FloatArray:
    """Return the coefficients (s, 10, 20) of the constraints on E = x E1 + y E2 + z E3 + E4.

    Products of sums are expanded over the four matrices of each factor (a, b, c) and collected by monomials.
    """
    count = len(null_space)
    flat = null_space.reshape(count, 12, 3)
    squares = (flat @ np.swapaxes(flat, 1, 2)).reshape(count, 4, 3, 4, 3)
    traces = np.trace(squares, axis1=2, axis2=4)
    factor = 2.0 * squares - traces[:, :, None, :, None] * np.eye(3)[:, None, :]
    last = np.swapaxes(null_space, 1, 2).reshape(count, 3, 12)
    cubic = (factor.reshape(count, 48, 3) @ last).reshape(count, 4, 3, 4, 4, 3)
    rows = np.cross(null_space[:, :, None, 0], null_space[:, None, :, 1]).reshape(count, 16, 3)
    determinant = rows @ np.swapaxes(null_space[:, :, 2], 1, 2)
    products = np.empty((count, 10, 64))
    products[:, 0] = determinant.reshape(count, 64)
    products[:, 1:] = cubic.transpose(0, 2, 5, 1, 3, 4).reshape(count, 9, 64)
    return np.asarray(products @ _COLLECT)
