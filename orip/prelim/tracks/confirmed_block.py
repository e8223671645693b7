"""A block without the photo points that others contradict, where there are many of these."""

from __future__ import annotations

import numpy as np

from orip.prelim.measured_block import MeasuredBlock, measured_block_of
from orip.prelim.rays.photo_index import photo_index
from orip.prelim.rays.thinning import thinned
from orip.prelim.relative.pair_selection import common_point_counts
from orip.prelim.tracks.confirmation import votes_of

_POINTS_OF_TRACKS = 15
"""Points of the median photo from which so many points are common to three photos that wrong ones show."""

_SAMPLE, _MANY = 12, 0.03
"""Pairs of photos from which the part of the rays that others contradict is estimated, and the part from which the
block is one of tracks."""

_LEAST_RAYS = 2
_ENOUGH = 80
"""Points of a photo that are compared."""


def confirmed_block(measured: MeasuredBlock) -> MeasuredBlock | None:
    """Return the block without the rays that others contradict; None where these are few.

    Rays that could not be compared stay, and so does all control.
    """
    per_photo = np.bincount(measured.rays.photo, minlength=len(measured.rays.photos))
    if len(per_photo) < 3 or np.median(per_photo) < _POINTS_OF_TRACKS:
        return None
    all_rays = measured.all_rays
    control = np.array([name in measured.row_of and name in set(measured.control.names) for name in all_rays.points])
    rays = thinned(all_rays, control, _ENOUGH)
    index, common = photo_index(rays), common_point_counts(rays)
    sample = votes_of(rays, index, common, _SAMPLE)
    compared = np.count_nonzero(sample.compared)
    if np.count_nonzero(sample.contradicted) <= _MANY * compared:
        return None
    against = votes_of(rays, index, common).contradicted
    names = np.array(rays.points, dtype=object)
    refused = set(zip(rays.photo[against].tolist(), names[rays.point[against]].tolist(), strict=True))
    own = [all_rays.points[point] for point in all_rays.point.tolist()]
    kept = np.array([(photo, name) not in refused for photo, name in zip(all_rays.photo.tolist(), own, strict=True)])
    # where too few rays of control are left it is not known which are right
    left = np.bincount(all_rays.point[kept], minlength=len(control))
    kept |= (control & (left < _LEAST_RAYS))[all_rays.point]
    return measured_block_of(measured.block, all_rays, kept)
