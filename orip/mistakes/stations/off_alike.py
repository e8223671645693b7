"""Positions that are off alike, of the whole flight or of a strip that the file does not tell apart.

Photos that hardly see beyond their strip follow their positions, and the block bends between these and the control: no
single position loses its weight. The flight is tried without its positions, or each strip without its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import DECIDED, Misfit, fit_of_adjustment, is_good
from orip.mistakes.stations.contradicting_positions import alike_elsewhere
from orip.mistakes.stations.doubted_camera import are_doubted, fits_positions, has_positions, without_positions
from orip.mistakes.stations.given_positions import given_positions
from orip.records.block import Block

_FEWEST = 3
"""Photos of a strip."""

_MOST = 12
"""Strips that are tried."""

_BY_OTHERS = 0.2
"""Part of what goes with the positions of one strip by which those of all others may lower the cost further."""

_STRAIGHT = float(np.cos(np.radians(30.0)))
"""Cosine of the largest change of direction on a strip."""


def all_off_alike(misfit: Misfit) -> list[ProjectWarning]:
    """Return that all positions are off alike, if all fits without them."""
    block = misfit.readjuster.block
    without = misfit.readjuster.adjust(without_positions(block))
    if without is None or not (without.converged and is_good(fit_of_adjustment(without))):
        return []
    solution = solution_of(without)
    return alike_elsewhere(solution, block, solution.photos.names)


def one_strip_off(misfit: Misfit) -> list[ProjectWarning]:
    """Return that the positions of one strip are off alike, if all fits without them and the others stay."""
    readjuster = misfit.readjuster
    block = readjuster.block
    if not (readjuster.is_worthwhile and has_positions(block) and are_doubted(misfit.solution)):
        return []
    if len({station.strip for station in block.stations}) > 1:
        return []  # each has a group of its own, which names it
    strips = list(_strips(block))
    best: tuple[float, SolvedBlock, tuple[str, ...]] | None = None
    for strip in strips if 2 <= len(strips) <= _MOST else ():
        tried = readjuster.adjust(without_positions(block, strip))
        if tried is not None and tried.converged and (best is None or _cost_without(tried, strip) < best[0]):
            best = _cost_without(tried, strip), tried, strip
    gain = 0.0 if best is None else misfit.solved.weighing.cost(misfit.solved.equations) - best[0]
    if best is None or gain < DECIDED:
        return []
    cost, solved, strip = best
    solution = solution_of(solved)
    without = readjuster.adjust(without_positions(block))
    if without is None or not fits_positions(solved, without) or are_doubted(solution):
        return []
    if cost - _cost_without(without, given_positions(block).photos) > _BY_OTHERS * gain:
        return []  # all of them are off
    return alike_elsewhere(solution, block, strip)


def _cost_without(tried: SolvedBlock, photos: Sequence[str]) -> float:
    """Return the cost without the positions of some photos: each coordinate took half by chance."""
    return tried.weighing.cost(tried.equations) + 0.5 * 3 * len(photos)


def _strips(block: Block) -> Iterator[tuple[str, ...]]:
    """Yield the photos of each strip: those that follow each other straight on, in the order of the project."""
    positions = given_positions(block)
    ahead = _directions(positions.given[:, :2])
    first = 0
    for last in range(1, len(positions.photos)):
        ends = last == len(ahead) or float(ahead[last] @ ahead[last - 1]) < _STRAIGHT
        if ends:
            if last - first + 1 >= _FEWEST:
                yield positions.photos[first : last + 1]
            first = last


def _directions(places: FloatArray) -> FloatArray:
    """Return unit vectors (n - 1, 2) from each place to the next."""
    steps = np.diff(places, axis=0)
    return np.asarray(steps / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9))
