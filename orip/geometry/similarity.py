"""Spatial similarity X = T + m R x: fitted in closed form for any rotation, applied, and differentiated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.geometry.rotation import cross_matrix, rotation_about_axes

_ONE_LINE = 1e-6
"""Points whose width is a smaller part of their length lie on a line: what remains across it is rounding."""

UNKNOWNS = 7
"""Relative change of scale, three shifts, three small rotations about the target's axes: in this order."""


class Similarity(Struct, frozen=True):
    """X = T + m R x.

    Parameters
    ----------
    scale : float
        m > 0, units of the target system per unit of the source system.
    rotation : array (3, 3)
        R, source to target; its determinant is -1 where the transformation reflects.
    shift : array (3,)
        T, units of the target system.
    """

    scale: float
    rotation: FloatArray
    shift: FloatArray

    def apply(self, xyz: FloatArray) -> FloatArray:
        """Return the transformed coordinates of points (..., 3)."""
        return np.asarray(self.scale * (xyz @ self.rotation.T) + self.shift)

    def inverse(self) -> Similarity:
        """Return the transformation back."""
        back = self.rotation.T
        return Similarity(1.0 / self.scale, back, -(back @ self.shift) / self.scale)

    def after(self, first: Similarity) -> Similarity:
        """Return the transformation that applies `first` and then this one."""
        return Similarity(self.scale * first.scale, self.rotation @ first.rotation, self.apply(first.shift))


class Similarities(NamedTuple):
    """s transformations, one from each sample of points.

    Parameters
    ----------
    scale : array (s,)
    rotation : array (s, 3, 3)
    shift : array (s, 3)
    """

    scale: FloatArray
    rotation: FloatArray
    shift: FloatArray

    def apply(self, xyz: FloatArray) -> FloatArray:
        """Return the coordinates (s, n, 3) of points (n, 3) after each of the transformations."""
        return np.asarray(self.scale[:, None, None] * (xyz @ np.swapaxes(self.rotation, 1, 2)) + self.shift[:, None])

    def moved(self, changes: FloatArray) -> Similarities:
        """Return the transformations after changes (s, 7) of their unknowns, in the order of `UNKNOWNS`."""
        rotation = rotation_about_axes(changes[:, 4:]) @ self.rotation
        return Similarities(self.scale * np.exp(changes[:, 0]), rotation, self.shift + changes[:, 1:4])

    def one(self, index: int) -> Similarity:
        """Return one of the transformations."""
        return Similarity(float(self.scale[index]), self.rotation[index], self.shift[index])

    def only(self, chosen: NDArray[np.bool_]) -> Similarities:
        """Return some of the n transformations, chosen by flags (n,)."""
        return Similarities(self.scale[chosen], self.rotation[chosen], self.shift[chosen])


def several(transformations: list[Similarity]) -> Similarities:
    """Return s single transformations as arrays."""
    return Similarities(
        np.array([transformation.scale for transformation in transformations]),
        np.array([transformation.rotation for transformation in transformations]),
        np.array([transformation.shift for transformation in transformations]),
    )


def fit_similarity(source: FloatArray, target: FloatArray, weights: FloatArray | None = None) -> Similarity:
    """Fit source to target coordinates by least squares.

    Parameters
    ----------
    source, target : arrays (n, 3)
    weights : array (n,), optional
        Weights of the points, all equal by default.

    Raises
    ------
    ValueError
        With fewer than three points, or points on one line.

    Notes
    -----
    Closed form by singular value decomposition (Arun, Huang and Blostein 1987, Horn 1987; scale and the treatment of
    reflected solutions: Umeyama 1991, eq. 40-42).
    """
    if len(source) < 3:
        message = f"{len(source)} common points, 3 are needed"
        raise ValueError(message)
    given = None if weights is None else weights[None]
    fits = fit_similarities(source[None], target[None], given)
    if not len(fits.scale):
        message = "the common points lie on one line"
        raise ValueError(message)
    return fits.one(0)


def fit_similarities(source: FloatArray, target: FloatArray, weights: FloatArray | None = None) -> Similarities:
    """Fit s samples of k points each; samples that lie on one line in either system are left out.

    Parameters
    ----------
    source, target : arrays (s, k, 3)
    weights : array (s, k), optional

    Returns
    -------
    Similarities
        One for each sample that determines a similarity.
    """
    share = np.ones(source.shape[:2]) if weights is None else weights
    share = (share / share.sum(axis=1, keepdims=True))[:, :, None]
    source_mean, target_mean = (share * source).sum(axis=1), (share * target).sum(axis=1)
    x, X = source - source_mean[:, None], target - target_mean[:, None]
    determined = _spread(np.sqrt(share) * x) & _spread(np.sqrt(share) * X)
    x, X, share = x[determined], X[determined], share[determined]
    left, singular, right = np.linalg.svd(np.swapaxes(X, 1, 2) @ (share * x))
    signs = np.ones_like(singular)
    signs[:, 2] = np.sign(np.linalg.det(left @ right))
    rotation = left @ (signs[:, :, None] * right)
    scale = (singular * signs).sum(axis=1) / (share * x**2).sum(axis=(1, 2))
    turned = np.einsum("sij,sj->si", rotation, source_mean[determined])
    return Similarities(scale, rotation, target_mean[determined] - scale[:, None] * turned)


def _spread(reduced: FloatArray) -> NDArray[np.bool_]:
    """Return which samples (s, k, 3), reduced to their centroids, span at least a plane."""
    if not reduced.size:
        return np.zeros(len(reduced), dtype=bool)
    singular = np.linalg.svd(reduced, compute_uv=False)
    return np.asarray(singular[:, 1] > _ONE_LINE * np.maximum(singular[:, 0], np.finfo(float).tiny))


class SimilarityPartials(NamedTuple):
    """Transformed points and their partials.

    Parameters
    ----------
    value : array (s, n, 3)
    by_unknowns : array (s, n, 3, 7)
        With respect to the unknowns in the order of `UNKNOWNS`.
    """

    value: FloatArray
    by_unknowns: FloatArray


def similarity_with_partials(at: Similarities, xyz: FloatArray) -> SimilarityPartials:
    """Transform points and differentiate with respect to the seven unknowns.

    Parameters
    ----------
    at : Similarities
        s transformations; the partials are those of `Similarities.moved` at a change of 0.
    xyz : array (n, 3)
        Source system. Reduced to their centroid they keep shift and rotation from being confused.
    """
    value = at.apply(xyz)
    turned = value - at.shift[:, None]
    partials = np.zeros((*value.shape, UNKNOWNS))
    partials[..., 0] = turned
    partials[..., 1:4] = np.eye(3)
    partials[..., 4:] = -cross_matrix(turned)
    return SimilarityPartials(value, partials)
