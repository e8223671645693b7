"""The homography between a plane in space and its image, and the orientations of the photo that follow from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray


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
