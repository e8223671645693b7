"""Numbers as the page shows them, where that differs from the listings: a dash, other words, fewer digits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from orip.number_text import COEFFICIENT_PRECISION, CONSTANT, decimals_of_two_digits, known_precisions
from orip.wording import agreeing

MISSING = "–"
SINGULAR = "not determined"

_HUGE = 1e9


def decimals_for(precision: ArrayLike, at_most: int = 6) -> int:
    """Return the decimals with which the smaller ones of these precisions have two significant digits.

    Parameters
    ----------
    precision : array of any shape
        Standard deviations, for instance; those that are not finite and positive do not count. The smallest twentieth
        does not decide, so that one outstanding point does not lengthen the numbers of all.
    at_most : int
    """
    known = known_precisions(precision)
    return decimals_of_two_digits(float(np.quantile(known, 0.05)), 0, at_most) if known.size else min(3, at_most)


def fixed(value: float, decimals: int) -> str:
    """Return a number with decimals; a dash for NaN."""
    if math.isnan(value):
        return MISSING
    return f"{value:z.{decimals}f}" if abs(value) < _HUGE else f"{value:.4g}"


def deviation(value: float, decimals: int) -> str:
    """Return a standard deviation: words for NaN, a constant, and infinity, an unknown that nothing determines."""
    if math.isnan(value):
        return CONSTANT
    return SINGULAR if math.isinf(value) else fixed(value, decimals)


def parameter(value: float, sd: float) -> tuple[str, str]:
    """Return the value and the sd of a camera parameter; each parameter has its own number of decimals."""
    if not (math.isfinite(sd) and sd > 0.0):
        return f"{value:.6g}", deviation(sd, 3)
    if sd >= COEFFICIENT_PRECISION:
        decimals = decimals_for(sd)
        return fixed(value, decimals), fixed(sd, decimals)
    digits = max(math.floor(math.log10(abs(value) / sd)) + 1, 1) if value and math.isfinite(value) else 1
    return f"{value:z.{min(digits, 9)}e}", f"{sd:.1e}"


def significant(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, without an exponent where that is readable; a dash for NaN."""
    if math.isnan(value):
        return MISSING
    if math.isinf(value):
        return SINGULAR
    if value == 0.0 or not 1e-4 <= abs(value) < _HUGE:
        return f"{value:.{digits}g}"
    return f"{value:z.{max(digits - 1 - math.floor(math.log10(abs(value))), 0)}f}"


def probability(p: float) -> str:
    """Return what follows ``p``: the sign (=, <) and the probability."""
    if p < 1e-4:
        return "< 0.0001"
    return "> 0.999" if p > 0.999 else f"= {p:.3f}" if p < 0.01 else f"= {p:.2f}"


def counted(number: int, noun: str) -> str:
    """Return ``1 photo`` or ``3 000 photos``."""
    return f"{number:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") + f" {agreeing(number, noun)}"
