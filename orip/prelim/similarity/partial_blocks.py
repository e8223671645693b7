"""Partial blocks: transformed to another system, assembled into one, and deviations from which weights can follow."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.similarity import Similarity
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.medians import median, medians
from orip.records.results.preliminary import PartialBlock
from orip.structs import replace

STEADY = 0.3
"""Least deviation, as a part of the median: the spread of two determinations that agree by chance is no precision."""


def transformed(block: PartialBlock, similarity: Similarity) -> PartialBlock:
    """Return a partial block in the target system of a similarity; deviations are propagated from axis to axis."""
    variances = similarity.scale**2 * (block.deviations**2 @ (similarity.rotation**2).T)
    return replace(
        block,
        rotations=similarity.rotation @ block.rotations,
        centres=similarity.apply(block.centres),
        coordinates=similarity.apply(block.coordinates),
        deviations=np.sqrt(variances),
    )


def assembled(blocks: Sequence[PartialBlock]) -> PartialBlock:
    """Return several partial blocks of one system as one.

    A point that occurs more than once has the weighted mean of its determinations, and their root mean square spread
    as its deviation. A photo that occurs more than once is as in the first.

    Parameters
    ----------
    blocks : sequence of PartialBlock
        One at least; the first gives the name.

    Returns
    -------
    PartialBlock
        Photos and points of several in ascending order; of one as they are.
    """
    if len(blocks) == 1:
        return blocks[0]
    return (_compiled if is_compiled() else _with_arrays)(blocks)


def _compiled(blocks: Sequence[PartialBlock]) -> PartialBlock:
    """Do what `_with_arrays` does in the compiled loop."""
    points, photos = [block.points for block in blocks], [block.photos for block in blocks]
    given = (
        np.concatenate(points),
        np.concatenate(photos),
        np.concatenate([block.coordinates for block in blocks]),
        np.concatenate([block.deviations for block in blocks]),
        np.concatenate([block.rotations for block in blocks]),
        np.concatenate([block.centres for block in blocks]),
    )
    whole = tuple(map(np.empty_like, given))
    starts = np.array([0, *accumulate(map(len, points))])
    seen, known = kernels.assemble(*given, starts, *whole, STEADY)
    return PartialBlock(
        blocks[0].name, whole[1][:seen], whole[4][:seen], whole[5][:seen], whole[0][:known], whole[2][:known],
        whole[3][:known],
    )  # fmt: skip


def _with_arrays(blocks: Sequence[PartialBlock]) -> PartialBlock:
    photos, first = np.unique(np.concatenate([block.photos for block in blocks]), return_index=True)
    all_points = np.concatenate([block.points for block in blocks])
    order = np.argsort(all_points, kind="stable")
    points = all_points[order]
    coordinates = np.concatenate([block.coordinates for block in blocks])[order]
    deviations = np.concatenate([block.deviations for block in blocks])[order]
    steady = np.concatenate([steady_deviations(block) for block in blocks])[order]
    weights = 1.0 / np.maximum(steady, _tiny(coordinates)) ** 2
    is_first = np.ones(len(points), dtype=bool)
    is_first[1:] = points[1:] != points[:-1]
    starts, place = np.flatnonzero(is_first), np.cumsum(is_first) - 1
    count = np.bincount(place)
    mean = np.add.reduceat(weights * coordinates, starts) / np.add.reduceat(weights, starts)
    square = np.add.reduceat((coordinates - mean[place]) ** 2, starts)
    spread = np.sqrt(square / np.maximum(count - 1, 1)[:, None])
    once = count == 1
    mean[once], spread[once] = coordinates[starts[once]], deviations[starts[once]]
    return PartialBlock(
        blocks[0].name,
        photos,
        np.concatenate([block.rotations for block in blocks])[first],
        np.concatenate([block.centres for block in blocks])[first],
        points[starts],
        mean,
        spread,
    )


def _tiny(coordinates: FloatArray) -> float:
    """Return a deviation that is negligible beside the coordinates, where none is given."""
    return 1e-12 * float(np.abs(coordinates).max(initial=1e-300))


def steady_deviations(block: PartialBlock) -> FloatArray:
    """Return the deviations of a partial block as weights need them: none far below the median of its axis.

    An unknown one counts as the median; all count as 0 where none is known.
    """
    known = np.isfinite(block.deviations)
    if known.all() and known.size:
        return np.maximum(block.deviations, STEADY * medians(block.deviations))
    middle = np.array(
        [median(column[has]) if has.any() else 0.0 for column, has in zip(block.deviations.T, known.T, strict=True)]
    )
    return np.maximum(np.where(known, block.deviations, middle), STEADY * middle)
