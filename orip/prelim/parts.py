"""What parts of a block have in common with each other and with control, and photos as parts of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from orip.geometry.similarity import Similarities
from orip.prelim.rays import ImageRays
from orip.records.preliminary import PartialBlock

Values = TypeVar("Values", FloatArray, ComplexArray)
"""Equations of the heights, and those in plan, where one complex number has two coordinates."""

_STEADY = 0.3
"""Least deviation of a point, as a part of the median."""


class Ties(Struct, frozen=True):
    """What ties parts: positions that several have, or that are known.

    Parameters
    ----------
    part, place : arrays (n,) of int
        In order of `place`, which is the index of a position on the ground.
    coordinates : array (n, 3)
        That a part has for it, in its own system.
    known : array (places, 3)
        Ground coordinates; NaN where not known.
    pairs : array (2, m) of int
        Each two of the n with the same place, each with itself, too; in the order of the parts of both.
    block_starts : array (b,) of int
        Where new parts begin among the pairs.
    block_parts : array (2, b) of int
    alike : array (2, k) of int
        Pairs of parts with a common photo.
    neighbours : tuple of lists, one a part
        For each part those with a common photo, and rotations of their systems to its own.
    """

    parts: int
    part: IntArray
    place: IntArray
    coordinates: FloatArray
    known: FloatArray
    pairs: IntArray
    block_starts: IntArray
    block_parts: IntArray
    alike: IntArray
    neighbours: tuple[list[tuple[int, FloatArray]], ...]

    @property
    def counts(self) -> IntArray:
        """Return in how many parts each place is."""
        return np.bincount(self.place, minlength=len(self.known))

    def means(self, values: Values) -> Values:
        """Return the means (places, ...) of values (n, ...)."""
        sums = np.zeros((len(self.known), *values.shape[1:]), dtype=values.dtype)
        np.add.at(sums, self.place, values)
        sums /= self.counts.reshape(-1, *[1] * (values.ndim - 1))
        return sums

    def middles(self, coordinates: FloatArray) -> FloatArray:
        """Return the means (parts, 3) of the coordinates (n, 3) by which parts are tied."""
        number = np.maximum(np.bincount(self.part, minlength=self.parts), 1)
        sums = [np.bincount(self.part, weights=column, minlength=self.parts) for column in coordinates.T]
        return np.stack(sums, axis=1) / number[:, None]

    def reduced_blocks(self, design: Values, free: BoolArray) -> Values:
        """Return the blocks (b, u, u) of the normal equations of a design (u, n), free places eliminated."""
        one, other = self.pairs
        weight = (one == other) - (free / self.counts)[self.place[one]]
        blocks = np.empty((len(self.block_starts), len(design), len(design)), dtype=design.dtype)
        # one element after the other, as there are many pairs
        for row, left in enumerate(design.conj()):
            weighted = left[one] * weight
            for column, right in enumerate(design):
                blocks[:, row, column] = np.add.reduceat(weighted * right[other], self.block_starts)
        return blocks


def ties_between(parts: Sequence[PartialBlock], known: FloatArray) -> Ties:
    """Return what ties parts, with the known ground coordinates (number of points, 3), NaN where not known."""
    number, place, coordinates = _positions(parts, len(known))
    photos = max((int(part.photos.max()) for part in parts), default=-1) + 1
    on_ground = np.concatenate([known, np.full((photos, 3), np.nan)])
    shared = np.bincount(place, minlength=len(on_ground)) > 1
    useful = np.flatnonzero((shared | np.isfinite(on_ground).any(axis=1))[place])
    useful = useful[np.argsort(place[useful], kind="stable")]
    number = number[useful]
    places, new = np.unique(place[useful], return_inverse=True)
    pairs = _pairs(new)
    order = np.lexsort((number[pairs[1]], number[pairs[0]]))
    pairs = pairs[:, order]
    of_pairs = number[pairs]
    begins = np.ones(pairs.shape[1], dtype=bool)
    begins[1:] = (of_pairs[:, 1:] != of_pairs[:, :-1]).any(axis=0)
    starts = np.flatnonzero(begins)
    neighbours = _neighbours(parts)
    alike = [(here, other) for here, near in enumerate(neighbours) for other, _ in near if here < other]
    return Ties(
        len(parts),
        number,
        new,
        coordinates[useful],
        on_ground[places],
        pairs,
        starts,
        of_pairs[:, starts],
        np.array(alike, dtype=np.int64).reshape(-1, 2).T,
        neighbours,
    )


def _positions(parts: Sequence[PartialBlock], points: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Return part, place and coordinates of all points and projection centres of parts; centres follow the points."""
    if not parts:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty((0, 3))
    lengths = [len(part.points) + len(part.photos) for part in parts]
    place = np.concatenate([array for part in parts for array in (part.points, points + part.photos)])
    coordinates = np.concatenate([array for part in parts for array in (part.coordinates, part.centres)])
    return np.repeat(np.arange(len(parts)), lengths), place, coordinates


def _pairs(place: IntArray) -> IntArray:
    """Return each two (2, m) of ascending places that are the same, in both orders, and each with itself."""
    counts = np.bincount(place)
    own = counts[place]
    one = np.repeat(np.arange(len(place)), own)
    first = (np.cumsum(counts) - counts)[place[one]]
    rank = np.arange(len(one)) - np.repeat(np.cumsum(own) - own, own)
    return np.stack([one, first + rank])


def _neighbours(parts: Sequence[PartialBlock]) -> tuple[list[tuple[int, FloatArray]], ...]:
    """Return for each part those with a common photo, and the rotation of their system to its own by the first one."""
    found: list[dict[int, FloatArray]] = [{} for _ in parts]
    holders: dict[int, list[tuple[int, FloatArray]]] = {}
    for number, part in enumerate(parts):
        for photo, rotation in zip(part.photos.tolist(), part.rotations, strict=True):
            for other, its in holders.setdefault(photo, []):
                if other not in found[number]:
                    turn = rotation @ its.T
                    found[number][other], found[other][number] = turn, turn.T
            holders[photo].append((number, rotation))
    return tuple(list(near.items()) for near in found)


def assembled_at(parts: Sequence[PartialBlock], at: Similarities) -> PartialBlock:
    """Return parts as one block after their movements.

    A point of several parts is at the weighted mean, with a deviation that follows from theirs; a photo is as in the
    first part that has it.
    """
    points = np.concatenate([part.points for part in parts])
    of_point = np.repeat(np.arange(len(parts)), [len(part.points) for part in parts])
    photos = np.concatenate([part.photos for part in parts])
    of_photo = np.repeat(np.arange(len(parts)), [len(part.photos) for part in parts])
    photos, first = np.unique(photos, return_index=True)
    of_photo = of_photo[first]
    deviation = np.sqrt((np.concatenate([part.deviations for part in parts]) ** 2).mean(axis=1)) * at.scale[of_point]
    usual = float(np.median(deviation[deviation > 0.0])) if (deviation > 0.0).any() else 1.0
    weight = 1.0 / np.maximum(deviation, _STEADY * usual) ** 2
    placed = moved(at, of_point, np.concatenate([part.coordinates for part in parts]))
    places, place = np.unique(points, return_inverse=True)
    total = np.bincount(place, weights=weight)
    mean = np.stack([np.bincount(place, weights=weight * column) for column in placed.T], axis=1) / total[:, None]
    return PartialBlock(
        parts[0].name,
        photos,
        at.rotation[of_photo] @ np.concatenate([part.rotations for part in parts])[first],
        moved(at, of_photo, np.concatenate([part.centres for part in parts])[first]),
        places,
        mean,
        np.repeat(1.0 / np.sqrt(total)[:, None], 3, axis=1),
    )


def moved(at: Similarities, part: IntArray, coordinates: FloatArray) -> FloatArray:
    """Return coordinates (n, 3), each of a part (n,), after the movements of the parts."""
    turned = np.einsum("nij,nj->ni", at.rotation[part], coordinates)
    return np.asarray(at.scale[part, None] * turned + at.shift[part])


LOOKING_DOWN, UPRIGHT = 2, 1
"""Axes of the photos that may point up."""

FLAT = 0.1
"""Deviation of the depth of points in a single photo, which are taken to lie in a plane, as part of that depth."""

_M = 1e-3
"""Parts are in metres at photo scale."""

_EQUATIONS = 6
"""Of a photo, with as many unknowns."""


def single_photo(rays: ImageRays, photo: int, rows: IntArray) -> PartialBlock:
    """Return a photo with its points in a plane, by its `rows` of the rays."""
    coordinates = _M * rays.vectors[rows]
    return PartialBlock(
        rays.photos[photo],
        np.array([photo]),
        np.eye(3)[None],
        np.zeros((1, 3)),
        rays.point[rows],
        coordinates,
        np.abs(FLAT * coordinates[:, [2, 2, 2]]),
    )


def supported_photos(rays: ImageRays, known: FloatArray) -> BoolArray:
    """Return which photos (number of photos,) may be determined: others and control give them equations enough.

    A point gives two if it is control or if two other photos show it, one if one of them does.

    Parameters
    ----------
    known : array (number of points, 3)
        Control, NaN where not known.
    """
    control: BoolArray = np.asarray(np.isfinite(known).any(axis=1))
    supported = np.ones(len(rays.photos), dtype=bool)
    while True:
        used = supported[rays.photo]
        others = np.bincount(rays.point[used], minlength=len(rays.points))[rays.point] - 1
        equations = np.where(control[rays.point], 2, np.clip(others, 0, 2))
        enough = np.bincount(rays.photo, weights=equations * used, minlength=len(supported)) >= _EQUATIONS
        if not (supported & ~enough).any():
            return supported
        supported &= enough
