"""Coefficients of correlation at the end of lines of control: of X, Y, Z and of O, P, K, the rotations or angles."""

from __future__ import annotations

import math
from collections.abc import Sequence

from orip.files.text.lines import FieldReader

CORRELATION_KEYS = (
    "rXY", "rXZ", "rYZ", "rXO", "rXP", "rXK", "rYO", "rYP", "rYK", "rZO", "rZP", "rZK", "rOP", "rOK", "rPK",
)  # fmt: skip
"""Those of the position, and after them all others."""

_PLACES = tuple(("XYZOPK".index(key[1]), "XYZOPK".index(key[2])) for key in CORRELATION_KEYS)
_UNKNOWN = "-"


def read_covariance(
    reader: FieldReader, errors: Sequence[float], start: int, count: int
) -> tuple[tuple[float, ...], ...] | None:
    """Return the covariance matrix of errors from coefficients of correlation; see `read_correlations`."""
    matrix = read_correlations(reader, errors, start, count)
    if matrix is None:
        return None
    return tuple(
        tuple(abs(one * other) * coefficient for other, coefficient in zip(errors, row, strict=False))
        for one, row in zip(errors, matrix, strict=False)
    )


def read_correlations(
    reader: FieldReader, errors: Sequence[float | None], start: int, count: int
) -> tuple[tuple[float, ...], ...] | None:
    """Return the matrix of coefficients of correlation of errors, from some fields from one on.

    None where the line ends before, has dashes for all of them, or a complaint was made.

    Parameters
    ----------
    errors : sequence of 3 or 6 float or None
        None or NaN where they are not known.
    start, count : int
        The first field; how many there are at most: 3 or 15.
    """
    there = min(count, reader.count - start)
    for known in (3, 0):
        if there > known and all(reader.text(index) == _UNKNOWN for index in range(start + known, start + there)):
            there = known
    if there <= 0:
        return None
    import numpy as np  # most lines have no correlations

    size = 3 if there == 3 else 6
    matrix = np.eye(size)
    for index, place in zip(range(start, start + there), _PLACES, strict=False):
        matrix[place] = matrix[place[::-1]] = reader.decimal(index)
    if not np.isfinite(matrix).all():
        return None
    if np.linalg.eigvalsh(matrix)[0] <= 0.0:
        names = " ".join(CORRELATION_KEYS[:3]) + (f" ... {CORRELATION_KEYS[-1]}" if size > 3 else "")
        reader.complain(
            f"coefficients of correlation {names} that no {'three' if size == 3 else 'six'} errors can have; each is "
            "above -1 and below 1, and together they make a positive definite matrix. Correct them, or write '-' for "
            f"all {'three' if size == 3 else 'fifteen'}",
            start,
        )
        return None
    if any(error is None or math.isnan(error) or error == 0.0 for error in errors[:size]):
        of = "X, Y and Z" if size == 3 else "the position and of the angles"
        reader.complain(f"coefficients of correlation need errors of {of} that are not 0; write '-' for them", start)
        return None
    return tuple(tuple(row) for row in matrix.tolist())


def correlation_cells(covariance: Sequence[Sequence[float]] | None, decimals: int) -> list[str]:
    """Return all 15 coefficients of a covariance as fields; dashes for those that it does not have."""
    size = 0 if covariance is None else len(covariance)
    return [
        f"{covariance[row][column] / math.sqrt(covariance[row][row] * covariance[column][column]):.{decimals}f}"
        if covariance is not None and max(row, column) < size
        else _UNKNOWN
        for row, column in _PLACES
    ]
