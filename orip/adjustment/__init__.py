"""Least squares that knows no camera: normal equations, point elimination, lost digits, Danish weights, precision."""
