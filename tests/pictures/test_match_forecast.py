"""What matching foretells of its time and memory: from times that are given, and on rendered photos."""

from __future__ import annotations

import re

import numpy as np
import pytest
from cli.command_line import orip
from pictures.rendered_plane import render
from pictures.test_match_command import SIDE, project

from orip.pictures import forecast
from orip.pictures.forecast import Forecast, Pace, Work, foretold, words
from orip.pictures.matching.pairs import expected_pairs, neighbouring_pairs

WORK = Work(photos=1000, megapixels=12.0, pairs=10_000, points=300, threads=2)


def test_twice_the_work_takes_twice_as_long_and_two_threads_half() -> None:
    first = foretold(WORK, 1.0, 0.3).seconds
    doubled = Work(2000, 12.0, 20_000, 300, 2)
    assert foretold(doubled, 1.0, 0.3).seconds == pytest.approx(2.0 * first)
    assert foretold(Work(1000, 12.0, 10_000, 300, 1), 1.0, 0.3).seconds == pytest.approx(2.0 * first)
    # a pair that takes a second more, on each of two threads
    assert foretold(WORK, 1.0, 1.3).seconds - first == pytest.approx(5000.0)


def test_a_slower_machine_takes_longer_in_all_that_follows() -> None:
    one, other = (foretold(WORK, seconds).seconds for seconds in (1.0, 3.0))
    assert other == pytest.approx(3.0 * one)


def test_it_is_said_after_the_first_photos_and_again_after_the_first_pairs() -> None:
    said: list[Forecast] = []
    pace = Pace(WORK, said.append)
    for _ in range(10):
        pace.photo(1.1)
        pace.judge()
    assert len(said) == 1
    pace.expect(20_000)
    for _ in range(100):
        pace.pair(0.3)
        pace.judge()
    assert [one.work.pairs for one in said] == [10_000, 20_000]
    assert said[1] == foretold(said[1].work, 1.1, 0.3)


def test_what_takes_less_than_a_minute_is_not_foretold() -> None:
    said: list[Forecast] = []
    pace = Pace(Work(10, 1.0, 45, 300, 2), said.append)
    for _ in range(10):
        pace.photo(0.1)
        pace.judge()
    assert not said


def test_words() -> None:
    assert words(Forecast(600.0, 3.14, WORK)) == (
        "about 10 minutes and 3.1 GB of memory: 1000 photos of 12 megapixels, some 10000 pairs, 2 processors"
    )
    assert words(Forecast(7200.0, 3.0, WORK)).startswith("about 2.0 hours")


def test_the_pairs_of_photos_with_places_are_counted() -> None:
    places = np.random.default_rng(1).uniform(0.0, 100.0, (40, 3))
    assert expected_pairs(40, places, 10) == len(neighbouring_pairs(places, 10))
    assert expected_pairs(20, None, 10) == 190


def test_the_command_says_it(tmp_path, monkeypatch) -> None:
    pytest.importorskip("pycolmap")
    monkeypatch.setattr(forecast, "LEAST_S", 0.0)
    folder = project(tmp_path, render(4, SIDE, np.random.default_rng(7), noise=4.0).photos)
    said = orip(folder, "match", "--features", "--points", "60", "--threads", "1")
    assert said.code == 0
    assert re.search(
        r"forecast about \d+ minutes? and \d\.\d GB of memory: 4 photos of 0 megapixels, some 6 p", said.err
    )
