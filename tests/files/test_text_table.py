"""Tables: nothing shortened, nothing run together, columns in line; and numbers as they are printed."""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orip.files.text.table import Alignment, Column, Table, fitted_tables, key_lines, one_line, paragraph, table_lines
from orip.number_text import (
    decimals_for,
    decimals_of,
    deviations,
    fixed,
    measure,
    one_fixed,
    root_mean_square,
    scientific,
)

word = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=40)
number = st.floats(-1e9, 1e9).map(lambda value: f"{value:.4f}")
alignment: st.SearchStrategy[Alignment] = st.sampled_from(["left", "right", "point"])


@st.composite
def columns(draw: st.DrawFn) -> list[Column]:
    rows = draw(st.integers(1, 6))
    cells = st.lists(st.one_of(word, number), min_size=rows, max_size=rows)
    count = draw(st.integers(1, 6))
    gap = draw(st.integers(2, 5))
    return [Column(draw(word), draw(cells), draw(word), draw(alignment), gap) for _ in range(count)]


@given(columns())
def test_every_cell_stands_whole_and_apart_from_its_neighbours(table: list[Column]) -> None:
    lines = table_lines(table)
    for i, line in enumerate(lines[3:]):
        assert re.split(" {2,}", line.strip()) == [column.cells[i] for column in table]
    assert re.split(" {2,}", lines[0].strip()) == [column.heading for column in table]
    assert re.split(" {2,}", lines[1].strip()) == [f"({column.unit})" for column in table]


@given(columns())
def test_columns_stay_within_the_rule_under_their_headings(table: list[Column]) -> None:
    lines = table_lines(table)
    spans = [match.span() for match in re.finditer("-+", lines[2])]
    assert len(spans) == len(table)
    for line in (*lines[:2], *lines[3:]):
        for (_, end), (start, _) in itertools.pairwise(spans):
            assert line[end:start].strip() == ""
        assert line[spans[-1][1] :] == ""
        assert line == line.rstrip()


@given(columns())
def test_a_part_of_a_table_has_the_lines_of_the_whole(table: list[Column]) -> None:
    whole = Table(table)
    rows = len(table[0].cells)
    assert [line for i in range(rows) for line in whole.rows(i, i + 1)] == whole.rows()


def test_decimal_points_stand_under_one_another() -> None:
    rows = Table([Column("Value", ["8.5951", "-1.234567e-05", "constant", "-"], align="point")]).rows()
    assert rows[0].index(".") == rows[1].index(".")
    assert rows[2].endswith("constant")


def test_a_table_without_rows_says_none() -> None:
    assert table_lines([Column("Point", [])]) == ["  none"]


def test_a_column_without_heading_has_no_rule() -> None:
    assert table_lines([Column("a", ["1"]), Column("", ["remark"])]) == ["  a", "  -", "  1  remark"]


def test_unequal_columns_are_refused() -> None:
    with pytest.raises(ValueError, match="equally long"):
        Table([Column("a", ["1"]), Column("b", [])])


def test_braces_in_names_are_names() -> None:
    assert table_lines([Column("Point", ["{0}", "%s"], align="left")])[2:] == ["  {0}", "  %s"]


@given(st.text())
def test_free_text_cannot_break_out_of_its_line(text: str) -> None:
    assert one_line(text).isprintable()
    words = " ".join(line.strip() for line in paragraph(text))
    assert words == one_line(text)


def test_key_lines() -> None:
    lines = key_lines([("Redundancy", "12", ""), ("Unknowns", "7", "1 removed")])
    assert lines == ["  Redundancy  12", "  Unknowns     7  1 removed"]


@pytest.mark.parametrize(
    ("smallest", "decimals"), [(2.0, 3), (0.5, 3), (0.012, 3), (0.0099, 4), (0.001, 4), (0.00042, 5), (1e-9, 6)]
)
def test_decimals_follow_the_smallest_standard_deviation(smallest: float, decimals: int) -> None:
    assert decimals_for([[math.nan, 3.0], [smallest, math.inf], [0.0, 5.0]]) == decimals


def test_without_standard_deviations_numbers_are_printed_in_full() -> None:
    assert decimals_for([math.nan, math.inf]) == 3
    assert decimals_of([1.0, 1000482.579395, math.nan]) == 6
    assert decimals_of([1.0, 2.0005]) == 4
    assert decimals_of([]) == 3


@given(st.floats(-1e11, 1e11), st.integers(0, 7))
def test_a_printed_number_is_the_number_to_its_digits(value: float, decimals: int) -> None:
    text = one_fixed(value, decimals)
    assert abs(float(text) - value) <= 0.5 * 10.0**-decimals + abs(value) * 1e-15
    assert not re.fullmatch(r"-0*\.?0*", text)


def test_words_for_what_is_no_number() -> None:
    assert fixed([math.nan, -0.00001, 1e30, -math.inf], 3) == ["-", "0.000", "1.000000e+30", "-inf"]
    assert scientific([math.nan, -0.0, 2.5e-11]) == ["-", "0.000000e+00", "2.500000e-11"]
    assert deviations([math.nan, math.inf, 0.0125], 4) == ["constant", "singular", "0.0125"]
    assert deviations([math.nan, math.inf, 0.0125], None) == ["constant", "singular", "1.250000e-02"]


def test_a_measure_has_the_decimals_of_its_precision() -> None:
    assert measure(1000482.579395, 0.02) == "1000482.5794"
    assert measure(1.25e-5, 1e-6) == "1.250000e-05"
    assert measure(12.5, -5.0) == "12.500"
    assert measure(math.nan, 0.1) == "-"


def test_root_mean_square_leaves_out_what_is_no_number() -> None:
    assert root_mean_square([3.0, math.nan, -4.0]) == pytest.approx(math.sqrt(12.5))
    assert math.isnan(root_mean_square([]))
    assert root_mean_square(np.array([1e200])) == math.inf


TABLE = """\
  Point  Kind  Rays        X      sX
                         (m)     (m)
  -----  ----  ----  -------  ------
  1101   tie      2   37.856   0.020
  1102   -        -        -       -

  Root mean square
"""


def test_columns_that_do_not_fit_are_left_out_and_named() -> None:
    assert fitted_tables(TABLE, 36) == TABLE
    lines = fitted_tables(TABLE, 30).splitlines()
    assert lines[:5] == [
        "  Point  Kind  Rays        X",
        "                         (m)",
        "  -----  ----  ----  -------",
        "  1101   tie      2   37.856",
        "  1102   -        -        -",
    ]
    assert " ".join(lines[5:-2]) == "The window has 30 columns; left out: sX. A wider one or '> FILE' has them."
    assert lines[-2:] == ["", "  Root mean square"]
    narrow = fitted_tables(TABLE, 20)
    assert "left out: X, sX." in " ".join(narrow.split())
    assert max(map(len, narrow.splitlines())) <= 20
    assert "left out: Kind, Rays, X, sX." in " ".join(fitted_tables(TABLE, 5).split()), "names of rows always stay"
