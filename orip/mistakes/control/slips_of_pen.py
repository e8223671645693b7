"""Slips in writing a number: a sign, a digit, two digits, the decimal point."""

from __future__ import annotations

import math
from collections.abc import Iterator

_NARROW = 0.2
"""Largest tolerance, as a part of the error of a value: with a larger one, some slip explains any value."""

_DISPLACED = "its decimal point is displaced"
_ONE_DIGIT = "one digit is wrong"

_DECISIVE = 0.15
"""Tolerance, as a part of the unit of a digit: with a larger one, some digit there explains any value."""

_CLOSE = 0.75
"""Part of the tolerance within which a value with another digit has to be: there are many digits to be tried."""


def slip_of_pen(value: float, seen: float, tolerance: float) -> str | None:
    """Return which slip in writing turns the value that the photos see into the one that was written.

    Parameters
    ----------
    value : float
        As written.
    seen : float
        As the photos see it.
    tolerance : float
        Largest difference between what was meant and what the photos see.

    Returns
    -------
    str or None
        The words that complete "X = 12.3 ..."; None where no slip explains the value.
    """
    if value == 0.0:
        return "was probably written because the value is not known: write - for it and for its error then"
    if tolerance > _NARROW * abs(value - seen):
        return None
    for meant, how in _slips(value):
        # every value is next to zero if its decimal point is displaced far enough
        is_told_from_zero = tolerance <= _NARROW * abs(meant) or how != _DISPLACED
        near = _CLOSE * tolerance if how == _ONE_DIGIT else tolerance
        is_decided = how != _ONE_DIGIT or near <= _DECISIVE * 10.0 ** _place(abs(meant - value))
        if abs(meant - seen) <= near and is_told_from_zero and is_decided:
            return f"is probably {meant:.10g}: {how}"
    return None


def _place(difference: float) -> int:
    """Return the power of ten of the digit by which two numbers differ."""
    return math.floor(math.log10(difference) + 1e-6)


def _slips(value: float) -> Iterator[tuple[float, str]]:
    """Yield what may have been meant, and the slip by which it was written otherwise; the likeliest first."""
    yield -value, "its sign is wrong"
    text = f"{value:.10g}"
    for meant in _with_two_digits_exchanged(text):
        yield meant, "two digits are exchanged"
    for power in (1, 2, 3):
        yield value * 10.0**power, _DISPLACED
        yield value / 10.0**power, _DISPLACED
    for place, digit in enumerate(text):
        for other in "0123456789" if digit.isdigit() else "":
            if other != digit:
                yield float(text[:place] + other + text[place + 1 :]), _ONE_DIGIT


def _with_two_digits_exchanged(text: str) -> Iterator[float]:
    """Yield a number with each two neighbouring digits exchanged, also across the decimal point."""
    for place in range(len(text) - 1):
        one = text[place]
        rest = text[place + 1 :].removeprefix(".")
        if one.isdigit() and rest and rest[0].isdigit() and rest[0] != one:
            after = len(text) - len(rest)
            exchanged = list(text)
            exchanged[place], exchanged[after] = exchanged[after], exchanged[place]
            yield float("".join(exchanged))
