"""How photo points go into the normal equations of a block, and which points are eliminated together."""

from __future__ import annotations

from itertools import count
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray, distinct
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.interior.additional_parameters import PARAMETER_SETS, basis_by_powers

# The normal equations of a group are formed in a small matrix of the group's own unknowns, which is then added to the
# reduced system. Points of the same photos share it without any loss. Where a point is seen by many photos no two of
# them have quite the same ones: then neighbours share the matrix of all their photos.

_OF_A_GROUP = 8.0
"""Time of clearing an element of a group's matrix and adding it to the reduced system, over that of eliminating a point
from it."""

_GIVEN_UP = 2.0
"""Where half of the row as one group takes so many times as long as in groups, no larger part of it is tried."""


class PhotoSets(NamedTuple):
    """The s different sets of photos that show b points, numbered in the order of their first points.

    Attributes
    ----------
    of_point : array (b,) of int
        Set of each point.
    first : array (s,) of int
        First point of each set.
    number, photo : arrays (r,) of int
        The pairs of a set and a photo in it, ascending.
    """

    of_point: IntArray
    first: IntArray
    number: IntArray
    photo: IntArray


def sets_of_photos(photo: NDArray[np.int32], start: IntArray) -> PhotoSets:
    """Return the sets of photos that show points.

    Parameters
    ----------
    photo : array (k,) of int
        Photos of the rays, ascending for each point.
    start : array (b + 1,) of int
        Where the rays of each point begin.
    """
    rays = np.diff(start)
    for attempt in count(1):
        sums = np.append(np.uint64(0), np.cumsum(_mixed(photo.astype(np.uint64), attempt)))
        _, first, of_point = np.unique(sums[start[1:]] - sums[start[:-1]], return_index=True, return_inverse=True)
        like = first[of_point]
        shift = np.repeat(start[:-1][like] - start[:-1], rays)
        if (rays == rays[like]).all() and np.array_equal(photo, photo[shift + np.arange(len(photo))]):
            break  # nearly always: two sets have the same sum once in 10^19 pairs
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    first = first[order]
    number = np.repeat(np.arange(len(first)), rays[first])
    of_set = np.repeat(start[:-1][first] - np.cumsum(rays[first]) + rays[first], rays[first]) + np.arange(len(number))
    every = int(photo.max(initial=0)) + 1
    return PhotoSets(place[of_point], first, *np.divmod(distinct(number * every + photo[of_set]), every))


def _mixed(number: NDArray[np.uint64], attempt: int) -> NDArray[np.uint64]:
    """Return numbers that look random, equal ones for equal ones (the finaliser of SplitMix64, Steele et al. 2014)."""
    mixed = (number + np.uint64(1)) * np.uint64(2 * attempt + 0x9E3779B97F4A7C13)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mixed ^ (mixed >> np.uint64(31))


def groups_of_sets(sets: PhotoSets, coordinates: FloatArray) -> IntArray:
    """Return the number of each set's group; neighbouring sets are joined where that saves time.

    Parameters
    ----------
    sets : PhotoSets
    coordinates : array (b, 3)
        Of the points, roughly; they decide about the time alone.
    """
    size = len(sets.first)
    if not size:
        return np.empty(0, dtype=np.int64)
    order = _order_of_neighbours(np.nan_to_num(coordinates[sets.first]))
    place = np.empty(size, dtype=np.int64)
    place[order] = np.arange(size)
    points = np.bincount(sets.of_point, minlength=size)[order]
    return np.asarray(np.cumsum(_begins_group(place[sets.number], sets.photo, points))[place] - 1)


def _order_of_neighbours(positions: FloatArray) -> IntArray:
    """Return an order of positions (s, 3) of which the halves, the halves of these and so on are neighbours.

    Each is halved across its longest side, as by a k-d tree (Bentley 1975); all of the same length at once.
    """
    size = len(positions)
    rank = np.empty((size, 3), dtype=np.int64)
    np.put_along_axis(rank, np.argsort(positions, axis=0, kind="stable"), np.arange(size)[:, None], axis=0)
    order = np.arange(size)
    for first, _, _ in _halves(size)[:-1]:  # of two it does not matter which comes first
        placed = positions[order]
        longest = np.argmax(np.maximum.reduceat(placed, first) - np.minimum.reduceat(placed, first), axis=1)
        part = np.repeat(np.arange(len(first)), np.diff(first, append=size))
        order = order[np.argsort(part * size + rank[order, longest[part]])]
    return order


def _begins_group(place: IntArray, photo: IntArray, points: IntArray) -> BoolArray:
    """Return which of s sets in a row begin a group (s,), so that all groups together take the least time.

    A group is one set, or a half of the row, a half of that and so on. Of each half it is found, from the smallest on,
    whether it takes less time as one group than its own halves do by themselves, as a regression tree is pruned
    (Breiman et al. 1984). Two sets of many photos that a group does not pay for may well be part of one of ten.

    Parameters
    ----------
    place, photo : arrays (r,) of int
        The pairs of a set, by its place in the row, and a photo in it.
    points : array (s,) of int
        How many points each set has.
    """
    size, every = len(points), int(photo.max(initial=0)) + 1
    photos = np.bincount(place, minlength=size)
    # of halves by the place where they begin; of those that may still be one group, the pairs with their photos
    rays, least, is_open = points * photos, _time(photos, points * photos), photos > 0
    begins = np.ones(size, dtype=bool)
    pairs = distinct(place * every + photo)
    for first, middle, end in reversed(_halves(size)):
        may_join = is_open[first] & is_open[middle]
        pairs = _joined(pairs, every, first, middle, size)
        rays[first] += rays[middle]
        apart = least[first] + least[middle]
        joined = _time(np.bincount(pairs // every, minlength=size)[first], rays[first])
        saves = may_join & (joined <= apart)
        begins[_within(first[saves] + 1, end[saves], size)] = False
        least[first] = np.where(saves, joined, apart)
        is_open[middle] = False
        is_open[first] = may_join & (joined <= _GIVEN_UP * apart)
        pairs = pairs[is_open[pairs // every]]
    return begins


def _within(first: IntArray, end: IntArray, size: int) -> BoolArray:
    """Return which of the places up to `size` lie in one of some ranges that do not overlap."""
    change = np.zeros(size + 1, dtype=np.int64)
    np.add.at(change, first, 1)
    np.add.at(change, end, -1)
    return np.asarray(np.cumsum(change)[:-1] > 0)


def _time(photos: IntArray, rays: IntArray) -> FloatArray:
    """Return the time that a group takes, of which every ray updates columns of all photos."""
    return photos * (_OF_A_GROUP * photos + rays)


def _joined(pairs: IntArray, every: int, first: IntArray, middle: IntArray, size: int) -> IntArray:
    """Return the pairs of a group and a photo once the groups that begin in a middle are part of the one before."""
    begin = np.arange(size)
    begin[middle] = first
    group, photo = np.divmod(pairs, every)
    return distinct(begin[group] * every + photo)


def _halves(size: int) -> list[tuple[IntArray, IntArray, IntArray]]:
    """Return where parts of a row begin, their middles and ends, of the whole, of its halves, and so on down to two."""
    found = []
    ends = np.array([0, size])
    while (length := np.diff(ends)).max() > 1:
        divided = length > 1
        first = ends[:-1][divided]
        middle = first + length[divided] // 2
        found.append((first, middle, ends[1:][divided]))
        ends = np.sort(np.concatenate([ends, middle]))
    return found


Int32Array = NDArray[np.int32]

_CAMERA_PARAMETERS, _MOST_ADDITIONAL, _POLYNOMIALS, _FORMS = 13, 44, 5, 4


class Cameras(Struct, frozen=True):
    """Constants of c cameras, and the columns with which the compiled loops compute in place of their unknowns.

    A set of additional parameters has d polynomials A_j(x), and B_i(y) that are the same of y; their products are
    numbered d i + j, counted from 0. The columns of a camera are the coefficients in dx of all products but the first,
    which is a shift and in no set, then its elements (C, DX, ...), then the coefficients in dy. A photo point has all
    these products, the same for x and for y: there are fewer of them than of the parameters, and they cost a product.

    Parameters
    ----------
    kind : array (c,) of int
        Its form; each camera with a set is a kind of its own.
    polynomials : array (c,) of int
        Number d of polynomials of its set, 0 without one.
    by_powers : array (c, 5, 5)
        A_j by powers of its argument.
    products : array (c, 2, 44) of int
        Of the parameters of a camera's set in dx and dy: the number of the product.
    factors : array (c, 2, 44)
        With which each parameter is the coefficient of its product in dx and dy.
    form : array (c,) of int
        1: the polynomial of the distortion is at measured coordinates, 2: the projection is equidistant, 3: both.
    product_columns, own_columns : arrays (c,) of int
        Number of columns of products in dx (as many are in dy), and of elements.
    elements : array (c, 13) of int
        For each column of an element its number among the partials.
    unknowns : array (c,) of int
        Their number.
    columns : array (c, 57) of int
        Of each unknown in the normal equations.
    terms, term_factors : arrays (c, 57, 2)
        Each unknown is the sum of two columns of the camera times factors.
    """

    kind: Int32Array
    polynomials: Int32Array
    by_powers: FloatArray
    products: Int32Array
    factors: FloatArray
    form: NDArray[np.uint8]
    product_columns: Int32Array
    own_columns: Int32Array
    elements: Int32Array
    unknowns: Int32Array
    columns: Int32Array
    terms: Int32Array
    term_factors: FloatArray

    def deformation(self, additional: FloatArray) -> FloatArray:
        """Return the coefficients (c, 2, 25) of the products in dx and dy from the parameters (c, k)."""
        count, parameters = additional.shape
        found = np.zeros((count, 2, _POLYNOMIALS**2))
        camera, image = np.ogrid[:count, :2]
        times = self.factors[:, :, :parameters] * additional[:, None]
        np.add.at(found, (camera[..., None], image[..., None], self.products[:, :, :parameters]), times)
        return found


class Pattern(Struct, frozen=True):
    """How the photo points of eliminated points go into the normal equations, group by group.

    A group consists of points that are measured in the same photos, or in nearly the same. A run is
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

    order: Int32Array
    start: Int32Array
    block: Int32Array
    group_start: Int32Array
    runs_start: Int32Array
    runs: Int32Array
    coupled_start: Int32Array
    coupled: Int32Array


def pattern_of_loop(
    photo: NDArray[np.int64],
    block: NDArray[np.int32],
    coordinates: FloatArray,
    camera_of_photo: Int32Array,
    cameras: int,
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

    runs_start, runs = _runs(group_of_set[sets.number], sets.photo, len(group_start) - 1, camera_of_photo, cameras)
    coupled = _runs(sets.number, sets.photo, len(sets.first), camera_of_photo, cameras)
    small = (order, np.append(0, ends), by_group, group_start, runs_start, runs, *coupled)
    return Pattern(*(array.astype(np.int32) for array in small))


def _runs(
    number: NDArray[np.int64], photo: NDArray[np.int64], count: int, camera_of_photo: Int32Array, cameras: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where the runs of each number begin and the runs, cameras first, of pairs of a number and a photo.

    There are `count` numbers; that of points that no photo shows is in no pair.
    """
    every = cameras + len(camera_of_photo)
    keys = distinct(np.concatenate([every * number + camera_of_photo[photo], every * number + cameras + photo]))
    of_number, runs = np.divmod(keys, every)
    return np.append(0, np.cumsum(np.bincount(of_number, minlength=count))), runs


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
    count = len(unknowns.cameras)
    form = np.zeros(count, dtype=np.uint8)
    form[points.camera] = points.at_measured + 2 * points.is_equidistant.astype(np.uint8)
    kind = form.astype(np.int32)
    polynomials = np.zeros(count, dtype=np.int32)
    products = np.zeros((count, 2, _MOST_ADDITIONAL), dtype=np.int32)
    factors = np.zeros((count, 2, _MOST_ADDITIONAL))
    by_powers = np.zeros((count, _POLYNOMIALS, _POLYNOMIALS))
    for camera, name, base in points.sets:
        kind[camera] = _FORMS + camera
        table = PARAMETER_SETS[name].factors
        degree, parameters = table.shape[-1], table.shape[1]
        polynomials[camera] = degree
        # each parameter has at most one product in dx and one in dy
        products[camera, :, :parameters] = np.abs(table).reshape(2, parameters, -1).argmax(axis=2)
        factors[camera, :, :parameters] = table.sum(axis=(2, 3))
        by_powers[camera, :degree, :degree] = (basis_by_powers(name, base) / base ** np.arange(degree)[:, None]).T

    is_own, is_additional = unknowns.cameras != CONSTANT, unknowns.additional != CONSTANT
    own = is_own.sum(axis=1).astype(np.int32)
    product_columns = np.where(is_additional.any(axis=1), polynomials**2 - 1, 0).astype(np.int32)
    elements = np.argsort(~is_own, axis=1, kind="stable").astype(np.int32)
    columns = np.full((count, _CAMERA_PARAMETERS + _MOST_ADDITIONAL), CONSTANT, dtype=np.int32)
    terms = np.zeros((*columns.shape, 2), dtype=np.int32)
    term_factors = np.zeros(terms.shape)
    for camera in range(count):
        mine, parameters = own[camera], np.flatnonzero(is_additional[camera])
        end = mine + len(parameters)
        columns[camera, :mine] = unknowns.cameras[camera, is_own[camera]]
        columns[camera, mine:end] = unknowns.additional[camera, parameters]
        terms[camera, :mine, 0] = product_columns[camera] + np.arange(mine)
        term_factors[camera, :mine, 0] = 1.0
        used = factors[camera][:, parameters]
        first = np.array([-1, product_columns[camera] + mine - 1])  # the first product has no column
        terms[camera, mine:end] = np.where(used != 0.0, products[camera][:, parameters] + first[:, None], 0).T
        term_factors[camera, mine:end] = used.T
    number = (own + is_additional.sum(axis=1)).astype(np.int32)
    return Cameras(
        kind, polynomials, by_powers, products, factors, form, product_columns, own, elements, number, columns, terms,
        term_factors,
    )  # fmt: skip
