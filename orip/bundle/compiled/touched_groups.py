"""Which groups of unknowns are coupled: what the order of the reduced system follows from."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.arrays import BoolArray, IntArray
from orip.bundle.unknowns import CONSTANT, Unknowns

_CORRELATED = ("ANTENNA", "CAMERA")
"""Groups of unknowns whose correlations across records are results, where there are antennas."""


def touched_groups(
    unknowns: Unknowns,
    others: Iterable[IntArray | NDArray[np.int32]],
    touching: IntArray,
    touched: IntArray,
    count: int,
) -> tuple[IntArray, csr_array, BoolArray]:
    """Return the group (m,) of each reduced unknown, what touches the groups (r, g), and which are central (g,).

    A group is a record, or a tied point. Where antennas have unknowns, their correlations with each other and with
    those of cameras are results: these groups are central.

    Parameters
    ----------
    unknowns : Unknowns
    others : iterable of arrays (n, k) of int
        Unknowns that other observations touch, kind by kind; their rows come after the eliminated points.
    touching, touched : arrays (k,) of int
        Pairs of an eliminated point, or of points of the same photos, and a reduced unknown.
    count : int
        Number of these points.
    """
    groups = groups_of_unknowns(unknowns)
    rows_of, columns_of, first = [touching], [touched], count
    for columns in others:
        rows, places = np.nonzero((columns != CONSTANT) & (columns < unknowns.layout.reduced))
        rows_of.append(first + rows)
        columns_of.append(columns[rows, places].astype(np.int64))
        first += len(columns)
    names = unknowns.names.reduced
    kinds = np.array([names[place].group for place in np.flatnonzero(np.diff(groups, prepend=-1))])
    central = np.isin(kinds, _CORRELATED) & ("ANTENNA" in kinds)
    row, column = np.concatenate(rows_of), groups[np.concatenate(columns_of)]
    return groups, csr_array((np.ones(len(row)), (row, column)), shape=(first, len(kinds))), central


def groups_of_unknowns(unknowns: Unknowns) -> IntArray:
    """Return the group (m,) of each reduced unknown, ascending from 0."""
    records = [(name.group, name.name) for name in unknowns.names.reduced]
    changes = (one != other for one, other in pairwise(records))
    return np.cumsum([0, *changes])[: unknowns.layout.reduced]
