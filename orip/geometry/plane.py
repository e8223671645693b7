"""Plane transformations and the homography between a plane in space and its image, fitted to points in closed form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

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


class PlaneOrientations(NamedTuple):
    """Orientations of a photo of a plane: the first is that of the homography, the second its reversal.

    Attributes
    ----------
    rotations : array (2, 3, 3)
        Photo to ground.
    centres : array (2, 3)
    """

    rotations: FloatArray
    centres: FloatArray


def homography(plane: FloatArray, image: FloatArray) -> FloatArray:
    """Return H with (image, 1) ~ H (plane, 1), by the direct linear transformation with normalised coordinates.

    Parameters
    ----------
    plane, image : arrays (n, 2)
        n >= 4 points.

    Returns
    -------
    array (3, 3)
        Of Frobenius norm 1 and any sign.

    Raises
    ------
    ValueError
        With fewer than four points, or points that do not determine it: all but one on a line.

    Notes
    -----
    Abdel-Aziz and Karara 1971, for a plane; normalisation: Hartley 1997.
    """
    if len(plane) < 4:
        message = f"{len(plane)} points, 4 are needed"
        raise ValueError(message)
    to_plane, to_image = _normalisation(plane), _normalisation(image)
    p, q = _homogeneous(plane) @ to_plane.T, _homogeneous(image) @ to_image.T
    zero = np.zeros_like(p)
    design = np.vstack([np.hstack([p, zero, -q[:, :1] * p]), np.hstack([zero, p, -q[:, 1:2] * p])])
    # the triangle has the same singular values and right vectors, and no more than nine rows
    _, values, rows = np.linalg.svd(np.linalg.qr(design, mode="r"))
    if values[7] < 1e-9 * values[0]:
        message = "the points do not determine the homography: all but one of them lie on one line"
        raise ValueError(message)
    matrix = np.linalg.inv(to_image) @ rows[-1].reshape(3, 3) @ to_plane
    return np.asarray(matrix / np.linalg.norm(matrix))


def plane_orientations(vectors: FloatArray, points: FloatArray) -> PlaneOrientations:
    """Return the orientations from which points of a plane, anywhere in space, are seen.

    Parameters
    ----------
    vectors : array (n, 3)
        Image vectors u = (x, y, -C) of n >= 4 points.
    points : array (n, 3)
        Ground points in a plane, or nearly so; distances from their best-fitting plane are disregarded.

    Returns
    -------
    PlaneOrientations
        For exact data the first is right. For a small or distant object the other fits almost as well.

    Raises
    ------
    ValueError
        As `homography`.

    Notes
    -----
    At the points' centroid the derivative of the image is two rows and columns of the rotation over the distance, once
    the image is turned to that direction. Its larger singular value is one over the distance, and the third row follows
    except for its sign (Collins and Bartoli 2014).
    """
    centroid = points.mean(axis=0)
    axes = np.linalg.svd(points - centroid, full_matrices=False)[2]
    # right-handed: both in-plane axes and their normal, as columns
    axes = np.stack([axes[0], axes[1], np.cross(axes[0], axes[1])], axis=1)
    in_plane = (points - centroid) @ axes[:, :2]
    matrix = np.diag([1.0, 1.0, -1.0]) @ homography(in_plane, -vectors[:, :2] / vectors[:, 2:])
    matrix *= np.sign(matrix[:, 2] @ vectors.mean(axis=0)) / np.linalg.norm(matrix[:, 2])
    turn = _rotation_to_z(matrix[:, 2])
    by_plane = (turn @ matrix[:, :2])[:2]
    inverse_distance = float(np.linalg.svd(by_plane, compute_uv=False)[0])
    seen = np.stack([_completed(by_plane / inverse_distance, sign) for sign in (1.0, -1.0)])
    # the third row tells which of the two the homography itself is
    third = (turn @ matrix[:, :2])[2]
    seen = seen[np.argsort(-seen[:, 2, :2] @ third)]
    rotations = axes @ np.swapaxes(seen, 1, 2) @ turn
    return PlaneOrientations(rotations, centroid - rotations @ matrix[:, 2] / inverse_distance)


def _normalisation(xy: FloatArray) -> FloatArray:
    """Return the similarity (3, 3) that takes points to their centroid and to a mean distance of sqrt(2)."""
    centre = xy.mean(axis=0)
    scale = np.sqrt(2.0) / max(float(np.mean(np.linalg.norm(xy - centre, axis=1))), 1e-300)
    return np.array([[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]])


def _homogeneous(xy: FloatArray) -> FloatArray:
    return np.column_stack([xy, np.ones(len(xy))])


def _rotation_to_z(direction: FloatArray) -> FloatArray:
    """Return a rotation (3, 3) that takes a unit vector to the z axis."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction])


def _completed(part: FloatArray, sign: float) -> FloatArray:
    """Return the rotation (3, 3) with the given upper left part (2, 2); its third row has two signs."""
    squares = np.maximum(1.0 - np.sum(part**2, axis=0), 0.0)
    first = np.sqrt(squares[0])
    second = np.sqrt(squares[1])
    # the columns are perpendicular
    product = -float(part[:, 0] @ part[:, 1])
    third = sign * np.array([first, second if product >= 0.0 else -second])
    columns = np.vstack([part, third])
    u, _, v = np.linalg.svd(np.column_stack([columns, np.cross(columns[:, 0], columns[:, 1])]))
    return np.asarray(u @ v)
