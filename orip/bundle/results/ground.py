"""Adjusted photos and points in the project's coordinates, with precision; points that rays do not determine."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray, parts
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.units import DEGREES_PER_RADIAN

# A coordinate that is removed, such as the depth of a point with one ray, is a guess; so are the others, which follow
# from it along the ray. And where rays meet at an angle that is not significantly different from zero, a distance from
# the photos is computed, but it means nothing, nor does its standard deviation: any other one fits the same
# observations.

_ALONG = 1e-6
"""Component of a ray's unit vector above which a coordinate depends on the distance along the ray."""

_LEAST_SIGNIFICANCE = 2.0
"""Distance of a point from a photo, in standard deviations, below which it is not significant at the 5 % level."""


def undetermined_coordinates(solved: SolvedBlock, cofactors: FloatArray) -> BoolArray:
    """Return which local coordinates (number of points, 3) of the points are not determined; constants never.

    Parameters
    ----------
    cofactors : array (number of points, 3, 3)
        Of the local coordinates.
    """
    columns = solved.problem.unknowns.points
    unknown = columns != CONSTANT
    found = solved.is_undetermined(columns)
    of_found = np.asarray(found.any(axis=1))
    along = np.zeros_like(found)
    nearest = np.full(len(found), np.inf)
    for part in parts(len(solved.block.photo_points.photo)):
        point, direction = _rays(solved, part)
        distance = np.sqrt(direction**2 @ np.ones(3))
        np.minimum.at(nearest, point, distance)
        of_part = of_found[point]
        np.logical_or.at(along, point[of_part], np.abs(direction[of_part]) > _ALONG * distance[of_part, None])
    found |= unknown & along & of_found[:, None]
    # the points that may be too near to a photo for their precision, by a bound that is quick to compute
    size = solved.deviation_scale * np.sqrt(np.maximum(np.einsum("nii->n", cofactors), 0.0))
    doubtful = (nearest < _LEAST_SIGNIFICANCE * size) & ~found.any(axis=1)
    if doubtful.any():
        point, direction = _rays(solved, np.flatnonzero(doubtful[solved.block.photo_points.point]))
        significant = _significance(solved, cofactors[point], direction) >= _LEAST_SIGNIFICANCE
        doubtful[point[significant]] = False
        found[doubtful] = unknown[doubtful]
    return np.asarray(found)


def _rays(solved: SolvedBlock, rows: slice | IntArray) -> tuple[IntArray, FloatArray]:
    """Return the points (k,) of those photo points that take part, and where these are from the photos' centres (k, 3).

    `rows` are the photo points to look at.
    """
    points, state = solved.block.photo_points.of(rows), solved.state
    weight_x, weight_y = solved.weight_factors[: 2 * len(solved.block.photo_points.photo)].reshape(-1, 2)[rows].T
    rays = np.flatnonzero((weight_x != 0.0) | (weight_y != 0.0))
    return points.point[rays], state.points[points.point[rays]] - state.centres[points.photo[rays]]


def _significance(solved: SolvedBlock, cofactors: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the lengths of rays (k,) in standard deviations of their points along them."""
    squares = np.einsum("ni,ni->n", direction, direction)
    variance = np.einsum("ni,nij,nj->n", direction, cofactors, direction)
    with np.errstate(divide="ignore", invalid="ignore"):  # a point at a projection centre has no direction
        lengths = squares / (solved.deviation_scale * np.sqrt(np.maximum(variance, 0.0)))
    return np.asarray(np.nan_to_num(lengths, nan=0.0))


UNDETERMINED = np.inf
"""Standard deviation of what depends on an unknown that was removed."""

LEVEL_PHI = 0.001
"""Below this cosine of phi the deviations of omega and kappa mean nothing; those about the ground axes are given."""


class PhotoResults(NamedTuple):
    """Values and standard deviations (n, 6), ground unit and degrees, and whose rotations are about the axes (n,)."""

    values: FloatArray
    sd: FloatArray
    about_axes: BoolArray


class PointResults(NamedTuple):
    """Values and standard deviations (n, 3), ground unit, and correlation coefficients XY, XZ, YZ (n, 3)."""

    values: FloatArray
    sd: FloatArray
    correlations: FloatArray


def adjusted_points(solved: SolvedBlock) -> PointResults:
    """Return the points; a standard deviation is NaN for a constant and infinite for what was removed.

    A correlation is NaN where one of the two is constant or not determined.
    """
    local, columns, ground = solved.state.points, solved.problem.unknowns.points, solved.block.ground
    cofactors = _place_cofactors(solved, columns)
    undetermined = undetermined_coordinates(solved, cofactors)
    cofactors = ground.cofactors_to_project(local, cofactors)
    sd = _place_deviations(solved, columns, cofactors, undetermined)
    correlations = _place_correlations(cofactors, np.isfinite(sd))
    index = solved.block.point_index()
    for element in solved.block.constant_elements:
        if element.group == "POINT":
            sd[index[element.name], "XYZ".index(element.kind)] = np.nan
    return PointResults(ground.to_project(local), sd, correlations)


def adjusted_photos(solved: SolvedBlock) -> PhotoResults:
    """Return the photos; a standard deviation is NaN for a constant and infinite for what was removed."""
    state, ground = solved.state, solved.block.ground
    centres = ground.to_project(state.centres)
    angles = angles_from_rotation(ground.axes_at(centres) @ state.rotations)
    shown, about_axes = rotation_partials(solved)
    elements, cofactors, removed = (
        solved.problem.unknowns.elements,
        photo_cofactors(solved),
        undetermined_photos(solved),
    )
    of_centres = ground.cofactors_to_project(state.centres, cofactors[:, :3, :3])
    sd = np.hstack(
        [
            _place_deviations(solved, elements[:, :3], of_centres, removed[:, :3]),
            deviations(solved, solved.problem.unknowns.photos[:, 3:]),
        ]
    )
    turned = np.flatnonzero(~state.turned_by_angles)
    sd[turned, 3:] = _rotation_deviations(solved, cofactors[turned, 3:, 3:], shown[turned], removed[turned, 3:])
    sd[:, 3:] *= DEGREES_PER_RADIAN
    row_of = {record_key(photo.name): row for row, photo in enumerate(solved.block.photos)}
    for element in solved.block.constant_elements:
        if element.group == "PHOTO":
            sd[row_of[record_key(element.name)], PHOTO_PARAMETERS.index(element.kind)] = np.nan
    return PhotoResults(np.hstack([centres, angles * DEGREES_PER_RADIAN]), sd, about_axes)


def rotation_partials(solved: SolvedBlock) -> tuple[FloatArray, BoolArray]:
    """Return the partials (n, 3, 3) of the photos' omega, phi, kappa by their rotation unknowns, radians.

    Near phi = ±90 degrees they are those of rotations about the project's axes; the second array (n,) tells where.
    """
    state, ground = solved.state, solved.block.ground
    axes = ground.axes_at(ground.to_project(state.centres))
    angles = angles_from_rotation(axes @ state.rotations)
    by_angles = state.turned_by_angles
    level = ~by_angles & (np.abs(np.cos(angles[:, 1])) < LEVEL_PHI)
    partials = axes.copy()
    partials[~level] = angle_rates_from_axes_rotation(angles[~level]) @ axes[~level]
    partials[by_angles] = np.eye(3)
    return partials, level


def deviations(solved: SolvedBlock, columns: IntArray) -> FloatArray:
    """Return standard deviations of unknowns: NaN for constants, infinite for removed ones."""
    reduced = solved.problem.layout.reduced
    unknown, of_blocks = columns != CONSTANT, columns >= reduced
    block, place = np.divmod(columns[of_blocks] - reduced, 3)
    cofactor = np.full(columns.shape, np.nan)
    cofactor[unknown & ~of_blocks] = solved.cofactors.reduced.diagonal()[columns[unknown & ~of_blocks]]
    cofactor[of_blocks] = solved.cofactors.blocks[block, place, place]
    deviation = solved.deviation_scale * np.sqrt(np.maximum(cofactor, 0.0))
    deviation[solved.is_undetermined(columns)] = UNDETERMINED
    return np.asarray(deviation)


def photo_cofactors(solved: SolvedBlock) -> FloatArray:
    """Return the cofactors (n, 6, 6) of the elements of photos: local places, rotations; zero for constants."""
    unknowns = solved.problem.unknowns
    found = reduced_cofactors(solved, unknowns.photos)
    partials = solved.state.partials_of_rigs()
    if unknowns.rigs is not None and partials is not None:
        of_rigs = reduced_cofactors(solved, unknowns.rigs.of_photos)
        found[unknowns.rigs.photo] = partials @ of_rigs @ np.swapaxes(partials, 1, 2)
    return found


def undetermined_photos(solved: SolvedBlock) -> BoolArray:
    """Return which elements of photos (n, 6) depend on an unknown that was removed."""
    unknowns = solved.problem.unknowns
    found = solved.is_undetermined(unknowns.photos)
    partials = solved.state.partials_of_rigs()
    if unknowns.rigs is not None and partials is not None:
        removed = solved.is_undetermined(unknowns.rigs.of_photos)
        found[unknowns.rigs.photo] = ((partials != 0.0) & removed[:, None, :]).any(axis=2)
    return found


def _rotation_deviations(
    solved: SolvedBlock, cofactor: FloatArray, shown: FloatArray, removed: BoolArray
) -> FloatArray:
    """Return deviations (n, 3) of what is shown of photos' small rotations.

    `cofactor` (n, 3, 3) are those of the rotations, `shown` (n, 3, 3) their partials, `removed` (n, 3) marks those that
    nothing determines.
    """
    variance = np.einsum("nii->ni", shown @ cofactor @ shown.transpose(0, 2, 1))
    return np.where(removed, UNDETERMINED, solved.deviation_scale * np.sqrt(np.maximum(variance, 0.0)))


def photo_correlations(solved: SolvedBlock) -> FloatArray:
    """Return the correlation coefficients (n, 15) of X0, Y0, Z0, OMEGA, PHI, KAPPA: the lower triangle, row by row.

    Rotations are those of `photo_results`. NaN where one of the two is constant or not determined.
    """
    elements, centres = solved.problem.unknowns.elements, solved.state.centres
    partials = np.zeros((len(elements), 6, 6))
    partials[:, :3, :3] = solved.block.ground.project_with_partials(centres).by_local
    partials[:, 3:, 3:], _ = rotation_partials(solved)
    covariance = partials @ photo_cofactors(solved) @ partials.transpose(0, 2, 1)
    deviation = np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0.0))
    removed = undetermined_photos(solved)
    place = _place_deviations(solved, elements[:, :3], covariance[:, :3, :3], removed[:, :3])
    deviation[:, :3][~np.isfinite(place)] = np.nan
    deviation[removed[:, 3:].any(axis=1), 3:] = np.nan
    a, b = np.tril_indices(6, -1)
    with np.errstate(divide="ignore", invalid="ignore"):  # what is exactly known has no correlation
        return np.asarray(covariance[:, a, b] / (deviation[:, a] * deviation[:, b]))


def _place_correlations(cofactors: FloatArray, determined: BoolArray) -> FloatArray:
    """Return the correlation coefficients XY, XZ, YZ (n, 3) of places with these cofactors (n, 3, 3).

    NaN where one of the two coordinates is not `determined` (n, 3).
    """
    deviation = np.sqrt(np.maximum(np.einsum("nii->ni", cofactors), 0.0))
    deviation[~determined] = np.nan
    a, b = [0, 0, 1], [1, 2, 2]
    with np.errstate(divide="ignore", invalid="ignore"):  # what is exactly known has no correlation
        return np.asarray(cofactors[:, a, b] / (deviation[:, a] * deviation[:, b]))


def undetermined_points(solved: SolvedBlock) -> BoolArray:
    """Return which local coordinates (number of points, 3) of the points are not determined."""
    return undetermined_coordinates(solved, _place_cofactors(solved, solved.problem.unknowns.points))


def _place_deviations(
    solved: SolvedBlock, columns: IntArray, cofactors: FloatArray, undetermined: BoolArray
) -> FloatArray:
    """Return standard deviations (n, 3) of the project's coordinates of places with unknowns at `columns` (n, 3).

    `cofactors` (n, 3, 3) are those of the project's coordinates; `undetermined` (n, 3) marks local coordinates that are
    not determined.
    """
    ground = solved.block.ground
    variance = np.einsum("nii->ni", cofactors)
    deviation = solved.deviation_scale * np.sqrt(np.maximum(variance, 0.0))
    deviation[undetermined @ ground.dependence.T] = UNDETERMINED
    deviation[~((columns != CONSTANT) @ ground.dependence.T)] = np.nan
    return np.asarray(deviation)


def _place_cofactors(solved: SolvedBlock, columns: IntArray) -> FloatArray:
    """Return the cofactors (n, 3, 3) of places, each with its unknowns in the reduced system or in a block of its own.

    Rows and columns of constants are zero.
    """
    first_of_blocks = solved.problem.layout.reduced
    last = columns.max(axis=1, initial=CONSTANT)
    eliminated = last >= first_of_blocks
    if eliminated.all():  # the points, mostly
        return np.asarray(solved.cofactors.blocks[(last - first_of_blocks) // 3])
    result = np.zeros((len(columns), 3, 3))
    result[eliminated] = solved.cofactors.blocks[(last[eliminated] - first_of_blocks) // 3]
    reduced = (last != CONSTANT) & ~eliminated
    result[reduced] = reduced_cofactors(solved, columns[reduced])
    return result


def reduced_cofactors(solved: SolvedBlock, columns: IntArray) -> FloatArray:
    """Return the cofactors (n, k, k) of unknowns of the reduced system at `columns` (n, k); zero for constants."""
    unknown = columns != CONSTANT
    if not unknown.any():
        return np.zeros((*columns.shape, columns.shape[1]))
    # a constant stands for any other unknown of its row: not all others have a cofactor with these
    mine = np.where(unknown, columns, np.maximum(columns.max(axis=1, keepdims=True), 0))
    found = solved.cofactors.reduced[mine[:, :, None], mine[:, None, :]]
    return np.asarray(np.where(unknown[:, :, None] & unknown[:, None, :], found, 0.0))
