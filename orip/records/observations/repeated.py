"""Points that are measured in a photo more than once: which measurement it is, and what it is called."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, IntArray
from orip.records.coded_names import coded
from orip.records.names import record_key
from orip.records.observations.measurement import PhotoObservations


def measured_before(photo: IntArray, point: IntArray) -> IntArray:
    """Return how often the point of each of n measurements was measured in that photo before.

    Parameters
    ----------
    photo, point : arrays (n,) of int
        Numbers from 0.

    Returns
    -------
    array (n,) of int
        0 for the first measurement.
    """
    both = photo * (point.max(initial=0) + 1) + point
    # mostly measured in this order, in which a stable sort leaves what is there; without places it is quicker
    ordered = np.sort(both, kind="stable")
    if (ordered[1:] != ordered[:-1]).all():
        return np.zeros(len(both), dtype=np.int64)
    order = np.argsort(both, kind="stable")
    first = np.flatnonzero(np.diff(both[order], prepend=-1))
    before = np.empty(len(both), dtype=np.int64)
    before[order] = np.arange(len(both)) - np.repeat(first, np.diff(np.append(first, len(both))))
    return before


def observed_before(observations: PhotoObservations) -> IntArray:
    """Return how often each of n photo observations was measured before, as `measured_before`; photos by their keys."""
    number: dict[str, int] = {}
    photo = coded(observations.photos).numbers(lambda name: number.setdefault(record_key(name), len(number)))
    return measured_before(photo, coded(observations.points).codes.astype(np.int64))


def measurement_name(point: str, before: int) -> str:
    """Return what a measurement of a point is called: ``17``, and ``17 (2)`` for the second one in its photo.

    Names of points have no blanks, so no point is called so.
    """
    return f"{point} ({before + 1})" if before else point


def point_of_measurement(name: str) -> str:
    """Return the point that a measurement of `measurement_name` is of; any other name as it is."""
    if not name.endswith(")"):
        return name
    point, _, number = name.rpartition(" (")
    return point if point and number.removesuffix(")").isdigit() else name


def photos_per_point(photo: IntArray, point: IntArray, chosen: BoolArray, points: int) -> IntArray:
    """Return in how many photos each point (points,) is measured by the chosen ones of n photo points."""
    if not chosen.all():
        photo, point = photo[chosen], point[chosen]
    before = measured_before(photo, point)
    return np.bincount(point[before == 0] if before.any() else point, minlength=points)
