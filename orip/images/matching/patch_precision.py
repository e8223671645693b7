"""Precision of matched positions, from the residuals of the patches."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.images.matching.patches import PatchGrid, Sampled, Template, partials

REACH = 9
"""Places of the patch over which noise is correlated, by interpolation, by smoothing and by JPEG."""

HIDDEN_NOISE = 0.4
"""Grey values: what whole grey values, interpolation and JPEG add that residuals do not show, from rendered photos."""
_ROUNDS = 4
_OF_MANY = 150
"""Rays from which it is computed how much less residuals are correlated than noise."""


class Fit(Struct, frozen=True):
    """The fit of patches to a template, linearised.

    Parameters
    ----------
    design : ndarray (r, 8, m)
        Partials.
    estimator : ndarray (r, 8, m)
        N^-1 A' W: from grey values to parameters.
    weight : ndarray (r, m)
        W, of a sum of one.
    residual : ndarray (r, m)
        With gain and offset fitted.
    """

    design: NDArray[np.float32]
    estimator: NDArray[np.float32]
    weight: NDArray[np.float32]
    residual: NDArray[np.float32]


def position_covariances(
    sampled: Sampled,
    template: Template,
    affine: NDArray[np.float64],
    grid: PatchGrid,
    point: NDArray[np.intp],
    share: NDArray[np.float32],
) -> NDArray[np.float64]:
    """Return the covariances of the positions of rays, square pixels.

    Noise of neighbouring places is correlated (C): with the estimate h g of a position, where h is the row of N^-1 A'
    W that belongs to it, the covariance is h C h' times the variance of the noise. Residuals have less of either than
    the noise, as the fit takes up a part: what it takes is computed and given back.

    Parameters
    ----------
    share : ndarray (r,)
        One for the rays whose mean the template is.

    Returns
    -------
    ndarray (r, 2, 2)
    """
    fit = linear_fit(sampled, template, affine, grid)
    correlations = noise_correlations(fit, np.flatnonzero(share), grid.side)
    carried = fit.estimator @ correlations
    of_parameters = (carried @ fit.estimator.transpose(0, 2, 1)).astype(np.float64)
    taken = 2.0 * (fit.design * carried) - fit.design * (of_parameters.astype(np.float32) @ fit.design)
    left = 1.0 - (fit.weight * taken.sum(axis=1)).sum(axis=1, dtype=np.float64)
    square = (fit.weight * fit.residual**2).sum(axis=1, dtype=np.float64) / np.maximum(left, 0.1)
    square += (HIDDEN_NOISE / sampled.contrast) ** 2
    return _variances(square, point, share)[:, None, None] * of_parameters[:, 4:6, 4:6]


def linear_fit(sampled: Sampled, template: Template, affine: NDArray[np.float64], grid: PatchGrid) -> Fit:
    """Return the fit of patches at their final places."""
    design = partials(template, affine, grid)
    weight = sampled.weight / np.maximum(sampled.weight.sum(axis=1, keepdims=True), np.float32(1e-6))
    weighted = design * weight[:, None, :]
    normal = (weighted @ design.transpose(0, 2, 1)).astype(np.float64)
    diagonal = np.einsum("rii->ri", normal)
    diagonal += 1e-6 * diagonal.max(axis=1, keepdims=True) + 1e-9
    estimator = np.linalg.inv(normal).astype(np.float32) @ weighted
    radiometric = (weighted[:, 6:] @ sampled.value[..., None]).astype(np.float64)
    fitted = -np.linalg.solve(normal[:, 6:, 6:], radiometric).astype(np.float32)
    return Fit(design, estimator, weight, sampled.value + (design[:, 6:] * fitted).sum(axis=1))


def _variances(square: NDArray[np.float64], point: NDArray[np.intp], share: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the variance of the noise of each ray from the mean squares of residuals.

    A residual against the mean of n patches has the variance (1 - 2 / n) of its own noise and 1 / n of the mean of
    all; with two or three rays that of the mean is taken.
    """
    count = np.bincount(point, weights=share)
    mean = np.bincount(point, weights=share * square) / np.maximum(count, 1.0)
    of_all = (mean * count / np.maximum(count - 1.0, 1.0))[point]
    n = np.maximum(count[point], 4.0)
    own = (square - of_all / n) / (1.0 - 2.0 / n)
    found: NDArray[np.float64] = np.where(count[point] >= 4, np.clip(own, 0.4 * of_all, 4.0 * of_all), of_all)
    return found


def noise_correlations(fit: Fit, rays: NDArray[np.intp], side: int) -> NDArray[np.float32]:
    """Return the correlations of the noise at the places of a patch, (m, m).

    They depend on the distance alone, and are the mean over the rays. With the projection P of the fit, residuals have
    P C P': C is found by repeating C <- C + (found - expected).
    """
    if not rays.size:
        return np.eye(side * side, dtype=np.float32)
    some = rays[:: max(1, len(rays) // _OF_MANY)]
    residual = fit.residual[rays].reshape(-1, side, side)
    found = _by_distance(residual, residual)
    correlations = found / found[0, REACH]
    design, estimator = fit.design[some], fit.estimator[some]
    planes = (-1, design.shape[1], side, side)
    for _ in range(_ROUNDS):
        carried = estimator @ _matrix(correlations, side)
        back = (carried @ estimator.transpose(0, 2, 1)) @ design
        taken = 2.0 * carried - back
        both = _by_distance(design.reshape(planes), taken.reshape(planes))
        other = _by_distance(taken.reshape(planes), design.reshape(planes))
        expected = correlations - 0.5 * design.shape[1] * (both + other)
        step = found / found[0, REACH] - expected / expected[0, REACH]
        correlations = correlations + step
        correlations = correlations / correlations[0, REACH]
    return _matrix(correlations, side)


def _by_distance(one: NDArray[np.floating[Any]], other: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return mean products by their distance: (REACH + 1, 2 REACH + 1), down, and across from -REACH on."""
    found = np.zeros((REACH + 1, 2 * REACH + 1))
    height, width = one.shape[-2:]
    for down in range(REACH + 1):
        for across in range(-REACH, REACH + 1):
            left, right = max(0, -across), max(0, across)
            here = one[..., : height - down, left : width - right]
            there = other[..., down:, right : width - left]
            found[down, REACH + across] = float(np.mean(here * there, dtype=np.float64))
    found[0, :REACH] = found[0, :REACH:-1]
    return found


def _matrix(correlations: NDArray[np.float64], side: int) -> NDArray[np.float32]:
    """Return the correlations of all places of a patch with all others."""
    table = np.zeros((4 * side + 1, 4 * side + 1))
    middle = 2 * side
    table[middle : middle + REACH + 1, middle - REACH : middle + REACH + 1] = correlations
    table[middle - REACH : middle + 1, middle - REACH : middle + REACH + 1] = correlations[::-1, ::-1]
    table[middle, middle : middle + REACH + 1] = correlations[0, REACH:]
    v, u = (part.ravel() for part in np.divmod(np.arange(side * side), side))
    found: NDArray[np.float32] = table[middle + v[None, :] - v[:, None], middle + u[None, :] - u[:, None]].astype("f4")
    return found
