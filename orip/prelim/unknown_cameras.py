"""Cameras of which next to nothing is known: direct linear transformation, and the route by control."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.prelim.block_grower import BlockGrower
from orip.prelim.refinement import no_corrections
from orip.prelim.resection.resection import Unresected
from orip.prelim.routes import Route, control_start
from orip.structs import replace
from orip.wording import counted

POINTS_NEEDED = 6
"""Eleven parameters, two equations a point."""

_FLAT = 0.05
"""Thickness over length of the known points below which errors of measurement decide on the principal distance."""

_UNDETERMINED = 1e-9
"""Ratio of singular values below which a second set of parameters fits as well."""


class DirectLinear(Struct, frozen=True):
    """A photo, and the camera that took it, without distortion.

    Parameters
    ----------
    principal_distance : float
        mm; the mean of those in x and in y.
    principal_point : array (2,)
        mm.
    rotation : array (3, 3)
        Photo to ground.
    centre : array (3,)
        Ground units.
    """

    principal_distance: float
    principal_point: FloatArray
    rotation: FloatArray
    centre: FloatArray


def direct_linear(xy: FloatArray, points: FloatArray) -> DirectLinear | Unresected:
    """Orient a photo of an unknown camera by known points in space, all of them right.

    Parameters
    ----------
    xy : array (n, 2)
        Photo coordinates freed of distortion, mm.
    points : array (n, 3)
        Ground coordinates.

    Returns
    -------
    DirectLinear or Unresected
        The latter for fewer than six points, for points in one plane, and for other sets that leave the eleven
        parameters undetermined (they lie with the projection centre on a twisted cubic).

    Notes
    -----
    Abdel-Aziz and Karara (1971); solved by singular value decomposition of coordinates from their centroids and in
    units of their spread (Hartley 1997). The 3 x 4 matrix is decomposed to the matrix of the camera, the rotation and
    the centre by an RQ decomposition (Hartley and Zisserman 2004, section 6.2). Affinity and shear, which a camera
    seldom has, are estimated with the others, and dropped.
    """
    count = len(points)
    if count < POINTS_NEEDED:
        known = counted(count, "known point")
        return Unresected(f"{known} in the photo, a direct linear transformation needs {POINTS_NEEDED}")
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if extent[2] < _FLAT * extent[0]:
        return Unresected(
            f"the {count} known points lie nearly in one plane, and do not determine the principal distance"
        )
    to_image, to_space = _normalisation(xy), _normalisation(points)
    x, y = (np.column_stack([xy, np.ones(count)]) @ to_image.T)[:, :2].T
    space = np.column_stack([points, np.ones(count)]) @ to_space.T
    nothing = np.zeros_like(space)
    design = np.concatenate(
        [np.hstack([space, nothing, -x[:, None] * space]), np.hstack([nothing, space, -y[:, None] * space])]
    )
    _, values, rows = np.linalg.svd(design, full_matrices=True)
    if values[10] < _UNDETERMINED * values[0]:
        return Unresected(f"the {count} known points lie on a curve on which they do not determine the camera")
    return _decomposed(np.linalg.solve(to_image, rows[11].reshape(3, 4) @ to_space), points)


def _normalisation(coordinates: FloatArray) -> FloatArray:
    """Return the matrix that takes homogeneous coordinates to their centroid and to unit spread."""
    size = coordinates.shape[1]
    middle = coordinates.mean(axis=0)
    scale = 1.0 / np.sqrt(((coordinates - middle) ** 2).mean())
    matrix = np.eye(size + 1)
    matrix[:size, :size] *= scale
    matrix[:size, size] = -scale * middle
    return matrix


def _decomposed(projection: FloatArray, points: FloatArray) -> DirectLinear | Unresected:
    """Return camera, rotation and centre of a 3 x 4 matrix of any scale and sign."""
    left = projection[:, :3] * np.sign(np.linalg.det(projection[:, :3]))
    centre = -np.linalg.solve(projection[:, :3], projection[:, 3])
    across, below = np.linalg.qr(left[::-1].T)
    camera, rotation = below.T[::-1, ::-1], across.T[::-1]
    # x = x0 - C u1 / u3 with u3 < 0 in front: the first two diagonal elements are negative, the third is positive
    signs = np.sign(camera.diagonal()) * [-1.0, -1.0, 1.0]
    camera, rotation = camera * signs / abs(camera[2, 2]), signs[:, None] * rotation
    depth = (points - centre) @ rotation[2]
    if (depth >= 0.0).any():
        return Unresected("no camera shows the known points as measured: some would lie behind it; check point numbers")
    return DirectLinear(
        float(-(camera[0, 0] + camera[1, 1]) / 2.0),
        np.asarray(camera[:2, 2]),
        np.asarray(rotation.T),
        np.asarray(centre),
    )


def by_unknown_cameras(grower: BlockGrower) -> Route:
    """Go by resection with the cameras that photos of six control points in space show; `grower` holds the control.

    A camera is corrected by the median of its photos, in principal distance and principal point as far as they are
    unknown.
    """
    corrections = _corrections(grower)
    if not corrections.any():
        return Route(())
    start = replace(control_start(grower), corrections=corrections)
    return Route((grower.grow(start),), on_ground=True)


def _corrections(grower: BlockGrower) -> FloatArray:
    """Return corrections (cameras, 4) as `orip.prelim.refinement` has them."""
    rays, corrections = grower.rays, no_corrections(grower.rays)
    for camera, unknown in enumerate(rays.cameras.unknown):
        shown: list[tuple[float, float, float]] = []
        for photo in np.flatnonzero(rays.cameras.of_photo == camera):
            rows = grower.index.rows[photo][grower.held_points[grower.index.points[photo]]]
            found = direct_linear(rays.vectors[rows, :2], grower.held[rays.point[rows]])
            if isinstance(found, DirectLinear):
                given = float(-rays.vectors[rows[0], 2])
                x, y = found.principal_point
                shown.append((np.log(found.principal_distance / given), -x / given, -y / given))
        if shown:
            corrections[camera, :3] = np.where(unknown[:3], np.median(shown, axis=0), 0.0)
    return corrections
