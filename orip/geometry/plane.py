"""Plane transformations: affine, conformal, and conformal without scale, fitted to points in closed form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray

TransformationKind = Literal["A", "C", "W"]

MARKS_NEEDED: dict[TransformationKind, int] = {"A": 3, "C": 2, "W": 2}
PARAMETERS: dict[TransformationKind, int] = {"A": 6, "C": 4, "W": 3}

_LARGEST_COORDINATE, _SMALLEST_EXTENT = 1e100, 1e-100
"""Above the first squares overflow, below the second they vanish; no film is that large or small in any unit."""

_ONE_PLACE = 1e-12
"""Marks closer together than this part of their coordinates differ only by rounding."""

_ONE_LINE = 1e-3
"""Marks on a line across a film of 230 mm deviate from it by some 0.01 mm, the measuring error; no frame is as narrow
as a thousandth of its length."""

_NO_INVERSE = 1e-2
"""Smallest scale as part of the one expected from the extents: a conformal transformation to a mirrored square has a
scale of some 1e-4, which comes from measuring errors alone."""


class PlaneTransformation(Struct, frozen=True):
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
        # in (-pi, pi], as all angles are written: a mirror image has a skew of +pi
        return rotation, np.pi - (np.pi - skew) % (2.0 * np.pi)


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
        With fewer marks than the kind needs, or marks that do not determine it: all on a line, in one place, or so
        different from the given ones that the transformation has no inverse.
    """
    if len(measured) < MARKS_NEEDED[kind]:
        message = f"{len(measured)} marks, {MARKS_NEEDED[kind]} are needed"
        raise ValueError(message)
    size = _extent(kind, measured, "measured marks")
    given_size = _extent(kind, given, "given coordinates of the marks")
    centre, target = measured.mean(axis=0), given.mean(axis=0)
    matrix = _FITS[kind](measured - centre, given - target)
    if np.linalg.svd(matrix, compute_uv=False)[1] < _NO_INVERSE * given_size / size:
        message = (
            "the measured marks are not arranged like the given ones "
            "(are names interchanged, or is the film upside down?)"
        )
        raise ValueError(message)
    return PlaneTransformation(matrix, target - matrix @ centre)


def _extent(kind: TransformationKind, xy: FloatArray, what: str) -> float:
    """Return the extent of marks along their longest direction; raise ValueError where they fix no transformation."""
    largest = float(np.abs(xy).max())
    if not largest < _LARGEST_COORDINATE:
        message = f"the {what} have coordinates above {_LARGEST_COORDINATE:g}"
        raise ValueError(message)
    length, width = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
    if length <= max(_ONE_PLACE * largest, _SMALLEST_EXTENT):
        message = f"the {what} lie in one place"
        raise ValueError(message)
    if kind == "A" and width < _ONE_LINE * length:
        message = f"the {what} lie on one line"
        raise ValueError(message)
    return float(length)


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
    if length <= _NO_INVERSE * np.linalg.norm(measured) * np.linalg.norm(given):
        return np.zeros((2, 2))
    return np.array([[cosine, -sine], [sine, cosine]], dtype=np.float64) / float(length)


_FITS: dict[TransformationKind, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "A": _fit_affine,
    "C": _fit_conform,
    "W": _fit_without_scale,
}
