"""residuals.csv: what a CSV reader finds in it is what the solution holds."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pytest
from hand_built_solutions import (
    COLUMNS,
    INF,
    LONG_NAME,
    NAN,
    ROWS,
    awkward,
    csv_pieces,
    csv_text,
    residuals,
    with_many_points,
)
from hypothesis import given
from hypothesis import strategies as st

from orip.files.result import residuals as module
from orip.number_text import shortest_texts
from orip.records.results.solution import Residuals


def rows_of(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text, newline="")))


def numbers(row: list[str]) -> list[float]:
    return [float(cell) if cell else NAN for cell in row[4:]]


def test_the_first_line_is_the_header() -> None:
    expected = (
        "kind,photo,point,component,observed,residual,a_priori,standard_residual,weight_factor,redundancy_number,w,"
        "adjusted_sd,minimal_detectable_bias,external_reliability"
    )
    assert csv_text(awkward().residuals).split("\n")[0] == expected


def test_every_row_reads_back_exactly() -> None:
    found = rows_of(csv_text(awkward().residuals))[1:]
    assert len(found) == len(ROWS)
    for row, expected in zip(found, ROWS, strict=True):
        assert row[:4] == list(expected[:4])
        np.testing.assert_array_equal(numbers(row)[:7], expected[4:])


def test_nan_is_an_empty_cell() -> None:
    line = csv_text(awkward().residuals).split("\n")[7]
    assert line == "photo,P102,7,x,1.5,0.25,-0.005,50.0,,,,,,"


def test_without_observations_there_is_the_header_alone() -> None:
    assert csv_text(residuals(())).count("\n") == 1


@given(st.lists(st.text(st.characters(exclude_categories=["Z", "C"]), min_size=1), min_size=1))
def test_any_name_survives(names: list[str]) -> None:
    rows = tuple(("photo", "P,1", name, "x", *[0.5] * len(COLUMNS)) for name in names)
    found = rows_of(csv_text(residuals(rows)))[1:]
    assert [row[2] for row in found] == names
    assert {row[1] for row in found} == {"P,1"}


@given(st.lists(st.floats(), min_size=1))
def test_any_number_survives(values: list[float]) -> None:
    rows = tuple(("photo", "P", "1", "x", *[value] * len(COLUMNS)) for value in values)
    for row, value in zip(rows_of(csv_text(residuals(rows)))[1:], values, strict=True):
        for number in numbers(row)[: len(COLUMNS)]:
            assert number == value or (math.isnan(number) and math.isnan(value))


def test_pieces_are_whole_lines_and_make_the_same_text(monkeypatch: pytest.MonkeyPatch) -> None:
    one_piece = csv_text(awkward().residuals)
    monkeypatch.setattr(module, "ROWS_PER_PIECE", 3)
    pieces = list(csv_pieces(awkward().residuals))
    assert len(pieces) > 3
    assert all(piece.endswith("\n") for piece in pieces)
    assert "".join(pieces) == one_piece


def test_many_rows() -> None:
    solution = with_many_points(9000)
    found: Residuals = solution.residuals
    rows = rows_of(csv_text(found))
    assert len(rows) == 1 + 9000 * 4 * 2
    assert {len(row) for row in rows} == {14}
    np.testing.assert_array_equal([float(row[5]) for row in rows[1:]], found.residual)


def test_long_names_are_not_shortened() -> None:
    assert f",{LONG_NAME}," in csv_text(awkward().residuals)


@given(st.lists(st.floats() | st.floats(-1.0, 1.0) | st.integers(-400, 400).map(lambda power: 10.0 ** (power / 10.0))))
def test_numbers_are_spelt_as_python_spells_them(values: list[float]) -> None:
    expected = ["" if value != value else repr(value) for value in values]
    assert shortest_texts(np.array(values, dtype=np.float64), missing="") == expected


@pytest.mark.parametrize(
    "value", [0.0, -0.0, NAN, INF, -INF, 1e-4, 9.999999999999999e-5, 1e16, 9999999999999998.0, 5e-324]
)
def test_a_number_in_every_row_is_spelt_as_python_spells_it(value: float) -> None:
    text = "" if value != value else repr(value)
    assert shortest_texts(np.full(3, value), missing="") == [text] * 3
    assert module._number_cells(np.full(3, value)) == [text] * 3


def test_zeros_of_both_signs_are_told_apart() -> None:
    assert module._number_cells(np.array([0.0, -0.0])) == ["0.0", "-0.0"]
