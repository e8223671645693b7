"""Observation equations that touch reduced unknowns alone."""

from __future__ import annotations

from typing import NamedTuple

from orip.arrays import FloatArray, IntArray


class ReducedRows(NamedTuple):
    """k observation equations in reduced unknowns alone.

    Attributes
    ----------
    columns : array (c,) of int
        Unknowns that they touch, ascending.
    rows : array (k, c)
        Partials, divided by the a-priori errors.
    right : array (k,)
        Observed minus computed, divided by the a-priori errors.
    """

    columns: IntArray
    rows: FloatArray
    right: FloatArray
