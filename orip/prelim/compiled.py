"""The compiled inner loops of preliminary values; where they could not be built, numpy does the same, slower."""

from __future__ import annotations

import numpy as np

from orip.adjustment.weights import danish_weights

try:
    from orip.prelim import _kernels as kernels
except ImportError:  # the extension is built where there is a compiler
    kernels = None  # type: ignore[assignment]  # whoever uses it asks is_compiled first

__all__ = ["LEAST_WEIGHT", "is_compiled", "kernels"]

LEAST_WEIGHT = float(danish_weights(np.array([np.inf]), 1.0)[0])
"""What the Danish method leaves to a residual that is as large as can be."""


def is_compiled() -> bool:
    """Tell whether the extension is there."""
    return kernels is not None
