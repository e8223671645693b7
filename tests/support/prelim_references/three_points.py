"""Three-point space resection: every orientation from which three known points are seen in three directions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray

_PAIRS = np.array([[0, 1], [0, 2], [1, 2]])

_FLAT = 1e-6
"""Height of a triangle, as part of its longest side, below which its points lie on one line and fix no rotation."""

_MIX = 0.4142
"""Turns the pencil of conics, in which a symmetric triangle would have two singular conics at zero and infinity."""

_MISCLOSURE = 1e-8
"""Largest relative misfit of the squared sides: Newton's method reaches 1e-15, or 1e-10 at a double solution, and stays
far above where there is no solution."""

_NEWTON_STEPS = 2


class ThreePointOrientations(NamedTuple):
    """Up to four orientations for each of s triples.

    Attributes
    ----------
    rotations : array (s, 4, 3, 3)
        Photo to ground.
    centres : array (s, 4, 3)
    valid : array (s, 4) of bool
        Entries that are not valid have no meaning.
    """

    rotations: FloatArray
    centres: FloatArray
    valid: BoolArray


def three_point_resection(vectors: FloatArray, points: FloatArray) -> ThreePointOrientations:
    """Return all orientations with X_i = X0 + k_i R u_i, k_i > 0, for triples of points.

    Parameters
    ----------
    vectors : array (s, 3, 3)
        Three image vectors u = (x, y, -C) of each triple.
    points : array (s, 3, 3)
        Three ground points of each triple.

    Returns
    -------
    ThreePointOrientations
        None is valid where three points lie on one line, or image points coincide.

    Notes
    -----
    The distances d_i from the projection centre fulfil d_i² + d_j² - 2 d_i d_j cos(u_i, u_j) = |X_i - X_j|² (Grunert
    1841). Two homogeneous quadratic equations follow from the three; a singular member of their pencil is a pair of
    planes, in each of which one of the equations is solved (the idea of Finsterwalder 1903 in the form of Persson and
    Nordberg 2018). All is kept homogeneous, so that no denominator can vanish.
    """
    unit = vectors / np.linalg.norm(vectors, axis=2, keepdims=True)
    first, second = _PAIRS.T
    cosines = np.einsum("spi,spi->sp", unit[:, first], unit[:, second])
    squares = np.sum((points[:, first] - points[:, second]) ** 2, axis=2)
    shape = ~(_on_one_line(unit) | _on_one_line(points))
    size = np.where(shape, squares.sum(axis=1), 1.0)
    squares = np.where(shape[:, None], squares / size[:, None], 1.0 / 3.0)
    cosines = np.where(shape[:, None], cosines, 0.5)

    distances, valid = _distances(cosines, squares)
    in_photo = distances[:, :, :, None] * np.sqrt(size)[:, None, None, None] * unit[:, None]
    rotations = _axes_of(points)[:, None] @ np.swapaxes(_axes_of(in_photo), -1, -2)
    centres = points.mean(axis=1)[:, None] - (rotations @ in_photo.mean(axis=2)[..., None])[..., 0]
    return ThreePointOrientations(rotations, centres, valid & shape[:, None])


def _on_one_line(points: FloatArray) -> BoolArray:
    """Return whether three points (s, 3, 3) lie on one line: twice the area against the square of the longest side."""
    sides = points[:, _PAIRS[:, 1]] - points[:, _PAIRS[:, 0]]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return np.asarray(~(area > _FLAT * np.sum(sides**2, axis=2).max(axis=1)))


def _axes_of(points: FloatArray) -> FloatArray:
    """Return right-handed axes (..., 3, 3), as columns, placed alike in congruent triangles (..., 3, 3)."""
    along = points[..., 1, :] - points[..., 0, :]
    normal = np.cross(along, points[..., 2, :] - points[..., 0, :])
    with np.errstate(invalid="ignore", divide="ignore"):
        along = along / np.linalg.norm(along, axis=-1, keepdims=True)
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.stack([along, np.cross(normal, along), normal], axis=-1)


def _distances(cosines: FloatArray, squares: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the distances (s, 4, 3) that fulfil Grunert's equations, and which of them do."""
    forms = _quadratic_forms(cosines)
    pencil = forms[:, :2] * squares[:, 2, None, None, None] - forms[:, 2:] * squares[:, :2, None, None]
    turned = np.stack([pencil[:, 0] + _MIX * pencil[:, 1], pencil[:, 1] - _MIX * pencil[:, 0]], axis=1)
    directions = _intersect_conics(turned)
    directions *= np.where(directions.sum(axis=2, keepdims=True) < 0.0, -1.0, 1.0)
    # the sum of the three equations, a positive form, fixes the length
    length = np.einsum("ski,sij,skj->sk", directions, forms.sum(axis=1), directions)
    distances = directions * np.sqrt(squares.sum(axis=1)[:, None] / np.maximum(length, 1e-300))[:, :, None]
    for _ in range(_NEWTON_STEPS):
        distances = distances + _newton_step(distances, cosines, squares)
    misclosure = np.abs(_misclosures(distances, cosines, squares)).max(axis=2)
    # a comparison with NaN is false
    return distances, (misclosure < _MISCLOSURE) & (distances.min(axis=2) > 0.0)


def _quadratic_forms(cosines: FloatArray) -> FloatArray:
    """Return the forms (s, 3, 3, 3) d_i² + d_j² - 2 d_i d_j cos of the three pairs."""
    result = np.zeros((len(cosines), 3, 3, 3))
    for pair, (i, j) in enumerate(_PAIRS):
        result[:, pair, i, i] = result[:, pair, j, j] = 1.0
        result[:, pair, i, j] = result[:, pair, j, i] = -cosines[:, pair]
    return result


def _intersect_conics(pencil: FloatArray) -> FloatArray:
    """Return four directions (s, 4, 3) in which both forms (s, 2, 3, 3) vanish, if they are real."""
    coefficients = _determinant_of_pencil(pencil)
    turn = np.abs(coefficients[:, 3]) < np.abs(coefficients[:, 0])
    coefficients = np.where(turn[:, None], coefficients[:, ::-1], coefficients)
    pencil = np.where(turn[:, None, None, None], pencil[:, ::-1], pencil)
    singular = pencil[:, 0] + _isolated_root(coefficients)[:, None, None] * pencil[:, 1]
    values, axes = np.linalg.eigh(singular)
    # a pair of real planes has eigenvalues of both signs; they meet in the axis of the middle one, which is zero
    common = axes[:, :, 1]
    a = np.sqrt(np.maximum(values[:, 2], 0.0))[:, None] * axes[:, :, 0]
    b = np.sqrt(np.maximum(-values[:, 0], 0.0))[:, None] * axes[:, :, 2]
    other = pencil[:, 1]
    return np.concatenate([_solve_in_plane(other, common, a + b), _solve_in_plane(other, common, a - b)], axis=1)


def _solve_in_plane(form: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
    """Return both directions (s, 2, 3) of the plane of p and q (s, 3) in which a form (s, 3, 3) vanishes."""
    in_plane = np.stack([p, q], axis=1)
    matrix = in_plane @ form @ np.swapaxes(in_plane, 1, 2)
    pp, pq, qq = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    root = np.sqrt(np.maximum(pq**2 - pp * qq, 0.0))
    h = -(pq + np.where(pq < 0.0, -root, root))
    shares = np.stack([np.stack([h, pp], axis=1), np.stack([qq, h], axis=1)], axis=1)
    return np.asarray(shares @ in_plane)


def _determinant_of_pencil(pencil: FloatArray) -> FloatArray:
    """Return the coefficients (s, 4) of det(A + g B), lowest power first."""
    a, b = pencil[:, 0], pencil[:, 1]
    minors_a, minors_b = (np.cross(m[:, [1, 2, 0]], m[:, [2, 0, 1]]) for m in (a, b))
    return np.stack(
        [
            np.einsum("si,si->s", a[:, 0], minors_a[:, 0]),
            np.einsum("sij,sij->s", minors_a, b),
            np.einsum("sij,sij->s", minors_b, a),
            np.einsum("si,si->s", b[:, 0], minors_b[:, 0]),
        ],
        axis=1,
    )


def _isolated_root(coefficients: FloatArray) -> FloatArray:
    """Return the real root of cubics (s, 4), lowest power first, that lies farthest from the others."""
    leading = np.where(coefficients[:, 3] == 0.0, 1e-300, coefficients[:, 3])
    c0, c1, c2 = (coefficients[:, :3] / leading[:, None]).T
    # t = g + c2 / 3 fulfils t³ + 3 p t + 2 q = 0 (Cardano; Vieta where all roots are real)
    p = (c1 - c2**2 / 3.0) / 3.0
    q = (c2**3 / 27.0 - c2 * c1 / 6.0) + c0 / 2.0
    discriminant = q**2 + p**3
    cube = np.cbrt(np.abs(q) + np.sqrt(np.maximum(discriminant, 0.0)))
    single = cube - p / np.where(cube == 0.0, 1.0, cube)
    radius = np.sqrt(np.maximum(-p, 0.0))
    ratio = np.abs(q) / np.where(radius == 0.0, 1.0, radius) ** 3
    outer = 2.0 * radius * np.cos(np.arccos(np.clip(ratio, 0.0, 1.0)) / 3.0)
    root = -np.where(q < 0.0, -1.0, 1.0) * np.where(discriminant > 0.0, single, outer) - c2 / 3.0
    for _ in range(2):
        slope = (3.0 * root + 2.0 * c2) * root + c1
        value = ((root + c2) * root + c1) * root + c0
        root = root - value / np.where(slope == 0.0, np.inf, slope)
    return np.asarray(root)


def _misclosures(distances: FloatArray, cosines: FloatArray, squares: FloatArray) -> FloatArray:
    d_i, d_j = distances[:, :, _PAIRS[:, 0]], distances[:, :, _PAIRS[:, 1]]
    return np.asarray(d_i**2 + d_j**2 - 2.0 * d_i * d_j * cosines[:, None] - squares[:, None])


def _newton_step(distances: FloatArray, cosines: FloatArray, squares: FloatArray) -> FloatArray:
    """Return the correction of the distances (s, 4, 3): a 3 x 3 system with a zero in each row, by Cramer's rule."""
    f01, f02, f12 = (-0.5 * _misclosures(distances, cosines, squares)).transpose(2, 0, 1)
    d0, d1, d2 = distances.transpose(2, 0, 1)
    c01, c02, c12 = cosines.T[:, :, None]
    # rows: a x0 + b x1 = f01, c x0 + d x2 = f02, e x1 + f x2 = f12
    a, b, c, d, e, f = d0 - c01 * d1, d1 - c01 * d0, d0 - c02 * d2, d2 - c02 * d0, d1 - c12 * d2, d2 - c12 * d1
    determinant = a * d * e + b * c * f
    x0 = f01 * d * e + b * (f02 * f - d * f12)
    x1 = a * (d * f12 - f02 * f) + f01 * c * f
    x2 = e * (a * f02 - c * f01) + b * c * f12
    # at a double solution the determinant vanishes and the step would be rounding magnified
    sound = np.abs(determinant) > 1e-14
    return np.stack([x0, x1, x2], axis=-1) * np.where(sound, 1.0 / np.where(sound, determinant, 1.0), 0.0)[..., None]
