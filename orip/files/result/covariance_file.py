"""A covariance matrix as a file: NumPy's .npz, or CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray


class CovarianceMatrix(NamedTuple):
    """Covariances of n figures.

    Attributes
    ----------
    names : sequence of n str
        ``camera C35.C``, ``photo 102.X0``, ``point CP3.Z``.
    units : sequence of n str
    values : array (n,)
    covariance : array (n, n)
        In the products of these units.
    sigma0 : float
    run : str
        Of the adjustment.
    """

    names: Sequence[str]
    units: Sequence[str]
    values: FloatArray
    covariance: FloatArray
    sigma0: float
    run: str


def npz_bytes(matrix: CovarianceMatrix) -> bytes:
    """Return the matrix as an .npz with the arrays names, units, values, covariance, sigma0 and run."""
    file = io.BytesIO()
    np.savez_compressed(
        file, names=np.array(matrix.names, dtype=np.str_), units=np.array(matrix.units, dtype=np.str_),
        values=matrix.values, covariance=matrix.covariance, sigma0=np.array(matrix.sigma0), run=np.array(matrix.run),
    )  # fmt: skip
    return file.getvalue()


def csv_bytes(matrix: CovarianceMatrix) -> bytes:
    """Return the matrix as CSV: name, unit, value, and a column for each figure; numbers with all digits."""
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["name", "unit", "value", *matrix.names])
    rows = zip(matrix.names, matrix.units, matrix.values.tolist(), matrix.covariance.tolist(), strict=True)
    for name, unit, value, row in rows:
        writer.writerow([name, unit, repr(value), *map(repr, row)])
    return file.getvalue().encode()
