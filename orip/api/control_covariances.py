"""Covariances of control points as arrays: their a-priori errors and how these are correlated."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orip.api.columns import Columns
from orip.arrays import FloatArray
from orip.records.control import ControlPoint, PointCorrelation
from orip.structs import replace

_SYMMETRIC = 1e-9
"""Part of the errors by which elements on both sides of the diagonal may differ."""

_UNCORRELATED = 1e-12


def errors_and_correlations(
    columns: Columns, given: ArrayLike, coordinates: FloatArray
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the a-priori errors (n, 3) and the coefficients of correlation (3 n, 3 n) of coordinates (n, 3).

    None for both where the covariances, (n, 3, 3) or (3 n, 3 n), are not fit for use; complaints are kept.
    """
    count = len(coordinates)
    try:
        found = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        columns.complain("is no array of numbers", "covariance")
        return None, None
    if found.shape not in {(count, 3, 3), (3 * count, 3 * count)}:
        shapes = f"({count}, 3, 3) or ({3 * count}, {3 * count})"
        columns.complain(f"has the shape {found.shape}; {shapes} is needed", "covariance")
        return None, None
    if np.isnan(coordinates).any():
        columns.complain("needs all coordinates; give error for points with NaN", "covariance")
        return None, None
    whole = _along_diagonal(found) if found.ndim == 3 else found
    variances = np.diagonal(whole)
    if not np.isfinite(whole).all() or not (variances > 0.0).all():
        wrong = int(np.flatnonzero(~(np.isfinite(whole).all(axis=1) & (variances > 0.0)))[0])
        columns.complain("has to be finite, and above 0 on the diagonal", "covariance", (wrong, wrong))
        return None, None
    errors = np.sqrt(variances)
    coefficients = whole / np.outer(errors, errors)
    if np.abs(coefficients - coefficients.T).max() > _SYMMETRIC:
        columns.complain("is not symmetric", "covariance")
        return None, None
    if np.linalg.eigvalsh(coefficients)[0] <= 0.0:
        columns.complain("is not positive definite; give the covariances as one adjustment has them", "covariance")
        return None, None
    return errors.reshape(-1, 3), coefficients


def with_correlations(
    points: tuple[ControlPoint, ...], coefficients: FloatArray | None
) -> tuple[tuple[ControlPoint, ...], tuple[PointCorrelation, ...]]:
    """Return n points with how their own coordinates are correlated (3 n, 3 n), and the correlated pairs of them."""
    if coefficients is None or len(coefficients) != 3 * len(points):
        return points, ()
    blocks = coefficients.reshape(len(points), 3, len(points), 3).transpose(0, 2, 1, 3)
    own = [
        replace(point, correlations=(float(block[0, 1]), float(block[0, 2]), float(block[1, 2])))
        if np.abs(block - np.eye(3)).max() > _UNCORRELATED
        else point
        for point, block in zip(points, blocks[np.arange(len(points)), np.arange(len(points))], strict=True)
    ]
    first, second = np.nonzero(np.triu(np.abs(blocks).max(axis=(2, 3)) > _UNCORRELATED, 1))
    pairs = (
        PointCorrelation(points[a].name, points[b].name, tuple(map(tuple, blocks[a, b].tolist())))
        for a, b in zip(first.tolist(), second.tolist(), strict=True)
    )
    return tuple(own), tuple(pairs)


def _along_diagonal(blocks: FloatArray) -> FloatArray:
    count = len(blocks)
    found = np.zeros((count, 3, count, 3))
    found[np.arange(count), :, np.arange(count), :] = blocks
    return found.reshape(3 * count, 3 * count)
