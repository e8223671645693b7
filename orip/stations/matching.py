"""Which event is which photo's, by their times, whatever the offset of the camera's clock; and flight strips."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

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


NO_EVENT = -1

_SAMPLES = 7
"""Photos whose time differences with all events are tried as offsets of the clock."""

_DISTINCT = 2.0
"""Another offset with as many matches must leave residuals greater by this factor, or the offset is ambiguous."""

_MOST_CANDIDATES = 20_000


class Match(Struct, frozen=True):
    """Photos and their events.

    Parameters
    ----------
    event : array (number of photos,) of int
        `NO_EVENT`: none.
    offset : float
        Event time less photo time, seconds.
    rms : float
        Of what remains of the time differences, seconds.
    alternative : float or None
        Another offset that fits as well: the match is ambiguous.
    """

    event: IntArray
    offset: float
    rms: float
    alternative: float | None = None


def match_by_time(photo_time: FloatArray, event_time: FloatArray, tolerance: float) -> Match:
    """Match photos with events whose clock is offset by an unknown constant.

    The offset is the one that brings most photos to an event within the tolerance, and among those with as many, the
    one with the smallest remaining differences. Irregular intervals decide; where all are alike, another offset fits as
    well, and is returned as the alternative.

    Parameters
    ----------
    photo_time : array (n,)
        Seconds by the clock of the camera.
    event_time : array (m,)
        Seconds by the receiver.
    tolerance : float
        Seconds within which a photo belongs to an event.
    """
    if not len(photo_time) or not len(event_time):
        return Match(np.full(len(photo_time), NO_EVENT), 0.0, np.nan)
    trials = [match_at_offset(photo_time, event_time, offset, tolerance) for offset in
              _candidates(photo_time, event_time, tolerance)]  # fmt: skip
    trials.sort(key=lambda match: (-_count(match), match.rms))
    best = trials[0]
    for other in trials[1:]:
        if _count(other) < _count(best):
            break
        if abs(other.offset - best.offset) > tolerance and other.rms < _DISTINCT * max(best.rms, 1e-3):
            return Match(best.event, best.offset, best.rms, other.offset)
    return best


def match_at_offset(photo_time: FloatArray, event_time: FloatArray, offset: float, tolerance: float) -> Match:
    """Match photos with the nearest events at an offset, improved by the median of what remains."""
    order = np.argsort(event_time)
    for _ in range(2):
        event, difference = _nearest(photo_time + offset, event_time, order, tolerance)
        matched = event != NO_EVENT
        if not matched.any():
            return Match(event, offset, np.inf)
        offset += float(np.median(difference[matched]))
    event, difference = _nearest(photo_time + offset, event_time, order, tolerance)
    remaining = difference[event != NO_EVENT]
    rms = float(np.sqrt(np.mean(remaining**2))) if len(remaining) else np.inf
    return Match(event, offset, rms)


def _count(match: Match) -> int:
    return int(np.count_nonzero(match.event != NO_EVENT))


def _candidates(photo_time: FloatArray, event_time: FloatArray, tolerance: float) -> FloatArray:
    chosen = np.unique(np.linspace(0, len(photo_time) - 1, _SAMPLES).astype(int))
    differences = (event_time[None, :] - photo_time[chosen, None]).ravel()
    # one of each group within the tolerance: its median is found when it is tried
    rounded = np.unique(np.round(differences / tolerance)) * tolerance
    return np.asarray(rounded[:_MOST_CANDIDATES])


def _nearest(
    photo_time: FloatArray, event_time: FloatArray, order: IntArray, tolerance: float
) -> tuple[IntArray, FloatArray]:
    """Return the nearest event of each photo within the tolerance, of each event the nearest photo alone."""
    times = event_time[order]
    place = np.clip(np.searchsorted(times, photo_time), 1, max(len(times) - 1, 1))
    place = np.minimum(place, len(times) - 1)
    left = np.maximum(place - 1, 0)
    nearer = np.where(np.abs(times[left] - photo_time) <= np.abs(times[place] - photo_time), left, place)
    difference = times[nearer] - photo_time
    event = np.where(np.abs(difference) <= tolerance, order[nearer], NO_EVENT)
    for row in np.argsort(np.abs(difference), kind="stable")[::-1]:
        if event[row] != NO_EVENT and np.count_nonzero(event == event[row]) > 1:
            event[row] = NO_EVENT
    return np.asarray(event, dtype=np.int64), np.asarray(difference)
