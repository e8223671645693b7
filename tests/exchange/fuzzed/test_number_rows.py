"""Rows of numbers are taken together only where every word is one that a reader would take by itself."""

from __future__ import annotations

import numpy as np
import pytest

from orip.arrays import rows_of_groups
from orip.exchange.sources.text import sound_rows


def test_sound_rows_are_numbers() -> None:
    found = sound_rows(["0 12 -1.5e3 .25\n", "7  3\t+2. 1E-2"], 4, 2)
    assert found is not None
    assert found.tolist() == [[0.0, 12.0, -1500.0, 0.25], [7.0, 3.0, 2.0, 0.01]]


@pytest.mark.parametrize(
    "line",
    ["0 1 2", "0 1 2 3 4", "", "0 1 nan 3", "0 1 inf 3", "0 1 1_0 3", "0 1 1D3 3", "0 1 e5 3", "0 1 1e40 3", "-1 1 2 3",
     "1.0 1 2 3", "0 9999999999999999 2 3", "0 1 ٣ 3", "0 1 2,5 3"],
)  # fmt: skip
def test_one_doubtful_line_leaves_all_to_the_reader(line: str) -> None:
    assert sound_rows(["0 1 2 3"] * 3 + [line], 4, 2) is None


def test_rows_of_groups_are_those_of_a_search() -> None:
    group = np.random.default_rng(1).integers(-1, 5, 200)
    for number, rows in enumerate(rows_of_groups(group, 6)):
        assert rows.tolist() == np.flatnonzero(group == number).tolist()
    assert [len(rows) for rows in rows_of_groups(np.zeros(0, dtype=np.int64), 2)] == [0, 0]
