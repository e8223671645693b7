"""Numbers as people read them: decimals that follow from the precision, words where there is no number.

Listings print columns of equal decimals in plain text; `orip.report.table` has what the report's page does otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from orip.arrays import FloatArray

CONSTANT = "constant"
SINGULAR = "singular"
MISSING = "-"

HUGE = 1e12
"""From here on numbers are printed with an exponent: they come from a diverged adjustment and mean nothing else."""

_WITHOUT_EXPONENT = 1e-4, 1e16
"""Between these, repr writes no exponent."""

COEFFICIENT_PRECISION = 1e-4
"""A number with a smaller standard deviation is not a length or an angle but a distortion coefficient: it is printed
with an exponent."""


def decimals_for(deviations: ArrayLike, at_least: int = 3, at_most: int = 6) -> int:
    """Return the decimals with which the smallest standard deviation has two significant digits.

    Parameters
    ----------
    deviations : array of any shape
        Those that are not finite and positive do not count.
    at_least, at_most : int
        Limits; `at_least` is also the answer where no deviation counts.
    """
    known = known_precisions(deviations)
    return decimals_of_two_digits(float(known.min()), at_least, at_most) if known.size else at_least


def known_precisions(deviations: ArrayLike) -> FloatArray:
    """Return the standard deviations that are finite and positive, as one row."""
    known = np.asarray(deviations, dtype=np.float64)
    return known[np.isfinite(known) & (known > 0.0)]


def decimals_of_two_digits(precision: float, at_least: int, at_most: int) -> int:
    """Return the decimals with which a precision has two significant digits, between the limits."""
    return min(max(math.ceil(-math.log10(precision)) + 1, at_least), at_most)


def decimals_of(values: ArrayLike, at_least: int = 3, at_most: int = 6) -> int:
    """Return the decimals that print all finite values in full, between the limits."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    for decimals in range(at_least, at_most):
        if np.array_equal(np.round(known, decimals), known):
            return decimals
    return at_most


def fixed(values: Iterable[float], decimals: int, missing: str = MISSING) -> list[str]:
    """Return numbers with equal decimals; `missing` for NaN, never a negative zero."""
    form = f"z.{decimals}f"
    return [
        format(value, form) if -HUGE < value < HUGE else _unusual(value, missing)
        for value in np.asarray(values, dtype=np.float64).tolist()
    ]


def one_fixed(value: float, decimals: int, missing: str = MISSING) -> str:
    """Return one number as `fixed` prints it."""
    return fixed([value], decimals, missing)[0]


def shortest_texts(values: FloatArray, missing: str) -> list[str]:
    """Return the shortest texts that read back exactly, as `repr` writes them; `missing` for NaN."""
    if not values.size:
        return []
    # one call a list, and in C: four times faster than repr
    texts = msgspec.json.encode(values.tolist()).decode("ascii")[1:-1].split(",")
    size = np.abs(values)
    # small and large numbers have an exponent in other places, or spelt otherwise; JSON has no infinity
    unlike = ~((size >= _WITHOUT_EXPONENT[0]) & (size < _WITHOUT_EXPONENT[1]) | (size == 0.0))
    for place in np.flatnonzero(unlike).tolist():
        value = float(values[place])
        texts[place] = missing if math.isnan(value) else repr(value)
    return texts


def scientific(values: Iterable[float], missing: str = MISSING) -> list[str]:
    """Return numbers with an exponent and seven digits; `missing` for NaN."""
    return [missing if math.isnan(value) else f"{value:z.6e}" for value in map(float, values)]


def deviations(values: Iterable[float], decimals: int | None) -> list[str]:
    """Return standard deviations, "constant" for NaN and "singular" for infinity; decimals None: with an exponent."""
    texts = scientific(values, CONSTANT) if decimals is None else fixed(values, decimals, CONSTANT)
    return [SINGULAR if text == "inf" else text for text in texts]


def root_mean_square(values: ArrayLike) -> float:
    """Return the root mean square of the values that are finite; NaN where there are none."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if known.size == 0:
        return math.nan
    with np.errstate(over="ignore"):  # a diverged adjustment may have any residual
        return float(np.sqrt(np.mean(known**2)))


def measure(value: float, precision: float) -> str:
    """Return a number with the decimals that its own precision (its a-priori error or standard deviation) calls for.

    For columns in which units and magnitudes change from row to row.
    """
    if 0.0 < abs(precision) < COEFFICIENT_PRECISION:
        return scientific([value])[0]
    return one_fixed(value, decimals_for(abs(precision) / 10.0))


def _unusual(value: float, missing: str) -> str:
    if math.isnan(value):
        return missing
    return f"{value:.6e}" if math.isfinite(value) else str(value)
