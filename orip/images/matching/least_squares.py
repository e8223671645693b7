"""Least-squares matching: all photos of a point against one patch.

Gruen, A. (1985): Adaptive least squares correlation, South African Journal of Photogrammetry 14(3); Ackermann, F.
(1984): Digital image correlation, Photogrammetric Record 11(64). Where these match against the patch of one photo, the
patch is here the mean of all, so that no photo is without error: with t_k the position in photo k,

    g_k(A_k (u, v) + t_k) = gain_k T(u, v) + offset_k + noise

for the places (u, v) of the patch. With T estimated too, the positions of the rays are independent of each other but
for a movement common to all, which is the point's own position on the surface: what a bundle adjustment takes.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.images.matching.patch_precision import position_covariances
from orip.images.matching.patches import (
    PatchGrid,
    Sampled,
    Template,
    mean_patch,
    partials,
    patch_grid,
    sample_patches,
    spline_coefficients,
)


class Fate(IntEnum):
    """What became of a ray."""

    MATCHED = 0
    CORRELATION = 1
    NO_CONVERGENCE = 2
    DRIFT = 3
    DEFORMED = 4
    WEAK = 5
    ALONE = 6
    CONTRADICTS = 7
    ALIKE = 8


class Windows(Struct, frozen=True):
    """What the photos show around the rays of points.

    Parameters
    ----------
    point : ndarray (r,)
        Of which point a ray is: ascending, from 0 without gaps.
    pixels : ndarray (r, s, s)
        Grey values.
    centre : ndarray (r, 2)
        Where the feature is: column and row from the centre of the window's first pixel.
    affine : ndarray (r, 2, 2)
        From the patch to pixels, approximately.
    """

    point: NDArray[np.intp]
    pixels: NDArray[np.uint8]
    centre: NDArray[np.float64]
    affine: NDArray[np.float64]


class MatchSettings(Struct, frozen=True):
    """How rays are matched.

    Parameters
    ----------
    half : int
        The patch has 2 `half` + 1 times as many places.
    smoothing : float
        Standard deviation of the Gaussian before, pixels.
    least_correlation : float
        Of a ray with the mean of the others.
    most_drift : float
        Away from the feature, places of the patch.
    most_error : float
        Standard deviation in any direction, pixels of the window.
    """

    half: int = 10
    smoothing: float = 0.8
    least_correlation: float = 0.8
    most_drift: float = 4.0
    most_error: float = 0.4


class MatchedRays(Struct, frozen=True):
    """Rays after matching.

    Parameters
    ----------
    centre : ndarray (r, 2)
        Column and row from the centre of the window's first pixel.
    affine : ndarray (r, 2, 2)
        From the patch to pixels.
    covariance : ndarray (r, 2, 2)
        Square pixels.
    correlation : ndarray (r,)
    fate : ndarray (r,)
        Of `Fate`.
    """

    centre: NDArray[np.float64]
    affine: NDArray[np.float64]
    covariance: NDArray[np.float64]
    correlation: NDArray[np.float64]
    fate: NDArray[np.int8]


class _State(Struct, frozen=True):
    affine: NDArray[np.float64]
    centre: NDArray[np.float64]
    share: NDArray[np.float32]
    moved: NDArray[np.float64]


_COARSE_SMOOTHING, _COARSE_STEP, _COARSE_MOST = 2.0, 1.3, 8
_ON_ONE_PHOTO = 4
"""Iterations against the patch of one photo: the mean of patches that are apart is blurred."""
_MOST = 20
_CONVERGED = 0.005
"""Pixels that a ray moves at most in the last iteration, beside what all rays of its point move."""
LEAST_CONTRAST = 4.0
"""Standard deviation of the grey values of a patch: of flatter ones JPEG leaves nothing but the pattern of blocks."""
_LEAST_NOISE = 0.03
"""Grey values: rounding them to whole ones leaves twice as much. Patches more alike are not of two exposures, but show
the pattern of JPEG's blocks."""
_EDGE = 12.0
"""Times as precise across as along an edge: noise alone says where on such an edge a point is."""
_BAD_START = 0.5
_DEFORMATION = 1.8
_SHAPE_STEP = 0.3
_WORTH_IT = 0.8
"""Part of the points that still move: if more do, those that do not are not worth leaving out."""


def match_rays(windows: Windows, settings: MatchSettings) -> MatchedRays:
    """Match all rays of points at once.

    Ray of a point that do not correlate have no part in its patch. A point keeps at least two rays, or none.
    """
    share = np.ones(len(windows.point), dtype=np.float32)
    state = _State(windows.affine, windows.centre, share, np.full(len(windows.point), np.inf))
    coefficients = spline_coefficients(windows.pixels, _COARSE_SMOOTHING)
    coarse = patch_grid(settings.half, _COARSE_STEP)
    state = _refined(coefficients, windows.point, state, coarse, _COARSE_MOST, begins=True)
    grid = patch_grid(settings.half, 1.0)
    coefficients = spline_coefficients(windows.pixels, settings.smoothing)
    state = _refined(coefficients, windows.point, state, grid, _MOST, begins=False)
    sampled = sample_patches(coefficients, state.affine, state.centre, grid)
    correlation = _correlations(sampled, state.share, windows.point)
    fate = _fates(windows, state, correlation, settings)
    share = (fate == Fate.MATCHED).astype(np.float32)
    template = mean_patch(sampled, share, windows.point)
    covariance, residual = position_covariances(sampled, template, state.affine, grid, windows.point, share)
    least, largest = np.linalg.eigvalsh(covariance).T
    weak = ~(largest <= settings.most_error**2) | (largest > _EDGE**2 * least)
    weak |= (sampled.contrast < LEAST_CONTRAST) | (residual < _LEAST_NOISE)
    fate[(fate == Fate.MATCHED) & weak] = Fate.WEAK
    rays = np.bincount(windows.point, weights=fate == Fate.MATCHED)
    fate[(fate == Fate.MATCHED) & (rays[windows.point] < 2)] = Fate.ALONE
    return MatchedRays(state.centre, state.affine, covariance, correlation, fate)


def _refined(
    coefficients: NDArray[np.float32],
    point: NDArray[np.intp],
    state: _State,
    grid: PatchGrid,
    most: int,
    *,
    begins: bool,
) -> _State:
    """Return the state after iterations, as `most`; points that do not move any more are left alone."""
    rays, found = np.arange(len(point)), state
    for iteration in range(most):
        sampled = sample_patches(coefficients, state.affine, state.centre, grid)
        on_one = begins and iteration < _ON_ONE_PHOTO
        share = _reference(point) if on_one else _shares(sampled, state, point)
        template = mean_patch(sampled, share, point)
        state = _moved(state, sampled, template, grid, share, point)
        _put(found := _copied(found), rays, state)
        moves = np.bincount(point, weights=(state.moved > _CONVERGED) & (share > 0.0)) > 0.0
        if on_one or moves.mean() > _WORTH_IT:
            continue
        if not moves.any():
            break
        left = moves[point]
        rays, coefficients, state = rays[left], coefficients[left], _taken(state, left)
        point = np.unique(point[left], return_inverse=True)[1]
    return found


def _taken(state: _State, rays: NDArray[np.bool_]) -> _State:
    return _State(state.affine[rays], state.centre[rays], state.share[rays], state.moved[rays])


def _copied(state: _State) -> _State:
    return _State(state.affine.copy(), state.centre.copy(), state.share.copy(), state.moved.copy())


def _put(all_rays: _State, rays: NDArray[np.intp], state: _State) -> None:
    all_rays.affine[rays], all_rays.centre[rays] = state.affine, state.centre
    all_rays.share[rays], all_rays.moved[rays] = state.share, state.moved


def _reference(point: NDArray[np.intp]) -> NDArray[np.float32]:
    """Return the share of one for the first ray of each point: the rays come with the best one first."""
    return (np.diff(point, prepend=-1) > 0).astype(np.float32)


def _shares(sampled: Sampled, state: _State, point: NDArray[np.intp]) -> NDArray[np.float32]:
    """Return one for the rays that correlate with the others of their points; where none does, for all."""
    good = (_correlations(sampled, state.share, point) > _BAD_START).astype(np.float32)
    count = np.bincount(point, weights=good)
    return np.where(count[point] < 2, np.float32(1.0), good)


def _correlations(
    sampled: Sampled, share: NDArray[np.float32], point: NDArray[np.intp]
) -> NDArray[np.float64]:  # fmt: skip
    """Return the correlation of each ray with the mean of the other rays that have a share."""
    first = np.flatnonzero(np.diff(point, prepend=-1))
    total = np.add.reduceat(sampled.value * share[:, None], first, axis=0)[point]
    others = total - sampled.value * share[:, None]
    weight = sampled.weight
    norm = np.maximum(weight.sum(axis=1, keepdims=True), 1e-6)
    others = others - (weight * others).sum(axis=1, keepdims=True) / norm
    size = np.sqrt((weight * others * others).sum(axis=1) / norm[:, 0])
    product = (weight * others * sampled.value).sum(axis=1) / norm[:, 0]
    return np.where(size > 1e-6, product / np.maximum(size, 1e-6), -1.0).astype(np.float64)


def _moved(
    state: _State,
    sampled: Sampled,
    template: Template,
    grid: PatchGrid,
    share: NDArray[np.float32],
    point: NDArray[np.intp],
) -> _State:
    """Return the state after one iteration of Gauss and Newton of each ray by itself."""
    design = partials(template, state.affine, grid)
    weighted = design * sampled.weight[:, None, :]
    normal = (weighted @ design.transpose(0, 2, 1)).astype(np.float64)
    right = (weighted @ sampled.value[..., None])[..., 0].astype(np.float64)
    diagonal = np.einsum("rii->ri", normal)
    diagonal += 1e-6 * diagonal.max(axis=1, keepdims=True) + 1e-9
    step = -np.linalg.solve(normal, right[..., None])[..., 0]
    shape = np.clip(step[:, :4] / grid.half, -_SHAPE_STEP, _SHAPE_STEP).reshape(-1, 2, 2)
    most = 0.2 * grid.half
    shift = np.clip(step[:, 4:6], -most, most)
    common = np.add.reduceat(shift * share[:, None], np.flatnonzero(np.diff(point, prepend=-1)), axis=0)
    count = np.maximum(np.bincount(point, weights=share), 1.0)
    beside = shift - (common / count[:, None])[point]
    return _State(state.affine + shape, state.centre + shift, share, np.abs(beside).max(axis=1))


def _fates(
    windows: Windows, state: _State, correlation: NDArray[np.float64], settings: MatchSettings
) -> NDArray[np.int8]:
    """Return what became of the rays, but for their precision; the first reason counts."""
    scale = np.sqrt(np.abs(np.linalg.det(state.affine) / np.linalg.det(windows.affine)))
    deformed = (scale > _DEFORMATION) | (scale < 1.0 / _DEFORMATION) | (np.linalg.det(state.affine) <= 0.0)
    moved = np.linalg.solve(windows.affine, (state.centre - windows.centre)[..., None])[..., 0]
    drift = np.hypot(*moved.T) > settings.most_drift
    fate = np.zeros(len(correlation), dtype=np.int8)
    for reason, holds in (
        (Fate.NO_CONVERGENCE, state.moved > 4.0 * _CONVERGED),
        (Fate.DEFORMED, deformed),
        (Fate.DRIFT, drift),
        (Fate.CORRELATION, correlation < settings.least_correlation),
    ):
        fate[holds] = reason
    return fate
