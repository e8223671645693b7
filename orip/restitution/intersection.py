"""Vertices from stereo measurements in an adjusted block, with all that their standard deviations are made of.

A vertex is the place with the least square sum of image residuals over their a-priori errors in its two photos. With
the image equations of the adjustment, J their partials by the vertex, B those by orientations and cameras, Q the
cofactors of these, S the a-priori covariances of the measurement and W the inverse of S:

    K = (Jᵀ W J)⁻¹ Jᵀ W         dX = −K v         cov X = sigma0² K (S + B Q Bᵀ) Kᵀ

Q has the correlations of both photos with each other and with their cameras (Mikhail, Bethel and McGlone 2001, chapter
5; the covariance law). n, the left null vector of J, gives what of the four residuals no place of the vertex removes:

    w = |nᵀ v| / (sigma0 sqrt(nᵀ (S + B Q Bᵀ) n))
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.kinds.photo_point import POINT_PARTIALS, PhotoPointObservations, observe_photo_points
from orip.bundle.results.covariance import cofactor_columns
from orip.bundle.rigs.starting import chained
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.geometry.projection import PROJECTIONS
from orip.geometry.rotation import rotated
from orip.geometry.stereo import PARALLEL, axes_of_model, meeting, y_parallax
from orip.interior.additional_parameters import PARAMETER_SETS, base_of_camera
from orip.interior.distortion import image_polynomial
from orip.interior.image_coordinates import ImageEquation
from orip.records.block import IndexedPhotoPoints
from orip.records.camera import READOUT
from orip.structs import replace

_ITERATIONS = 10
_SETTLED = 1e-10
"""Of the distance to the vertex."""


class StereoMarks(NamedTuple):
    """n vertices measured in two photos each: places of the photos in the block, photo coordinates and errors (mm).

    Attributes
    ----------
    left, right : arrays (n,) of int
    xy, error : arrays (n, 2, 2)
        Left and right, x and y.
    """

    left: IntArray
    right: IntArray
    xy: FloatArray
    error: FloatArray


class Intersected(NamedTuple):
    """n vertices; NaN throughout where the rays are parallel, meet behind a camera, or have no direction.

    Attributes
    ----------
    xyz : array (n, 3)
        Ground units, in the project.
    covariance : array (n, 3, 3)
        Ground units squared, in the project.
    y_parallax : array (n,)
        mm in the photo.
    w : array (n,)
        The y-parallax over its standard deviation.
    """

    xyz: FloatArray
    covariance: FloatArray
    y_parallax: FloatArray
    w: FloatArray


def intersect(solved: SolvedBlock, marks: StereoMarks) -> Intersected:
    """Return the vertices that were measured."""
    count = len(marks.left)
    start, parallax = _where_rays_meet(solved, marks)
    local, covariance, w = start.copy(), np.full((count, 3, 3), np.nan), np.full(count, np.nan)
    known = np.isfinite(start).all(axis=1)
    for pair in sorted({*zip(marks.left[known].tolist(), marks.right[known].tolist(), strict=True)}):
        rows = np.flatnonzero(known & (marks.left == pair[0]) & (marks.right == pair[1]))
        mine = StereoMarks(marks.left[rows], marks.right[rows], marks.xy[rows], marks.error[rows])
        local[rows], covariance[rows], w[rows] = _of_one_model(solved, mine, start[rows])
    ground = solved.block.ground
    xyz = np.full((count, 3), np.nan)
    if known.any():
        projected = ground.project_with_partials(local[known])
        xyz[known] = projected.value
        covariance[known] = projected.by_local @ covariance[known] @ np.swapaxes(projected.by_local, 1, 2)
    bad = ~np.isfinite(xyz).all(axis=1)
    parallax[bad] = w[bad] = np.nan
    return Intersected(xyz, covariance, parallax, w)


def _observed(solved: SolvedBlock, marks: StereoMarks) -> PhotoPointObservations:
    """Return the 2 n photo points of n vertices as observations, left and right of each in turn."""
    count = len(marks.left)
    photo = np.stack([marks.left, marks.right], axis=1).ravel()
    xy, error = marks.xy.reshape(-1, 2), marks.error.reshape(-1, 2)
    points = IndexedPhotoPoints(photo, np.repeat(np.arange(count), 2), xy, error, np.ones(xy.shape, dtype=bool))
    definition = replace(solved.block.definition, repeated_points="mean")
    block = replace(solved.block, definition=definition, photo_points=points, point_names=tuple(map(str, range(count))))
    return observe_photo_points(block, solved.problem.unknowns)


def _directions(solved: SolvedBlock, photo: int, xy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the directions of rays, each array (n,), of photo coordinates (n, 2); NaN where there are none."""
    state, row = solved.state, int(solved.block.photo_camera[photo])
    camera, (c, x0, y0, *coefficients) = solved.block.cameras[row], state.cameras[row, :READOUT].tolist()
    additional = None
    if camera.additional_set is not None:
        count = len(PARAMETER_SETS[camera.additional_set].parameter_names)
        values = state.additional[row, :count]
        additional = image_polynomial(camera.additional_set, base_of_camera(camera), values)
    image = ImageEquation(x0, y0, tuple(coefficients), camera.distortion_at == "measured", additional)
    with np.errstate(all="ignore"):  # what has no ideal coordinates is NaN
        ideal = image.ideal(*np.ascontiguousarray(xy.T))
        vector = PROJECTIONS[camera.projection].image_vector(c, *ideal)
        return rotated(tuple(state.rotations[photo].ravel().tolist()), *vector)


def _where_rays_meet(solved: SolvedBlock, marks: StereoMarks) -> tuple[FloatArray, FloatArray]:
    """Return where rays come nearest (n, 3), local, and their y-parallax (n,) in mm; NaN where they do not."""
    state, camera = solved.state, solved.block.photo_camera
    places, parallax = np.full((len(marks.xy), 3), np.nan), np.full(len(marks.xy), np.nan)
    for pair in sorted({*zip(marks.left.tolist(), marks.right.tolist(), strict=True)}):
        rows = np.flatnonzero((marks.left == pair[0]) & (marks.right == pair[1]))
        left, right = (_directions(solved, photo, marks.xy[rows, side]) for side, photo in enumerate(pair))
        start, end = state.centres[list(pair)]
        axes = axes_of_model(start, end, *state.rotations[list(pair), :, 2])
        if axes is None:
            continue
        found = meeting(tuple(start.tolist()), tuple(end.tolist()), left, right)
        sound = (found.sine_square > PARALLEL) & (found.along_left > 0.0) & (found.along_right > 0.0)
        c = float(np.mean(state.cameras[camera[list(pair)], 0]))
        places[rows] = np.where(sound[:, None], np.stack(found.middle, axis=1), np.nan)
        parallax[rows] = y_parallax(tuple(axes.ravel().tolist()), c, left, right)
    return places, parallax


def _of_one_model(
    solved: SolvedBlock, marks: StereoMarks, start: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places (n, 3), local, their covariances (n, 3, 3) and w (n,) of vertices of one pair of photos."""
    count, observed = len(start), _observed(solved, marks)
    weights = 1.0 / marks.error.reshape(count, 4) ** 2
    places = start
    for _ in range(_ITERATIONS):
        residual, partials = _linearised(solved, observed, places)
        by_point = partials[:, :, POINT_PARTIALS]
        normals = np.swapaxes(by_point, 1, 2) @ (weights[:, :, None] * by_point)
        gain = np.linalg.solve(normals, np.swapaxes(by_point, 1, 2) * weights[:, None, :])
        step = (gain @ residual[:, :, None])[:, :, 0]
        places = places - step
        distance = np.linalg.norm(places - solved.state.centres[marks.left[0]], axis=1)
        if (np.linalg.norm(step, axis=1) <= _SETTLED * distance).all():
            break
    residual, partials = _linearised(solved, observed, places)
    measured = np.einsum("ni,ij->nij", 1.0 / weights, np.eye(4)) + _of_orientations(solved, observed, partials)
    measured *= solved.deviation_scale**2
    by_point = partials[:, :, POINT_PARTIALS]
    null = np.linalg.svd(by_point)[0][:, :, 3]
    variance = np.einsum("ni,nij,nj->n", null, measured, null)
    w = np.abs(np.einsum("ni,ni->n", null, residual)) / np.sqrt(variance)
    return places, gain @ measured @ np.swapaxes(gain, 1, 2), w


def _linearised(
    solved: SolvedBlock, observed: PhotoPointObservations, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return residuals (n, 4) and partials (n, 4, k) of vertices at places (n, 3)."""
    found = observed.linearise_with_partials(replace(solved.state, points=places))
    return found.residual.reshape(-1, 4), found.partials.reshape(len(places), 4, -1)


def _of_orientations(solved: SolvedBlock, observed: PhotoPointObservations, partials: FloatArray) -> FloatArray:
    """Return B Q Bᵀ (n, 4, 4), mm²: what the cofactors of both photos and their cameras contribute."""
    kept = [place for place in range(partials.shape[2]) if not POINT_PARTIALS.start <= place < POINT_PARTIALS.stop]
    count = len(partials)
    of_all, columns_of_all = chained(
        partials[:, :, kept].reshape(4 * count, -1), np.tile(_columns(observed), (count, 1)),
        solved.problem.unknowns.rigs, solved.state.partials_of_rigs(),
    )  # fmt: skip
    columns, partials = columns_of_all[:4], of_all.reshape(count, 4, -1)
    unknowns = np.unique(columns[columns != CONSTANT])
    if not len(unknowns):
        return np.zeros((count, 4, 4))
    cofactors = cofactor_columns(solved, unknowns)[unknowns]
    by_unknown = np.zeros((count, 4, len(unknowns)))
    for row in range(4):
        for place, column in enumerate(columns[row].tolist()):
            if column != CONSTANT:
                by_unknown[:, row, np.searchsorted(unknowns, column)] += partials[:, row, place]
    return np.asarray(by_unknown @ cofactors @ np.swapaxes(by_unknown, 1, 2))


def _columns(observed: PhotoPointObservations) -> IntArray:
    """Return the columns (4, k) of elements and camera unknowns, of the equations of a vertex of the two photos."""
    tables, pair = observed.unknowns, slice(0, 2)
    of_photos: Sequence[IntArray] = (
        tables.cameras[observed.camera[pair]], tables.elements[observed.photo[pair]],
        tables.additional[observed.camera[pair]],
    )  # fmt: skip
    return np.repeat(np.concatenate(of_photos, axis=1), 2, axis=0)
