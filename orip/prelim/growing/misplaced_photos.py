"""Photos that are in the wrong place: their points do not fit them."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.growing.growing_block import GrowingBlock
from orip.prelim.medians import median
from orip.prelim.rays.image_rays import ImageRays

MISFIT = 5.0
"""Ratio of a residual to the median of all above which a point does not fit its photo."""

_FEWEST = 3
"""Number of points that do not fit from which a photo is doubted: fewer may be blunders."""

_OUT_OF_PLACE = 0.2
"""Part of its points that do not fit above which a photo is in the wrong place, if few may be wrong."""


def residual_lengths(rays: ImageRays, grown: GrowingBlock) -> FloatArray:
    """Return the lengths (n,) of the residuals of rays, as the system shows them, over their a-priori errors.

    Infinite for a point behind the photo, and for one that is in several oriented photos but not determined; NaN where
    the photo is not oriented, or is the only one with the point.
    """
    return (_in_compiled_loop if is_compiled() else _with_arrays)(rays, grown)


def _in_compiled_loop(rays: ImageRays, grown: GrowingBlock) -> FloatArray:
    """Do what `_with_arrays` does in the compiled loop."""
    lengths = np.empty(len(rays.photo))
    of_rays = rays.photo, rays.point, rays.vectors, rays.error, grown.rotations, grown.centres, grown.coordinates
    kernels.residual_lengths(*map(np.ascontiguousarray, of_rays), lengths)
    return lengths


def _with_arrays(rays: ImageRays, grown: GrowingBlock) -> FloatArray:
    offset = grown.coordinates[rays.point] - grown.centres[rays.photo]
    u = np.einsum("ni,nij->nj", offset, grown.rotations[rays.photo])
    with np.errstate(divide="ignore", invalid="ignore"):
        image = u[:, :2] * (rays.vectors[:, 2] / u[:, 2])[:, None]
        length = np.linalg.norm(image - rays.vectors[:, :2], axis=1) / rays.error
    oriented = grown.oriented[rays.photo]
    together = np.bincount(rays.point[oriented], minlength=len(rays.points))[rays.point] > 1
    lost = oriented & together & ~grown.known[rays.point]
    return np.where(lost, np.inf, np.where(u[:, 2] < 0.0, length, np.where(np.isnan(u[:, 2]), np.nan, np.inf)))


def unfit(lengths: FloatArray) -> BoolArray:
    """Return which of `residual_lengths` (n,) are far larger than usual; NaN is not among them."""
    judged = ~np.isnan(lengths)
    overall = median(lengths[judged]) if judged.any() else np.inf
    return np.asarray(lengths > MISFIT * max(overall, 1.0))


def misplaced_photos(rays: ImageRays, grown: GrowingBlock, lengths: FloatArray, blunders: float) -> BoolArray:
    """Return which oriented photos (number of photos,) do not fit their points: too many residuals are far too large.

    A photo none of whose points is seen by another one is among them.

    Parameters
    ----------
    rays : ImageRays
    grown : GrowingBlock
    lengths : array (n,)
        The system's `residual_lengths`.
    blunders : float
        Largest part of the known points of a photo that may be wrong.
    """
    # a point is wrong by its other rays as well, a ray by itself half as often
    part = max(_OUT_OF_PLACE, 0.5 * blunders)
    count = len(rays.photos)
    number = np.bincount(rays.photo[~np.isnan(lengths)], minlength=count)
    misfits = np.bincount(rays.photo[unfit(lengths)], minlength=count)
    return np.asarray(grown.oriented & (misfits >= np.maximum(part * number, np.minimum(_FEWEST, number))))
