"""How long matching will take and how much memory: from the photos, and from how long the first of them took.

The figures of a photo and of a pair are replaced by those of this machine as soon as some are done; what comes later is
slower or faster by as much.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from orip.structs import replace
from orip.wording import counted

_PHOTO, _OF_MEGAPIXEL = 0.6, 0.04
"""Processor seconds for the features of a photo, and for each of its megapixels, to read it."""
_PAIR = 0.18
_POINTS = 1.05
"""For the 300 points of a photo: windows, matching, and the adjustment that examines them."""
_ADJUSTED = 0.2
"""For a photo in the adjustment and the report that follow."""
_BASE_GB, _PHOTO_GB = 0.2, 0.002
_THREAD_GB, _MEGAPIXEL_GB = 0.5, 0.005
"""Of a thread, and of each megapixel that it reads."""
_FIRST_PHOTOS, _FIRST_PAIRS = 4, 40
LEAST_S = 60.0
"""What takes less is not foretold."""


class Work(Struct, frozen=True):
    """What is to be matched.

    Parameters
    ----------
    photos : int
    megapixels : float
        Of a photo.
    pairs : int
        About.
    points : int
        Of a photo.
    threads : int
    adjusts : bool
        The adjustment and its report follow.
    """

    photos: int
    megapixels: float
    pairs: int
    points: int
    threads: int
    adjusts: bool = False


class Forecast(Struct, frozen=True):
    """What is expected of the work that is left.

    Parameters
    ----------
    seconds : float
    gigabytes : float
        At most, of memory.
    work : Work
    """

    seconds: float
    gigabytes: float
    work: Work


def foretold(work: Work, of_photo: float | None = None, of_pair: float | None = None) -> Forecast:
    """Return what is left of work: all of it, or, as soon as pairs are compared, what comes after the features.

    Parameters
    ----------
    of_photo, of_pair : float or None
        Seconds of a thread for the features of a photo, and for comparing two, as measured; None: not yet.
    """
    usual = _PHOTO + _OF_MEGAPIXEL * work.megapixels
    slowness = 1.0 if of_photo is None else of_photo / usual
    later = _POINTS * work.points / 300.0
    features = slowness * usual if of_pair is None else 0.0
    pair = slowness * _PAIR if of_pair is None else of_pair
    shared = work.photos * (features + slowness * later) + work.pairs * pair
    alone = work.photos * slowness * _ADJUSTED if work.adjusts else 0.0
    threads = work.threads * (_THREAD_GB + _MEGAPIXEL_GB * work.megapixels)
    return Forecast(shared / work.threads + alone, _BASE_GB + threads + work.photos * _PHOTO_GB, work)


def words(forecast: Forecast) -> str:
    """Say a forecast."""
    work, seconds = forecast.work, forecast.seconds
    time = counted(round(seconds / 60.0), "minute") if seconds < 5400.0 else f"{seconds / 3600.0:.1f} hours"
    return (
        f"about {time} and {forecast.gigabytes:.1f} GB of memory: {work.photos} photos of {work.megapixels:.0f} "
        f"megapixels, some {work.pairs} pairs, {counted(work.threads, 'processor')}"
    )


class Pace:
    """Times of photos and pairs while they are worked on, by several threads; says what they lead to expect.

    Parameters
    ----------
    work : Work
    tell : callable
        Is given each forecast, if it is of a minute or more.
    """

    def __init__(self, work: Work, tell: Callable[[Forecast], None]) -> None:
        self._work, self._tell = work, tell
        self._photos: list[float] = []
        self._pairs: list[float] = []
        self._told = 0

    def photo(self, seconds: float) -> None:
        """Take note of how long the features of a photo took."""
        self._photos.append(seconds)

    def pair(self, seconds: float) -> None:
        """Take note of how long a pair took."""
        self._pairs.append(seconds)

    def expect(self, pairs: int) -> None:
        """Take note of how many pairs are compared."""
        self._work = replace(self._work, pairs=pairs)

    def judge(self) -> None:
        """Say what is expected: once some photos are done, and again once some pairs are."""
        done = (len(self._photos) >= _FIRST_PHOTOS) + (len(self._pairs) >= _FIRST_PAIRS)
        if done <= self._told:
            return
        self._told = done
        photo, pair = (float(np.mean(times)) if times else None for times in (self._photos, self._pairs))
        forecast = foretold(self._work, photo, pair)
        if forecast.seconds >= LEAST_S:
            self._tell(forecast)
