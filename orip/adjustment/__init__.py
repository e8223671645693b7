"""Least squares that knows no camera: normal equations, point elimination, lost digits, Danish weights, precision."""

from orip import arrays as arrays  # before SciPy, so that parts of NumPy can wait
