"""Precision of matched positions, from the residuals of the patches."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.images.matching.patches import PatchGrid, Sampled, Template, partials

REACH = 9
"""Places of the patch over which noise is correlated, by interpolation, by smoothing and by JPEG."""
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
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the covariances of the positions of rays, square pixels; and their residuals.

    Noise of neighbouring places is correlated (C): with the estimate h g of a position, where h is the row of N^-1 A'
    W that belongs to it, the covariance is h C h' times the variance of the noise. Residuals have less of either than
    the noise, as the fit takes up a part: what it takes is computed and given back.

    Parameters
    ----------
    share : ndarray (r,)
        One for the rays whose mean the template is.

    Returns
    -------
    covariance : ndarray (r, 2, 2)
    residual : ndarray (r,)
        Root mean square, grey values.
    """
    fit = linear_fit(sampled, template, affine, grid)
    carried = _correlated(fit.estimator, noise_correlations(fit, np.flatnonzero(share), grid.side), grid.side)
    of_parameters = (carried @ fit.estimator.transpose(0, 2, 1)).astype(np.float64)
    taken = 2.0 * (fit.design * carried) - fit.design * (of_parameters.astype(np.float32) @ fit.design)
    left = 1.0 - (fit.weight * taken.sum(axis=1)).sum(axis=1, dtype=np.float64)
    square = (fit.weight * fit.residual**2).sum(axis=1, dtype=np.float64)
    variance = _variances(square / np.maximum(left, 0.1), point, share)
    return variance[:, None, None] * of_parameters[:, 4:6, 4:6], sampled.contrast * np.sqrt(square)


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
    """Return the spectrum of the correlations of the noise at the places of a patch, for `_correlated`.

    They depend on the distance alone, and are the mean over the rays, each with the same share: else a ray of another
    place, or a blurred one, whose residuals are large and smooth, would speak for all. With the projection P of the
    fit, residuals have P C P': C is found by repeating C <- C + (found - expected).

    Parameters
    ----------
    rays : ndarray
        Those from which they are found.
    side : int
        Places of a patch in a row.

    Returns
    -------
    ndarray (n, n // 2 + 1)
        Of a period n in which neither patches nor correlations overlap with themselves.
    """
    from scipy.fft import irfft2, next_fast_len, rfft2

    size = next_fast_len(side + REACH, real=True)
    if not rays.size:
        return np.ones((size, size // 2 + 1), dtype=np.float32)
    away = np.abs((np.arange(size) + size // 2) % size - size // 2)
    pairs = np.where(away <= REACH, np.maximum(side - away, 1), np.inf)
    pairs = pairs[:, None] * pairs
    own = fit.residual[rays]
    own = own / np.maximum(np.sqrt((own * own).mean(axis=1, keepdims=True)), np.float32(1e-6))
    residual = rfft2(_planes(own, side), (size, size))
    found = irfft2(np.sum(np.abs(residual) ** 2, axis=0, dtype=np.float64), (size, size)) / pairs
    found /= found[0, 0]
    some = rays[:: max(1, len(rays) // _OF_MANY)]
    design, estimator = fit.design[some], fit.estimator[some]
    of_design = rfft2(_planes(design, side), (size, size)).conj()
    correlations = found
    for _ in range(_ROUNDS):
        carried = _correlated(estimator, _spectrum(correlations), side)
        taken = 2.0 * carried - (carried @ estimator.transpose(0, 2, 1)) @ design
        both = np.sum((of_design * rfft2(_planes(taken, side), (size, size))).real, axis=(0, 1), dtype=np.float64)
        expected = correlations - irfft2(both, (size, size)) / (len(some) * pairs)
        correlations = correlations + found - expected / expected[0, 0]
        correlations /= correlations[0, 0]
    return _spectrum(correlations)


def _correlated(rows: NDArray[np.float32], spectrum: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Return rows (r, k, m), functionals of the places of a patch, times the correlations of the noise there."""
    from scipy.fft import irfft2, rfft2

    size = (len(spectrum), len(spectrum))
    found = irfft2(rfft2(_planes(rows, side), size) * spectrum, size)[..., :side, :side]
    return np.asarray(found.reshape(rows.shape), dtype=np.float32)


def _planes(rows: NDArray[np.floating[Any]], side: int) -> NDArray[np.floating[Any]]:
    return rows.reshape(*rows.shape[:-1], side, side)


def _spectrum(correlations: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return what is real, as correlations are the same in opposite directions; no variance is negative."""
    from scipy.fft import rfft2

    return np.asarray(np.maximum(rfft2(correlations).real, 0.0), dtype=np.float32)
