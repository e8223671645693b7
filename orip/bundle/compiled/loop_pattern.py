"""How photo points go into the normal equations of a block: what the compiled loop needs of cameras and points."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, distinct
from orip.bundle.compiled.point_groups import groups_of_sets, sets_of_photos
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.interior.additional_parameters import PARAMETER_SETS, basis_by_powers

IntArray = NDArray[np.int32]

_CAMERA_PARAMETERS, _FIRST_ADDITIONAL = 12, 21
_MOST_ADDITIONAL, _POLYNOMIALS, _FORMS = 44, 5, 4


class Cameras(Struct, frozen=True):
    """Constants of c cameras.

    Parameters
    ----------
    kind : array (c,) of int
        Its form; each camera with a set is a kind of its own.
    products : array (c, 2, 44) of int
        Of the parameters of a camera's set in dx and dy: number of B_i(y) times 5, plus that of A_j(x).
    polynomials : array (c, 5, 5)
        A_j by powers of its argument.
    factors : array (c, 2, 44)
    form : array (c,) of int
        1: the polynomial is at measured coordinates, 2: the projection is equidistant, 3: both.
    unknowns : array (c,) of int
        Their number.
    elements, columns : arrays (c, 56) of int
        For each unknown its number among the partials, and its column.
    """

    kind: IntArray
    products: IntArray
    polynomials: FloatArray
    factors: FloatArray
    form: NDArray[np.uint8]
    unknowns: IntArray
    elements: IntArray
    columns: IntArray


class Pattern(Struct, frozen=True):
    """How the photo points of eliminated points go into the normal equations, group by group.

    A group consists of points that are measured in the same photos, or in nearly the same; see `point_groups`. A run is
    the unknowns of a camera, given by its number, or of a photo, given by its number plus c.

    Parameters
    ----------
    order, start : arrays (k,), (b + 1,)
        Rows of the photo points, one point after the other, and where those of each point begin.
    block : array (b,)
        Number of each of these points among the eliminated ones.
    group_start : array (g + 1,)
        Where each group's points begin.
    runs_start, runs : arrays (g + 1,), (l,)
        Where each group's runs begin, and the runs that its points are coupled with.
    coupled_start, coupled : arrays (s + 1,), (q,)
        The same for each set of photos that show a point: its runs are coupled with each other.
    """

    order: IntArray
    start: IntArray
    block: IntArray
    group_start: IntArray
    runs_start: IntArray
    runs: IntArray
    coupled_start: IntArray
    coupled: IntArray


def pattern_of_loop(
    photo: NDArray[np.int64], block: NDArray[np.int32], coordinates: FloatArray, camera_of_photo: IntArray, cameras: int
) -> Pattern:
    """Return the pattern of photo points in photos (n,) of points of block numbers (n,), negative: not eliminated.

    `coordinates` (b, 3) are those of the eliminated points, roughly: see `groups_of_sets`.
    """
    order = np.flatnonzero(block >= 0)
    order = order[np.argsort(block[order] * np.int64(len(camera_of_photo)) + photo[order], kind="stable")]
    start = np.append(0, np.cumsum(np.bincount(block[order], minlength=len(coordinates))))
    sets = sets_of_photos(photo[order].astype(np.int32), start)
    of_point, group_of_set = sets.of_point, groups_of_sets(sets, coordinates)
    group = group_of_set[of_point]
    by_group = np.lexsort((of_point, group))
    counts = np.diff(start)[by_group]
    ends = np.cumsum(counts)
    order = order[np.arange(len(order)) + np.repeat(start[by_group] - ends + counts, counts)]
    group_start = np.searchsorted(group[by_group], np.arange(group.max(initial=-1) + 2))

    runs_start, runs = _runs(group_of_set[sets.number], sets.photo, camera_of_photo, cameras)
    coupled = _runs(sets.number, sets.photo, camera_of_photo, cameras)
    small = (order, np.append(0, ends), by_group, group_start, runs_start, runs, *coupled)
    return Pattern(*(array.astype(np.int32) for array in small))


def _runs(
    number: NDArray[np.int64], photo: NDArray[np.int64], camera_of_photo: IntArray, cameras: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where the runs of each number begin and the runs, cameras first, of pairs of a number and a photo."""
    every = cameras + len(camera_of_photo)
    keys = distinct(np.concatenate([every * number + camera_of_photo[photo], every * number + cameras + photo]))
    of_number, runs = np.divmod(keys, every)
    return np.append(0, np.cumsum(np.bincount(of_number, minlength=int(number.max(initial=-1)) + 1))), runs


def blocks_of_points(unknowns: Unknowns) -> NDArray[np.int64]:
    """Return the number of each point's eliminated block, -1 for points that stay in the reduced system."""
    first = unknowns.points.max(axis=1, initial=CONSTANT) - unknowns.layout.reduced
    block = np.where(first >= 0, first // 3, -1)
    # a constant point has no column from which its block follows; any block without unknowns will do
    constant = np.flatnonzero((unknowns.points == CONSTANT).all(axis=1))
    is_taken = np.zeros(unknowns.layout.blocks, dtype=bool)
    is_taken[block[block >= 0]] = True
    free = np.flatnonzero(~is_taken)
    block[constant[: len(free)]] = free
    return np.asarray(block)


def cameras_of_loop(points: PhotoPointObservations, unknowns: Unknowns) -> Cameras:
    """Return the constants of the cameras of a block."""
    count, additional = unknowns.additional.shape
    form = np.zeros(count, dtype=np.uint8)
    form[points.camera] = points.at_measured + 2 * points.is_equidistant.astype(np.uint8)
    kind = form.astype(np.int32)
    products = np.zeros((count, 2, _MOST_ADDITIONAL), dtype=np.int32)
    factors = np.zeros((count, 2, _MOST_ADDITIONAL))
    polynomials = np.zeros((count, _POLYNOMIALS, _POLYNOMIALS))
    for camera, name, base in points.sets:
        kind[camera] = _FORMS + camera
        table = PARAMETER_SETS[name].factors
        degree, parameters = table.shape[-1], table.shape[1]
        # each parameter has at most one product in dx and one in dy
        products_of_set = np.abs(table).reshape(2, parameters, -1).argmax(axis=2)
        products[camera, :, :parameters] = products_of_set // degree * _POLYNOMIALS + products_of_set % degree
        factors[camera, :, :parameters] = table.sum(axis=(2, 3))
        polynomials[camera, :degree, :degree] = (basis_by_powers(name, base) / base ** np.arange(degree)[:, None]).T
    columns = np.hstack([unknowns.cameras, unknowns.additional])
    numbers = np.append(np.arange(_CAMERA_PARAMETERS), _FIRST_ADDITIONAL + np.arange(additional))
    is_unknown = columns != CONSTANT
    first = np.argsort(~is_unknown, axis=1, kind="stable")
    room = (count, _CAMERA_PARAMETERS + _MOST_ADDITIONAL)
    elements, placed = np.zeros(room, dtype=np.int32), np.full(room, CONSTANT, dtype=np.int32)
    elements[:, : columns.shape[1]] = numbers[first]
    placed[:, : columns.shape[1]] = np.take_along_axis(columns, first, axis=1)
    number = is_unknown.sum(axis=1).astype(np.int32)
    return Cameras(kind, products, polynomials, factors, form, number, elements, placed)
