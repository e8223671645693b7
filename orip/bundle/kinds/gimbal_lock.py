"""Where phi is near ±90 degrees omega and kappa turn about the same axis: neither can be observed alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError

_LEAST_COSINE_OF_PHI = 0.02
"""Of 88.9 degrees."""


def require_separable_angles(phi: FloatArray, name: Callable[[int], tuple[str, str]]) -> None:
    """Require that omega and kappa of observed rotations can be told apart.

    Parameters
    ----------
    phi : array (n,)
        Radians.
    name : callable
        Takes a place among the n; returns what is observed, and what to do about it.

    Raises
    ------
    InputError
    """
    too_close = np.flatnonzero(np.abs(np.cos(phi)) < _LEAST_COSINE_OF_PHI)
    if len(too_close):
        observed, remedy = name(int(too_close[0]))
        message = (
            f"{observed} is observed, but its phi is within 1.1 degrees of ±90, where omega and kappa cannot be "
            f"separated; {remedy}"
        )
        raise InputError.single(message)
