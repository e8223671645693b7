"""Flight strips: parts of a flight on one course without a long pause."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray, IntArray

_TURN = np.radians(30.0)
"""A change of course that begins another strip."""

_PAUSE = 4.0
"""Usual intervals without an exposure that begin another strip."""

_LEAST = 3
"""Exposures of a strip; fewer between two strips were made while turning."""


def strips_of_flight(time: FloatArray, east: FloatArray, north: FloatArray) -> IntArray:
    """Return the number of the strip (n,) of each exposure, from 1; 0 for those made while turning.

    Parameters
    ----------
    time : array (n,)
        Seconds, increasing.
    east, north : arrays (n,)
        Metres, or a unit like that.
    """
    count = len(time)
    if count < _LEAST:
        return np.zeros(count, dtype=np.int64)
    course = np.arctan2(np.diff(east), np.diff(north))
    pause = np.diff(time) > _PAUSE * np.median(np.diff(time))
    begins = np.zeros(count, dtype=bool)
    begins[0] = True
    reference = course[0]
    for leg in range(1, count - 1):
        turned = abs((course[leg] - reference + np.pi) % (2.0 * np.pi) - np.pi) > _TURN
        if turned or pause[leg]:
            # the leg leads to another strip: the exposure at its end is the first of it
            begins[leg + 1] = True
            reference = course[min(leg + 1, count - 2)]
    number = np.cumsum(begins)
    sizes = np.bincount(number, minlength=number[-1] + 1)
    kept = np.flatnonzero(sizes >= _LEAST)
    renumbered = np.zeros(len(sizes), dtype=np.int64)
    renumbered[kept] = np.arange(1, len(kept) + 1)
    return np.asarray(renumbered[number])
