"""Symmetric matrices of the reduced unknowns: full, as a band with a border, or by the fronts of a dissection."""

from __future__ import annotations

import numpy as np

from orip.adjustment.factorisation.band import BandMatrix
from orip.adjustment.factorisation.dissection.matrix import DissectedMatrix
from orip.arrays import FloatArray

Symmetric = FloatArray | BandMatrix | DissectedMatrix
"""A symmetric matrix (m, m); all kinds have a diagonal() and elements [rows, columns]."""


def scale_matrix(matrix: Symmetric, factors: FloatArray) -> None:
    """Multiply rows and columns of a matrix by factors (m,)."""
    if isinstance(matrix, np.ndarray):
        matrix *= factors
        matrix *= factors[:, None]
    else:
        matrix.scale(factors)


def subtract_product(matrix: Symmetric, left: FloatArray, right: FloatArray) -> None:
    """Subtract L R^T, a symmetric matrix of factors (m, k), from a matrix where it has elements."""
    if isinstance(matrix, np.ndarray):
        matrix -= left @ right.T
    else:
        matrix.subtract_product(left, right)


def add_to_diagonal(matrix: Symmetric, number: float) -> None:
    """Add a number to all elements of the diagonal of a matrix."""
    if isinstance(matrix, np.ndarray):
        matrix[np.arange(len(matrix)), np.arange(len(matrix))] += number
    else:
        matrix.add_to_diagonal(number)
