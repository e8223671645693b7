"""Which event is which photo's: found by times with any offset of the camera's clock."""

from __future__ import annotations

import numpy as np
import pytest

from orip.stations.matching import NO_EVENT, match_by_time, strips_of_flight


def irregular(count: int, seed: int = 3) -> np.ndarray:
    return np.cumsum(2.4 + 0.3 * np.random.RandomState(seed).normal(size=count)) + 400_000.0


def test_the_offset_is_found_with_times_of_whole_seconds_and_events_too_many() -> None:
    events = irregular(62)
    photos = np.delete(events, [0, 30])
    found = match_by_time(np.floor(photos + 3600.37), events, 0.75)
    assert found.event.tolist() == np.delete(np.arange(62), [0, 30]).tolist()
    # whole seconds are half a second early on average; the mean of 60 is known to 0.29 / sqrt(60) = 0.04 s
    assert found.offset == pytest.approx(-3600.37 + 0.5, abs=0.25)
    assert found.alternative is None


def test_a_photo_without_an_event_is_left_alone() -> None:
    events = irregular(20)
    photos = events - 17.0
    found = match_by_time(photos, np.delete(events, 7), 0.1)
    assert found.event[7] == NO_EVENT
    assert np.delete(found.event, 7).tolist() == list(range(19))


def test_intervals_that_are_all_alike_fit_at_several_offsets() -> None:
    events = 1000.0 + 2.0 * np.arange(12)
    found = match_by_time(2.0 * np.arange(10.0), events, 0.5)
    assert found.alternative is not None
    assert abs(found.alternative - found.offset) == pytest.approx(2.0)
    # as many photos as events: nothing else has as many matches
    assert match_by_time(2.0 * np.arange(12.0), events, 0.5).alternative is None


@pytest.mark.parametrize("seed", range(8))
def test_random_flights_with_lost_photos_and_events(seed: int) -> None:
    random = np.random.RandomState(seed)
    moments = irregular(80, seed)
    of_photos = np.sort(random.choice(80, 70, replace=False))
    of_events = np.sort(random.choice(80, 75, replace=False))
    offset = random.uniform(-5e4, 5e4)
    photos = np.round(moments[of_photos] - offset + random.normal(scale=0.01, size=70), 2)
    found = match_by_time(photos, moments[of_events], 0.2)
    assert found.alternative is None
    for photo, event in zip(of_photos, found.event, strict=True):
        expected = np.flatnonzero(of_events == photo)
        assert event == (expected[0] if len(expected) else NO_EVENT)


def test_strips_of_a_flight_to_and_fro() -> None:
    along = 20.0 * np.arange(6)
    east = np.concatenate([along, along[::-1], along])
    north = np.repeat([0.0, 30.0, 60.0], 6)
    time = np.concatenate([2.0 * np.arange(6) + start for start in (0.0, 18.0, 36.0)])
    assert strips_of_flight(time, east, north).tolist() == [1] * 6 + [2] * 6 + [3] * 6


def test_a_long_pause_begins_another_strip_and_photos_of_a_turn_belong_to_none() -> None:
    east = 20.0 * np.arange(8)
    time = np.concatenate([2.0 * np.arange(4), 60.0 + 2.0 * np.arange(4)])
    assert strips_of_flight(time, east, 0.0 * east).tolist() == [1] * 4 + [2] * 4
    curve = np.array([[0, 0], [20, 0], [40, 0], [55, 15], [55, 35], [40, 50], [20, 50], [0, 50]], dtype=float)
    found = strips_of_flight(2.0 * np.arange(8), curve[:, 0], curve[:, 1])
    assert (found[0], found[1], found[6], found[7]) == (1, 1, 2, 2)
