"""The types of bulk data: arrays whose shape and unit the docstring of their owner gives."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from orip.waiting_modules import WaitingMaskedArrays, let_wait

let_wait(np, "char", "ctypeslib", "f2py", "polynomial", "testing")  # SciPy takes all names of NumPy
let_wait(np, "ma", stand_in=WaitingMaskedArrays)

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_AT_A_TIME = 65536

Number = TypeVar("Number", float, FloatArray)
"""One coordinate of one point, or of n points as an array (n,)."""


def parts(count: int) -> Iterator[slice]:
    """Yield many thousands of `count` elements at a time.

    Intermediate results of so many stay in the processor's cache, and their memory is used again at once; new arrays as
    long as all observations of a block are cleared by the system, which takes as long as computing them.
    """
    for start in range(0, count, _AT_A_TIME):
        yield slice(start, min(start + _AT_A_TIME, count))


def distinct(numbers: IntArray) -> IntArray:
    """Return the different ones of whole numbers, ascending; faster than `np.unique`, which fills a table first."""
    ordered = np.sort(numbers)
    is_new = np.ones(len(ordered), dtype=bool)
    np.not_equal(ordered[1:], ordered[:-1], out=is_new[1:])
    return np.asarray(ordered[is_new])


def along_diagonal(*blocks: FloatArray) -> FloatArray:
    """Return a matrix with blocks (k, k') along its diagonal, zero elsewhere."""
    rows, columns = np.cumsum([(0, 0), *(block.shape for block in blocks)], axis=0).T
    matrix = np.zeros((rows[-1], columns[-1]))
    for block, row, column in zip(blocks, rows[:-1], columns[:-1], strict=True):
        matrix[row : row + block.shape[0], column : column + block.shape[1]] = block
    return matrix


def rows_of_groups(group: IntArray, count: int) -> list[IntArray]:
    """Return for each of `count` groups the rows in it, ascending; `group` (n,) is that of each row, -1 for none.

    In one pass: to look for the rows of every group takes as many passes as there are groups.
    """
    order = np.argsort(group, kind="stable")
    return list(np.split(order, np.searchsorted(group[order], np.arange(count + 1)))[1:-1])


def inverse_of_covariance(covariance: FloatArray) -> FloatArray:
    """Return the inverse of a covariance matrix; of one without an inverse, as of exact coordinates, the pseudoinverse.

    Singular values take ten times as long, and one is wanted for each of a thousand changes.
    """
    try:
        half = np.linalg.solve(np.linalg.cholesky(covariance), np.eye(len(covariance)))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(covariance))
    return np.asarray(half.T @ half)
