"""The height above ground from which heights of points get a standard deviation that is wanted."""

from __future__ import annotations

import math
from collections.abc import Callable

from orip.errors import InputError

_CLOSE = 0.01
"""Relative difference from what is wanted at which no better height is sought."""

_MOST_TRIALS = 12
_FARTHEST = 8.0
"""Factor between a height and the next trial, at most."""

_GAIN = 0.8
"""Part of the standard deviation that half the height leaves at most, where lower flights help."""


def height_for(sd: float, first: float, sd_at: Callable[[float], float], unit: str) -> float:
    """Return the height at which a standard deviation is what is wanted, or up to a hundredth less.

    By regula falsi in logarithms: over like ground a standard deviation is nearly proportional to the height.

    Parameters
    ----------
    first : float
        A height to begin with.
    sd_at : callable
        Returns the standard deviation from a height; infinite where nothing determines the points.
    unit : str
        Of lengths.

    Raises
    ------
    InputError
        If no height gives it: positions or control are not known well enough.
    """
    tried: dict[float, float] = {}
    height = first
    for _ in range(_MOST_TRIALS):
        found = tried[height] = sd_at(height)
        if found <= sd and found >= sd * (1.0 - _CLOSE):
            return height
        farther = [value for one, value in tried.items() if one >= 2.0 * height and math.isfinite(value)]
        if found > sd and farther and found > _GAIN * min(farther):
            break  # a flight still lower would have thousands of photos
        height = _next(tried, sd * (1.0 - 0.5 * _CLOSE), height)
    kept = [one for one, value in tried.items() if value <= sd]
    if kept:
        return max(kept)
    best = min(tried, key=lambda one: tried[one])
    message = (
        f"sd = {sd:g} is not reached: the heights of the points get {tried[best]:.3g} {unit} from {best:.4g} {unit} "
        "above ground, and lower flights gain nothing; give smaller a-priori errors (position_error, control), more "
        "overlap, or a larger sd"
    )
    raise InputError.single(message, "orip.toml")


def _next(tried: dict[float, float], wanted: float, last: float) -> float:
    """Return the next height: between two that enclose what is wanted, or farther out."""
    low = max((one for one, value in tried.items() if value <= wanted), default=None)
    high = min((one for one, value in tried.items() if value > wanted and (low is None or one > low)), default=None)
    if low is not None and high is not None and math.isfinite(tried[high]):
        part = math.log(wanted / tried[low]) / math.log(tried[high] / tried[low])
        # of two ends one would stay for ever
        part = min(max(part, 0.1), 0.9)
        return float(low * (high / low) ** part)
    if low is not None and high is not None:
        return math.sqrt(low * high)
    ratio = wanted / tried[last] if math.isfinite(tried[last]) else 0.0
    return last * min(max(ratio, 1.0 / _FARTHEST), _FARTHEST)
