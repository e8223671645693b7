"""Observations that an adjustment down-weighted or left out, and the rays of its photos without regard to control."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.results.covariance import predict_photo_coordinates
from orip.geometry.rays import intersect_rays
from orip.geometry.rotation import rotation_from_angles
from orip.interior.image_coordinates import image_vectors
from orip.mistakes.hypothesis import Fit
from orip.records.block import Block
from orip.records.coded_names import coded
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

_ERRORS = 5.0
"""Standard errors within which a photo point is the image of a position."""


class AdjustedRays:
    """The rays of a block's photo points with adjusted cameras and orientations.

    Rows are those of `Block.photo_points`.

    Parameters
    ----------
    block : Block
        As gathered.
    solution : Solution
    """

    def __init__(self, block: Block, solution: Solution) -> None:
        self.block, self.solution = block, solution
        self._centres = block.ground.to_local(solution.photos.values[:, :3])
        rotations = rotation_from_angles(solution.photos.values[:, 3:] * RADIANS_PER_DEGREE)
        axes = block.ground.axes_at(solution.photos.values[:, :3])
        self._rotations = np.swapaxes(axes, 1, 2) @ rotations

    @cached_property
    def _vectors(self) -> FloatArray:
        """Return the image vectors (n, 3); of a sound block no ray is asked for."""
        cameras = tuple(
            replace(camera, parameters=tuple(values))
            for camera, values in zip(self.block.cameras, self.solution.cameras.values.tolist(), strict=True)
        )
        return image_vectors(replace(self.block, cameras=cameras))

    def limit(self, row: int) -> float:
        """Return how far (mm) a photo point may be from the image of a position and still show it."""
        return float(_ERRORS * max(1.0, self.solution.sigma0) * self.block.photo_points.error[row].max())

    def distances(self, row: int, xyz: FloatArray) -> FloatArray:
        """Return the distances (n,), mm, of a photo point from the images of positions (n, 3); NaN behind the photo."""
        photo = int(self.block.photo_points.photo[row])
        camera = self.block.cameras[self.block.photo_camera[photo]]
        name = self.block.photos[photo].name
        xy = predict_photo_coordinates(self.solution, name, camera, xyz, self.block.ground)
        return np.asarray(np.linalg.norm(xy - self.block.photo_points.xy[row], axis=1))

    def meeting(self, rows: Sequence[int] | IntArray) -> tuple[FloatArray, FloatArray] | None:
        """Return where the rays of photo points meet (3,) and its standard deviations (3,); None where they do not."""
        chosen = np.asarray(rows, dtype=np.int64)
        photos = self.block.photo_points.photo[chosen]
        directions = (self._rotations[photos] @ self._vectors[chosen][:, :, None])[:, :, 0]
        if not np.isfinite(directions).all():  # distortion cannot be removed so far from the frame
            return None
        index = np.zeros(len(chosen), dtype=np.int64)
        position = intersect_rays(self._centres[photos], directions, index, 1)
        if not np.isfinite(position).all():
            return None
        xyz = self.block.ground.to_project(position)
        if not all(bool(self.distances(row, xyz)[0] <= self.limit(row)) for row in chosen.tolist()):
            return None
        return xyz[0], self._deviations(chosen, position[0], directions)

    def _deviations(self, rows: IntArray, position: FloatArray, directions: FloatArray) -> FloatArray:
        """Return standard deviations (3,) of a position from the errors of its photo points."""
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        distance = np.linalg.norm(position - self._centres[self.block.photo_points.photo[rows]], axis=1)
        # error of the photo point across its ray, at the distance of the position
        across = (
            self.block.photo_points.error[rows].max(axis=1) * distance / np.linalg.norm(self._vectors[rows], axis=1)
        )
        normals = ((np.eye(3) - unit[:, :, None] * unit[:, None, :]) / across[:, None, None] ** 2).sum(axis=0)
        return np.asarray(max(1.0, self.solution.sigma0) * np.sqrt(np.diag(np.linalg.pinv(normals))))


_DOUBTED = 0.5
"""Weight factor below which an observation hardly influenced the result."""

_PICTURE = 0.01
"""Mean square of the residuals, as a part of the variance of the photo coordinates, above which the photos are not of
these points: residuals are a tenth of the coordinates."""

_FAR_OFF = 1e6
"""Largest standard residual that is counted in full; those of points behind their photo are infinite."""


def doubted_photo_points(block: Block, solution: Solution) -> IntArray:
    """Return the rows (k,) of `Block.photo_points` that an adjustment doubts, or could not compute."""
    weights = solution.residuals.weight_factor[coded(solution.residuals.kind).where("photo".__eq__)]
    of_x, of_y = weights[::2], weights[1::2]
    lost = block.photo_points.in_use & (np.isnan(of_x) | np.isnan(of_y))
    return np.flatnonzero((of_x < _DOUBTED) | (of_y < _DOUBTED) | lost)


def doubted_control(solution: Solution) -> set[str]:
    """Return the names of control points that an adjustment doubts."""
    rows = solution.residuals
    doubted = coded(rows.kind).where("control".__eq__) & (rows.weight_factor < _DOUBTED)
    return set(coded(rows.point)[doubted].occurring())


def down_weighted_share(solution: Solution, kind: str) -> float:
    """Return the part of the observations of a kind in use that has lost weight."""
    weights = solution.residuals.weight_factor[coded(solution.residuals.kind).where(kind.__eq__)]
    weights = weights[~np.isnan(weights)]
    return float(np.mean(weights < 1.0)) if len(weights) else 0.0


def is_in_the_picture(solution: Solution) -> bool:
    """Tell whether residuals are so large that the photos cannot be of these points."""
    rows = solution.residuals
    photo = coded(rows.kind).where("photo".__eq__)
    left_out = float(np.isnan(rows.weight_factor[photo]).mean())
    mean_square, variance = float(np.mean(rows.residual[photo] ** 2)), float(np.var(rows.observed[photo]))
    return left_out > _PICTURE or mean_square > _PICTURE * variance


def photos_by_misfit(fit: Fit) -> list[str]:
    """Return the photos by the mean square of their standard residuals, the worst first."""
    return _by_misfit(fit, 1)


def points_by_misfit(fit: Fit) -> list[str]:
    """Return the points by the mean square of the standard residuals of their photo points, the worst first."""
    return _by_misfit(fit, 2)


def _by_misfit(fit: Fit, column: int) -> list[str]:
    squares: dict[str, list[float]] = {}
    for kind, name, standard in zip(fit.columns[0], fit.columns[column], fit.standard.tolist(), strict=True):
        if kind == "photo":
            squares.setdefault(name, []).append(min(standard, _FAR_OFF) ** 2)
    return sorted(squares, key=lambda name: -float(np.mean(squares[name])))
