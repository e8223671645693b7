"""The types of bulk data: arrays whose shape and unit the docstring of their owner gives."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Number = TypeVar("Number", float, FloatArray)
"""One coordinate of one point, or of n points as an array (n,)."""
