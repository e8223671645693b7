"""Least squares that knows no camera: normal equations, point elimination, lost digits, Danish weights, precision."""

import orip.arrays  # noqa: F401  # before SciPy, so that parts of NumPy can wait
