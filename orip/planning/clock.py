"""A computer's clock against the receiver's marks, one a second: offset, drift, wrong marks, GPS times of photos.

The clock reads c = a + b (s - m) at the second s, with m the mean second: two unknowns by least squares from all marks.
A mark that does not fit is left out, the worst first (data snooping, Baarda 1968).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.adjustment.outlier_tests import OutlierTest
from orip.arrays import BoolArray, FloatArray
from orip.errors import InputError

_ALPHA = 0.05
"""Probability that any of the marks is left out if all are right."""

_FEWEST = 4


class ClockFit(Struct, frozen=True):
    """A clock as marks show it.

    Parameters
    ----------
    reading, rate : float
        At the second `middle`, and its increase a second: 1 + drift.
    middle : float
        GPS seconds.
    jitter : float
        Standard deviation of one reading, seconds.
    wrong : tuple of int
        Marks that were left out.
    residuals : array (n,)
        Of all marks, seconds: predicted minus read.
    """

    reading: float
    rate: float
    middle: float
    jitter: float
    reading_sd: float
    rate_sd: float
    wrong: tuple[int, ...]
    residuals: FloatArray

    @property
    def drift(self) -> float:
        """Return by how much the clock gains, a part of the time."""
        return self.rate - 1.0

    def times(self, readings: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return GPS times (n,) of clock readings and their standard deviations, with the jitter of the reading."""
        since = (readings - self.reading) / self.rate
        sd = np.sqrt(self.jitter**2 + self.reading_sd**2 + (since * self.rate_sd) ** 2) / self.rate
        return self.middle + since, sd


def seconds_of_marks(readings: FloatArray, known: Sequence[tuple[int, float]]) -> FloatArray:
    """Return the GPS second (n,) of each mark, counted from one whose second is known.

    Parameters
    ----------
    readings : array (n,)
        In seconds, ascending.
    known : sequence of (mark, second)

    Raises
    ------
    InputError
        If the known seconds contradict each other.
    """
    steps = np.diff(readings)
    whole = np.rint(steps)
    sound = (whole >= 1.0) & (np.abs(steps - whole) < 0.1 * whole)
    rate = float(np.median(steps[sound] / whole[sound])) if sound.any() else 1.0
    counted = (readings - readings[0]) / rate
    # marks that are right have the same part of a second, however many others there are
    phase = float(np.angle(np.mean(np.exp(2j * math.pi * counted))) / (2.0 * math.pi))
    number = np.rint(counted - phase)
    starts = np.array([second - number[mark] for mark, second in known])
    if len(starts) == 0 or np.ptp(starts) > 0.5:
        message = (
            "no mark has its GPS second; give it with one of them: PPS reading second"
            if len(starts) == 0
            else f"the seconds given with marks differ by {np.ptp(starts):g} from what is counted; correct one of them"
        )
        raise InputError.single(message)
    return np.asarray(number + np.rint(np.median(starts)))


def fit_clock(readings: FloatArray, seconds: FloatArray) -> ClockFit:
    """Return offset and drift of a clock, and the marks that do not fit.

    Parameters
    ----------
    readings, seconds : arrays (n,)

    Raises
    ------
    InputError
        If fewer than four marks are left.
    """
    used = np.ones(len(readings), dtype=bool)
    while True:
        if np.count_nonzero(used) < _FEWEST:
            message = f"{np.count_nonzero(used)} marks fit a clock that gains evenly; {_FEWEST} at least are needed"
            raise InputError.single(message)
        fit, w = _fitted(readings, seconds, used)
        worst = int(np.argmax(np.where(used, w, -1.0)))
        redundancy = int(np.count_nonzero(used)) - 2
        if w[worst] <= OutlierTest(_ALPHA, 1.0, redundancy).limit(redundancy + 2):
            return fit
        used[worst] = False


def _fitted(readings: FloatArray, seconds: FloatArray, used: BoolArray) -> tuple[ClockFit, FloatArray]:
    """Return the clock by the marks in use, and their normalised residuals (n,)."""
    middle = float(seconds[used].mean())
    since = seconds - middle
    square = float(np.sum(since[used] ** 2))
    if square == 0.0:
        message = "all marks are of one second; record them for some minutes"
        raise InputError.single(message)
    reading = float(readings[used].mean())
    rate = float(np.sum(since[used] * (readings[used] - reading)) / square)
    residuals = reading + rate * since - readings
    count = int(np.count_nonzero(used))
    jitter = float(np.sqrt(np.sum(residuals[used] ** 2) / (count - 2)))
    part = 1.0 - 1.0 / count - since**2 / square
    w = np.abs(residuals) / (max(jitter, 1e-15) * np.sqrt(np.maximum(part, 1e-12)))
    wrong = tuple(np.flatnonzero(~used).tolist())
    return ClockFit(
        reading, rate, middle, jitter, jitter / math.sqrt(count), jitter / math.sqrt(square), wrong, residuals
    ), w
