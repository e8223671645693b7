"""Orientation of parts of a block together: models, strips or single photos that cannot be joined one by one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from orip.geometry.similarity import Similarities
from orip.prelim.block_grower import BlockGrower
from orip.prelim.growing_block import GrowingBlock, growing_block_of, residual_lengths
from orip.prelim.parts import Ties, Values, moved
from orip.prelim.refinement import ROUGH
from orip.prelim.sampling import median
from orip.records.preliminary import PartialBlock
from orip.structs import replace

# Each part (a strip, a model, a photo) is levelled by the attitude of its photos. The other unknowns of its similarity
# are linear: scale, azimuth and shift in plan, then the height. All parts are therefore adjusted together without
# initial values, from control and common points, as in the block adjustment of levelled models (Anblock: van den Hout
# 1966). Levels are improved with the heights. The common points are eliminated: each is the mean of where parts have
# it.

_AGREEING = 0.5
"""Length of the mean of the photos' axes below which they do not say where up is."""

_ALIKE = 0.03
"""Weight of the condition that parts with a common photo have the same scale and azimuth; 1 is that of a point."""

_LEVEL = 0.1
"""Weight of the condition that a part is level, at the distance of its points; 1 is that of a point."""

_SMALLEST_SCALE = 0.2
"""Of the median scale: parts that shrink more are not determined, and get the median."""

_DENSE = 300
"""Unknowns up to which setting up a sparse matrix takes longer than solving a full one."""

_REGULAR = 1e-10
"""Of the mean square of a column, added to the normal equations: parts that nothing ties stay where they are."""


class Placement(NamedTuple):
    """Where parts are on the ground.

    Attributes
    ----------
    movements : Similarities
        From the parts' own systems.
    misfit : float
        Median distance of what ties the parts from its mean, or from where it is known, ground units.
    """

    movements: Similarities
    misfit: float


def place_parts(ties: Ties, turns: FloatArray, rounds: int) -> Placement | None:
    """Place parts of a block on the ground together.

    Parameters
    ----------
    ties : Ties
        Of parts at similar scale.
    turns : array (parts, 3, 3)
        Rotations that level the parts.
    rounds : int
        Number of adjustments of plan and height: after the first one levels are better.

    Returns
    -------
    Placement, or None
        None where control and common points do not determine the parts together.
    """
    count = len(turns)
    if not (count and len(ties.place)):
        return None
    placed = Similarities(np.ones(count), _with_common_azimuths(ties, turns), np.zeros((count, 3)))
    for _ in range(rounds):
        in_plan = _moved_in_plan(ties, _coordinates(ties, placed))
        if in_plan is None:
            return None
        placed = _after(in_plan, placed)
        placed = _after(_lifted(ties, _coordinates(ties, placed)), placed)
    off = _coordinates(ties, placed)
    off -= np.where(np.isfinite(ties.known), ties.known, ties.means(off))[ties.place]
    return Placement(placed, median(np.sqrt((off**2).sum(axis=1))))


def levelling(part: PartialBlock, axis: int) -> FloatArray | None:
    """Return the rotation (3, 3) of a part after which the mean axis of its photos points up.

    Parameters
    ----------
    axis : int
        Axis of the photos that points up: 2 where they look down, 1 where they stand upright.

    Returns
    -------
    array (3, 3), or None
        None where the photos' axes contradict each other.
    """
    mean = part.rotations[:, :, axis].mean(axis=0)
    length = float(np.linalg.norm(mean))
    return None if length < _AGREEING else _turn_to_up(mean / length)


def tilts(slopes: FloatArray) -> FloatArray:
    """Return the smallest rotations (n, 3, 3) that give the horizontal plane slopes (n, 2) in X and Y."""
    x, y = slopes.T
    length = np.sqrt(1.0 + x**2 + y**2)
    # (-x, -y, 1) / length is where the vertical goes: I - [a]x + [a]x [a]x / (1 + cosine), see _turn_to_up
    x, y, z = -x / length, -y / length, 1.0 / length
    a, b = x / (1.0 + z), y / (1.0 + z)
    rows = [[1.0 - a * x, -b * x, x], [-a * y, 1.0 - b * y, y], [-x, -y, 1.0 - a * x - b * y]]
    return np.moveaxis(np.array(rows), 2, 0)


def _turn_to_up(direction: FloatArray) -> FloatArray:
    """Return the smallest rotation that takes a direction (3,) to the vertical."""
    x, y, z = direction.tolist()
    if z < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    # I + [a]x + [a]x [a]x / (1 + cosine), with a = direction x vertical
    a, b = x / (1.0 + z), y / (1.0 + z)
    return np.array([[1.0 - a * x, -a * y, -x], [-b * x, 1.0 - b * y, -y], [x, y, 1.0 - a * x - b * y]])


def _with_common_azimuths(ties: Ties, turns: FloatArray) -> FloatArray:
    """Return the rotations (parts, 3, 3) of parts, of which those with a common photo have the same azimuth."""
    turns, waiting = turns.copy(), []
    placed = [False] * len(turns)
    for first in range(len(turns)):
        if not placed[first]:
            placed[first] = True
            waiting.append(first)
        while waiting:
            here = waiting.pop()
            for other, rotation in ties.neighbours[here]:
                if not placed[other]:
                    turn = turns[here] @ rotation @ turns[other].T
                    azimuth = np.array([turn[0, 0] + turn[1, 1] + 1j * (turn[1, 0] - turn[0, 1])])
                    turns[other] = _about_up(azimuth)[0] @ turns[other]
                    placed[other] = True
                    waiting.append(other)
    return turns


def _about_up(directions: ComplexArray) -> FloatArray:
    """Return the rotations (n, 3, 3) about the vertical by the angles of complex numbers (n,); none by that of 0."""
    length = np.abs(directions)
    unit = np.where(length > 0.0, directions / np.where(length > 0.0, length, 1.0), 1.0)
    rotation = np.zeros((len(directions), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = unit.real
    rotation[:, 1, 0], rotation[:, 0, 1], rotation[:, 2, 2] = unit.imag, -unit.imag, 1.0
    return rotation


def _coordinates(ties: Ties, at: Similarities) -> FloatArray:
    """Return the coordinates (n, 3) of what ties the parts, after movements of the parts."""
    return moved(at, ties.part, ties.coordinates)


def _after(second: Similarities, first: Similarities) -> Similarities:
    """Return movements of the parts, one after the other."""
    shift = np.einsum("sij,sj->si", second.rotation, first.shift)
    return Similarities(
        second.scale * first.scale, second.rotation @ first.rotation, second.scale[:, None] * shift + second.shift
    )


def _moved_in_plan(ties: Ties, coordinates: FloatArray) -> Similarities | None:
    """Return the movements of the parts in plan; None where nothing determines them.

    With z = x + i y reduced to the middle of a part, Z = m z + Z of the middle: one complex m has scale and azimuth.
    """
    middle = ties.middles(coordinates)
    reduced = coordinates - middle[ties.part]
    free: BoolArray = np.asarray(~np.isfinite(ties.known[:, :2]).all(axis=1))
    datum = ties.known[~free, :2].mean(axis=0) if not free.all() else np.zeros(2)
    given = np.where(free[:, None], 0.0, ties.known[:, :2] - datum)[ties.place]
    size = _size(reduced)
    design: ComplexArray = np.stack([_complex(reduced), np.full(len(reduced), size, dtype=np.complex128)])
    solution = _solved(ties, design, _complex(given), free, np.array([_ALIKE * size, 0.0]))
    scale = np.abs(solution[:, 0])
    if not np.isfinite(solution).all() or not scale.any():
        return None
    usual = median(scale[scale > 0.0])
    scale = np.where(scale < _SMALLEST_SCALE * usual, usual, scale)
    rotation = _about_up(solution[:, 0])
    place = solution[:, 1] * size
    shift = np.stack([place.real + datum[0], place.imag + datum[1], np.zeros(len(scale))], axis=1)
    middle[:, 2] = 0.0
    return Similarities(scale, rotation, shift - scale[:, None] * np.einsum("sij,sj->si", rotation, middle))


def _lifted(ties: Ties, coordinates: FloatArray) -> Similarities:
    """Return the movements of the parts in height: slopes in X and Y, and the height of the middle."""
    middle = ties.middles(coordinates)
    reduced = coordinates - middle[ties.part]
    free: BoolArray = np.asarray(~np.isfinite(ties.known[:, 2]))
    datum = float(ties.known[~free, 2].mean()) if not free.all() else 0.0
    given = np.where(free, 0.0, ties.known[:, 2] - datum)[ties.place]
    size = _size(reduced)
    design = np.stack([reduced[:, 0], reduced[:, 1], np.full(len(reduced), size)])
    level = _LEVEL * size * np.array([1.0, 1.0, 0.0])
    solution = _solved(ties, design, given - reduced[:, 2], free, np.zeros(3), level)
    rotation = tilts(solution[:, :2])
    image = np.stack([middle[:, 0], middle[:, 1], solution[:, 2] * size + datum], axis=1)
    return Similarities(np.ones(len(middle)), rotation, image - np.einsum("sij,sj->si", rotation, middle))


def _complex(coordinates: FloatArray) -> ComplexArray:
    """Return x + i y of coordinates (n, 2 or 3)."""
    return np.asarray(coordinates[:, 0] + 1j * coordinates[:, 1], dtype=np.complex128)


def _size(reduced: FloatArray) -> float:
    return float(np.sqrt((reduced[:, :2] ** 2).sum(axis=1).mean())) or 1.0


def _solved(
    ties: Ties, design: Values, right: Values, free: BoolArray, alike: FloatArray, own: FloatArray | None = None
) -> Values:
    """Return the unknowns (parts, u) that fit design (u, n) times unknowns to the right sides (n,).

    The u unknowns of parts with a common photo are alike, with the weights `alike` (u,), and small, with the weights
    `own` (u,). At places that are `free` (places,) the equations hold apart from a constant; those that nothing
    determines are near 0.
    """
    parts, unknowns = ties.parts, len(design)
    blocks = ties.reduced_blocks(design, free)
    of_parts = np.zeros((parts, unknowns), dtype=design.dtype)
    reduced = np.where(free[ties.place], right - ties.means(right)[ties.place], right)
    np.add.at(of_parts, ties.part, (design.conj() * reduced).T)
    diagonal = np.bincount(ties.alike.ravel(), minlength=parts)[:, None] * alike**2
    diagonal = diagonal + (0.0 if own is None else own**2)
    one, other = ties.alike
    rows = np.concatenate([ties.block_parts[0], one, other, np.arange(parts)])
    columns = np.concatenate([ties.block_parts[1], other, one, np.arange(parts)])
    apart = np.broadcast_to(-np.diag(alike**2), (2 * len(one), unknowns, unknowns))
    values = np.concatenate([blocks, apart, diagonal[:, :, None] * np.eye(unknowns)])
    return _solution(rows, columns, values, of_parts)


def _solution(rows: IntArray, columns: IntArray, values: Values, right: Values) -> Values:
    """Return the solution (parts, u) of normal equations, which are the sum of blocks (b, u, u) of parts."""
    (parts, unknowns), solution = right.shape, np.empty_like(right)
    usual = np.einsum("bii->b", values[rows == columns]).real.sum() / right.size
    if right.size <= _DENSE:
        normal = np.zeros((parts, parts, unknowns, unknowns), dtype=values.dtype)
        np.add.at(normal, (rows, columns), values)
        full = normal.transpose(0, 2, 1, 3).reshape(right.size, right.size)
        full[np.diag_indices(right.size)] += _REGULAR * usual
        solution[:] = np.linalg.solve(full, right.ravel()).reshape(right.shape)
        return solution
    from scipy.sparse import coo_array, eye_array
    from scipy.sparse.linalg import splu

    own = np.arange(unknowns)
    at = np.broadcast_to((unknowns * rows)[:, None, None] + own[:, None], values.shape).ravel()
    to = np.broadcast_to((unknowns * columns)[:, None, None] + own, values.shape).ravel()
    sparse = coo_array((values.ravel(), (at, to)), shape=(right.size, right.size)).tocsc()
    regular = _REGULAR * usual * eye_array(right.size, format="csc")
    solution[:] = splu((sparse + regular).tocsc()).solve(right.ravel()).reshape(right.shape)
    return solution


_NARROWER = 10.0
"""Ratio of the limits for blunders from one adjustment to the next."""


def annealed(held: BlockGrower, placed: PartialBlock, wanted: BoolArray, how: str) -> GrowingBlock:
    """Return a block that is roughly placed after adjustments in which no ray is a blunder at first.

    Parts fit in themselves, so that the few points that tie them would lose their weight while the parts are still out
    of place (graduated non-convexity, Blake and Zisserman 1987). The adjustment by the a-priori errors comes when the
    block grows.

    Parameters
    ----------
    held : BlockGrower
        With the control that holds the block.
    placed : PartialBlock
        On the ground.
    wanted : array (number of photos,) of bool
        Other photos have helped to place the block, and are left out now.
    how : str
        How the photos were oriented.
    """
    start = growing_block_of(held.rays, placed, how)
    start = replace(start, coordinates=np.where(held.held_points[:, None], held.held, start.coordinates))
    start = start.without_photos(~wanted)
    lengths = residual_lengths(held.seen(start), start)
    factor = float(lengths[np.isfinite(lengths)].max(initial=0.0))
    while factor > 1.0:
        rays = replace(held.rays, error=factor * held.rays.error)
        start = replace(held, rays=rays).refined(start, ROUGH)
        factor /= _NARROWER
    return start
