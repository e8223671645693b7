"""Which photos share points: pairs that may be oriented relatively."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import IntArray
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.rays.image_rays import ImageRays


class Pair(NamedTuple):
    """Two photos, and how many points they share; `left` is the smaller index."""

    left: int
    right: int
    common: int


def common_point_counts(rays: ImageRays) -> IntArray:
    """Return the number of points that each two photos share, array (photos, photos); the diagonal has their own."""
    return (_compiled_counts if is_compiled() else _counts)(rays)


def _compiled_counts(rays: ImageRays) -> IntArray:
    """Do what `_counts` does in the compiled loop."""
    counts = np.empty((len(rays.photos), len(rays.photos)), dtype=np.int64)
    kernels.common_points(np.ascontiguousarray(rays.photo[rays.order_by_point()]), rays.point_starts(), counts)
    return counts


def _counts(rays: ImageRays) -> IntArray:
    from scipy.sparse import csr_array

    shape = (len(rays.photos), len(rays.points))
    seen = csr_array((np.ones(len(rays.photo), dtype=np.int64), (rays.photo, rays.point)), shape=shape)
    return np.asarray((seen @ seen.T).todense(), dtype=np.int64)


def pairs_by_common_points(counts: IntArray, fewest: int) -> list[Pair]:
    """Return the pairs with at least `fewest` points in common, those with most first."""
    left, right = np.nonzero(np.triu(counts >= fewest, k=1))
    common = counts[left, right]
    order = np.lexsort((right, left, -common))
    return [Pair(int(left[k]), int(right[k]), int(common[k])) for k in order]
