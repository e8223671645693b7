"""Cells of long tables, against Python's own formatting of one number after the other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orip.files.text.table import Column, FixedCells, Table, deviation_cells
from orip.number_text import deviations, fixed

NUMBERS = st.floats() | st.floats(-1e4, 1e4) | st.integers(-(10**6), 10**6).map(lambda number: number / 2**6)
"""Any at all, usual ones, and those that end in a tie."""


def justified(cells: FixedCells) -> list[str]:
    return cells.justified(slice(None), cells.longest)


@given(st.lists(NUMBERS), st.integers(0, 8))
def test_cells_are_those_of_one_number_after_the_other(values: list[float], decimals: int) -> None:
    texts = fixed(values, decimals)
    cells = FixedCells(values, decimals)
    assert list(cells) == texts
    assert cells.longest == max(map(len, texts), default=0)
    assert justified(cells) == [text.rjust(cells.longest) for text in texts]


@given(st.lists(NUMBERS | st.sampled_from([np.nan, np.inf])), st.integers(0, 6))
def test_deviations_say_constant_and_singular(values: list[float], decimals: int) -> None:
    cells = deviation_cells(values, decimals)
    assert [text.strip() for text in justified(cells)] == deviations(values, decimals)


@pytest.mark.parametrize("decimals", range(7))
def test_numbers_around_ties_are_rounded_as_python_does(decimals: int) -> None:
    ties = (np.arange(-2000, 2000) + 0.5) / 10.0**decimals
    values = np.concatenate([np.nextafter(ties, -np.inf), ties, np.nextafter(ties, np.inf)])
    assert [text.strip() for text in justified(FixedCells(values, decimals))] == fixed(values, decimals)


@given(st.lists(st.integers(-1, 3)))
def test_rows_say_where_the_numbers_are(rows: list[int]) -> None:
    values = [1.25, -33.5, np.nan, 1e13]
    expected = fixed([values[row] if row >= 0 else np.nan for row in rows], 2)
    cells = FixedCells(values, 2, rows=np.array(rows, dtype=np.int64))
    assert list(cells) == expected
    assert len(cells) == len(rows)
    assert justified(cells) == [text.rjust(cells.longest) for text in expected]


def test_no_row_of_no_values_has_a_number() -> None:
    assert list(FixedCells([], 3, rows=np.array([-1, -1]))) == ["-", "-"]


def test_a_table_is_the_same_with_them_and_with_texts() -> None:
    values = np.linspace(-1234.5, 98.7, 20_000)  # more than are laid out at a time
    names = [f"P{number}" for number in range(len(values))]

    def table(cells: FixedCells | list[str]) -> Table:
        return Table([Column("Point", names, align="left"), Column("X", cells, "mm")])

    assert table(FixedCells(values, 3)).lines() == table(fixed(values, 3)).lines()
    assert list(table(FixedCells(values, 3)).each_row()) == table(fixed(values, 3)).rows()
