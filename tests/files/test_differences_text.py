"""Differences between exposure stations: what is written is read again, and what is said of faulty lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from orip.files.control.stations_text import differences_text, read_differences
from orip.files.text.shown import Parsed
from orip.records.control import StationDifference

SIX = "1 2 3 0.1 0.1 0.1"


def parse(folder: Path, text: str) -> Parsed[tuple[StationDifference, ...]]:
    path = folder / "Z.REL"
    path.write_text(text, encoding="utf-8")
    return read_differences(path, "Z")


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    root = np.random.default_rng(1).normal(size=(6, 6)) * np.repeat([0.02, 1e-4], 3)[:, None]
    covariance = root @ root.T
    error = np.sqrt(np.diag(covariance))
    one = StationDifference(
        "A", "B", (41.0, 0.5, -0.25), tuple(error[:3]), (0.001, -0.002, 3.0), tuple(error[3:]),
        tuple(map(tuple, covariance)),
    )  # fmt: skip
    other = StationDifference("B", "C", (1.0, 2.0, 3.0), (0.1, -0.1, 0.2))
    parsed = parse(tmp_path, differences_text([one, other]))
    assert not parsed.complaints
    first, second = parsed.value
    assert (first.first, first.second, first.name) == ("A", "B", "A-B")
    np.testing.assert_allclose(first.position, one.position, atol=1e-5)
    np.testing.assert_allclose(first.angles, one.angles, atol=1e-8)
    scaled = (np.array(first.covariance) - covariance) / np.outer(error, error)
    assert np.abs(scaled).max() < 2e-3
    assert (second.position_error, second.covariance, np.isnan(second.angles).all()) == ((0.1, -0.1, 0.2), None, True)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("A B 1 2 3", "Z:1:11: a field is missing, 5 found; the line is: first second dX dY dZ aX aY aZ"),
        ("A a 1 2 3 1 1 1", "photo 'A' is both the first and the second; name two photos"),
        (f"A B {SIX}\nb A {SIX}", "Z:2: these two photos are already on line 1"),
        ("A B 1 2 3 1 1 0", "an error of 0; differences are observed, not constant"),
        ("A B 1 2 - 1 1 1", "'-' for a part of the position; give dX, dY and dZ"),
        ("A B - - - - - -", "neither a difference of positions nor a rotation"),
        (f"A B {SIX} {SIX} " + "0.9 0.9 -0.9 " + "0 " * 12, "that no six errors can have"),
        (f"A B - - - - - - {SIX} " + "0 " * 15, "need errors of the position and of the angles that are not 0"),
        ("first second dX dY dZ aX aY aZ", "this line has no numbers"),
    ],
)
def test_faulty_lines(tmp_path: Path, line: str, words: str) -> None:
    parsed = parse(tmp_path, line)
    assert any(words in str(complaint) for complaint in parsed.complaints), parsed.complaints


def test_a_file_that_is_absent_has_no_differences(tmp_path: Path) -> None:
    assert read_differences(tmp_path / "NONE.REL", "N") == Parsed(())
