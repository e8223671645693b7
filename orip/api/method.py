"""The ways of adjusting that a caller may choose, as `orip solve` has them."""

from __future__ import annotations

from typing import Literal, get_args

from orip.bundle.methods import Method
from orip.bundle.snooping.search import SnoopingSettings
from orip.errors import UsageError

Sigma0 = Literal["apriori", "posteriori"]
_ALPHA = 1e-9, 0.5


def method_of(
    snoop: bool, sigma0: Sigma0 | None, alpha: float | None, prune: bool, variance_components: bool
) -> Method:
    """Return the method of an adjustment.

    Raises
    ------
    UsageError
        If `sigma0` or `alpha` is given without `snoop`, or is out of its range.
    """
    if not snoop and (sigma0 is not None or alpha is not None):
        message = "sigma0 and alpha go with snoop=True; add it, or leave them out"
        raise UsageError(message)
    if sigma0 is not None and sigma0 not in get_args(Sigma0):
        message = f"sigma0 is {sigma0!r}; it is one of {', '.join(get_args(Sigma0))}"
        raise UsageError(message)
    if alpha is not None and not _ALPHA[0] <= alpha <= _ALPHA[1]:
        message = f"alpha is {alpha!r}; it is a probability from {_ALPHA[0]:g} to {_ALPHA[1]:g}"
        raise UsageError(message)
    defaults = SnoopingSettings()
    settings = SnoopingSettings(sigma0 or defaults.sigma0, alpha)
    return Method(settings if snoop else None, prune, variance_components)
