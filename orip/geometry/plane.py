"""Plane transformations: affine, conform, and conform without scale, fitted to points in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

TransformationKind = Literal["A", "C", "W"]

MARKS_NEEDED: dict[TransformationKind, int] = {"A": 3, "C": 2, "W": 2}
PARAMETERS: dict[TransformationKind, int] = {"A": 6, "C": 4, "W": 3}


@dataclass(frozen=True, slots=True)
class PlaneTransformation:
    """X = x0 + a x + b y, Y = y0 + c x + d y.

    Parameters
    ----------
    matrix : array (2, 2)
        [[a, b], [c, d]].
    shift : array (2,)
        x0, y0, in units of the target system.
    """

    matrix: FloatArray
    shift: FloatArray

    def apply(self, xy: FloatArray) -> FloatArray:
        """Return the transformed coordinates of points (n, 2)."""
        return np.asarray(xy @ self.matrix.T + self.shift)

    def inverse(self) -> PlaneTransformation:
        """Return the transformation back; raises `numpy.linalg.LinAlgError` when there is none."""
        back = np.asarray(np.linalg.inv(self.matrix), dtype=np.float64)
        return PlaneTransformation(back, -back @ self.shift)

    def after(self, first: PlaneTransformation) -> PlaneTransformation:
        """Return the transformation that applies `first` and then this one."""
        return PlaneTransformation(self.matrix @ first.matrix, self.matrix @ first.shift + self.shift)

    @property
    def mirrored(self) -> bool:
        """Whether the transformation turns the plane over."""
        return bool(np.linalg.det(self.matrix) < 0)

    @property
    def scales(self) -> tuple[float, float]:
        """Return sx, sy."""
        (a, b), (c, d) = self.matrix
        return float(np.hypot(a, c)), float(np.hypot(b, d))

    @property
    def rotation_and_skew(self) -> tuple[float, float]:
        """Return ro, sk in radians: a = sx cos ro, c = sx sin ro, b = -sy sin(ro + sk), d = sy cos(ro + sk)."""
        (a, b), (c, d) = self.matrix
        rotation = float(np.arctan2(c, a))
        skew = float(np.arctan2(-b, d)) - rotation
        return rotation, (skew + np.pi) % (2.0 * np.pi) - np.pi


IDENTITY = PlaneTransformation(np.eye(2), np.zeros(2))


def fit_plane_transformation(kind: TransformationKind, measured: FloatArray, given: FloatArray) -> PlaneTransformation:
    """Fit measured to given coordinates by least squares with equal weights.

    Parameters
    ----------
    kind : {"A", "C", "W"}
    measured, given : arrays (n, 2)

    Returns
    -------
    PlaneTransformation
        Measured to given.

    Raises
    ------
    ValueError
        With fewer marks than the kind needs, or marks that do not determine it (all on a line, or in one place).
    """
    if len(measured) < MARKS_NEEDED[kind]:
        message = f"{len(measured)} marks, {MARKS_NEEDED[kind]} are needed"
        raise ValueError(message)
    centre, target = measured.mean(axis=0), given.mean(axis=0)
    extent = np.linalg.svd(measured - centre, compute_uv=False)
    if extent[0] == 0.0 or (kind == "A" and extent[1] < 1e-6 * extent[0]):
        message = "the marks lie in one place" if extent[0] == 0.0 else "the marks lie on one line"
        raise ValueError(message)
    matrix = _FITS[kind](measured - centre, given - target)
    return PlaneTransformation(matrix, target - matrix @ centre)


def _fit_affine(measured: FloatArray, given: FloatArray) -> FloatArray:
    solution, *_ = np.linalg.lstsq(measured, given, rcond=None)
    return np.asarray(solution.T)


def _rotation_sums(measured: FloatArray, given: FloatArray) -> tuple[float, float]:
    cosine = float(np.sum(measured * given))
    sine = float(np.sum(measured[:, 0] * given[:, 1] - measured[:, 1] * given[:, 0]))
    return cosine, sine


def _fit_conform(measured: FloatArray, given: FloatArray) -> FloatArray:
    cosine, sine = np.array(_rotation_sums(measured, given)) / np.sum(measured**2)
    return np.array([[cosine, -sine], [sine, cosine]])


def _fit_without_scale(measured: FloatArray, given: FloatArray) -> FloatArray:
    cosine, sine = _rotation_sums(measured, given)
    length = np.hypot(cosine, sine)
    if length == 0.0:
        message = "the marks do not fix a rotation"
        raise ValueError(message)
    return np.array([[cosine, -sine], [sine, cosine]], dtype=np.float64) / float(length)


_FITS: dict[TransformationKind, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "A": _fit_affine,
    "C": _fit_conform,
    "W": _fit_without_scale,
}
