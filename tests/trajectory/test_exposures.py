"""Events and photos brought together, and what is said of those that do not fit."""

from __future__ import annotations

import numpy as np
import pytest

from orip.errors import InputError
from orip.records.epochs import Epochs, Quality, epochs
from orip.stations.exposures import Matching, Sources, find_exposures
from orip.structs import replace

TIMES = np.array([2.0, 4.1, 6.5, 8.2, 10.9, 12.8])


def events(**more: object) -> Epochs:
    known = {"time": TIMES, "place": np.column_stack([TIMES, 0 * TIMES, 0 * TIMES]), "is_geographic": False}
    return epochs("e.pos", np.arange(3, 9), **{**known, "quality": ("fixed",) * 6, **more})


def photos(time: np.ndarray) -> Epochs:
    names = tuple(f"P{number}" for number in range(1, len(time) + 1))
    return epochs("p.csv", np.arange(2, 2 + len(time)), photo=names, time=time)


def trajectory(quality: dict[int, Quality] | None = None) -> Epochs:
    time = np.arange(0.0, 20.0, 0.5)
    kinds = tuple((quality or {}).get(row, "fixed") for row in range(len(time)))
    place = np.column_stack([2.0 * time, 0 * time, 100.0 + 0 * time])
    covariance = np.tile(np.diag([0.01, 0.01, 0.04]) ** 2, (len(time), 1, 1))
    return epochs(
        "t.pos", np.arange(1, len(time) + 1), time=time, place=place, is_geographic=False, quality=kinds,
        covariance=covariance,
    )  # fmt: skip


def test_the_order_alone_is_no_proof() -> None:
    with pytest.raises(InputError, match=r"neither names nor numbers of photos; give the times of the photos"):
        find_exposures(Sources(events(), photos=["P1"]), Matching())


def test_photos_by_their_times_with_one_event_too_many() -> None:
    found, warnings = find_exposures(Sources(events(), photo_times=photos(TIMES[1:] + 100)), Matching(tolerance=0.2))
    assert found.photo == ("P1", "P2", "P3", "P4", "P5")
    np.testing.assert_allclose(found.place[:, 0], TIMES[1:])
    assert [(warning.code, warning.where) for warning in warnings] == [("event-without-photo", "e.pos:3")]


def test_a_clock_that_jumps_is_said_and_the_photos_after_it_are_matched() -> None:
    time = np.concatenate([TIMES, TIMES + 20.3, TIMES + 41.9])
    shifted = np.where(np.arange(18) >= 12, time + 3.0, time) + 50.0
    source = epochs(
        "e.pos", np.arange(1, 19), time=time, place=np.column_stack([time] * 3), is_geographic=False,
        quality=("fixed",) * 18,
    )  # fmt: skip
    found, warnings = find_exposures(Sources(source, photo_times=photos(shifted)), Matching(tolerance=0.05))
    np.testing.assert_allclose(found.place[:, 0], time)
    (jump,) = warnings
    assert (jump.code, jump.where) == ("clock-jump", "p.csv:14")
    assert "jumps by +3.00 s at photo P13" in jump.text


def test_two_offsets_that_fit_alike_are_refused_with_the_way_out() -> None:
    regular = events(time=np.arange(0.0, 12.0, 2.0))
    times = photos(np.arange(0.0, 8.0, 2.0))
    with pytest.raises(
        InputError, match=r"fit those of the events at an offset of .* alike; give the right one with --"
    ):
        find_exposures(Sources(regular, photo_times=times), Matching())
    found, _ = find_exposures(Sources(regular, photo_times=times), Matching(offset=2.0))
    np.testing.assert_allclose(found.time, [2, 4, 6, 8])


def test_numbers_of_events_are_those_at_the_end_of_names() -> None:
    numbered = events(number=np.arange(7, 13))
    known = ["DJI_0008", "DJI_20230101_0010_V", "IMG"]
    found, warnings = find_exposures(Sources(numbered, photos=known), Matching())
    assert found.photo == ("DJI_0008", "DJI_20230101_0010_V")
    assert [warning.where for warning in warnings] == ["e.pos:3", "e.pos:5", "e.pos:7", "e.pos:8"]
    found, warnings = find_exposures(Sources(numbered), Matching(names="IMG_{:03d}"))
    assert found.photo[0] == "IMG_007"
    assert warnings == ()
    with pytest.raises(InputError, match="both have the number 8; give the pattern"):
        find_exposures(Sources(numbered, photos=["A8", "B8"]), Matching())
    with pytest.raises(InputError, match="do not number the photos"):
        find_exposures(Sources(numbered), Matching(names="IMG"))


def test_events_on_a_trajectory_have_its_place_and_the_camera_its_offset() -> None:
    numbered = events(number=np.arange(1, 7), to_camera=np.tile([0.0, 0.1, -0.2], (6, 1)))
    found, warnings = find_exposures(Sources(trajectory(), numbered), Matching(names="P{}"))
    assert warnings == ()
    np.testing.assert_allclose(found.place, np.column_stack([2 * TIMES, 0 * TIMES + 0.1, 0 * TIMES + 99.8]))
    assert all(found.is_used)


def test_velocities_that_contradict_the_positions_are_said_and_not_used() -> None:
    flown = trajectory()
    right, wrong = (np.tile([x, 0.0, 0.0], (len(flown), 1)) for x in (2.0, -2.0))
    sources = [Sources(replace(flown, velocity=given), events(), photo_times=photos(TIMES)) for given in (right, wrong)]
    (expected, nothing), (found, said) = (find_exposures(source, Matching(tolerance=0.2)) for source in sources)
    np.testing.assert_allclose(found.place, expected.place, atol=1e-12)
    assert nothing == ()
    (warning,) = said
    assert (warning.code, warning.where.rpartition(":")[0]) == ("velocities", "t.pos")


def test_gaps_the_end_and_floats_are_said_with_their_lines() -> None:
    numbered = events(number=np.arange(1, 7))
    flown = trajectory({8: "float", 17: "code"})
    kept = np.r_[0:12, 18:24]  # a gap from 5.5 s to 9 s, and the end at 11.5 s
    flown = replace(
        flown, line=flown.line[kept], time=flown.time[kept], place=flown.place[kept],
        covariance=flown.covariance[kept], quality=tuple(np.array(flown.quality)[kept]),
        velocity=flown.velocity[kept], angles=flown.angles[kept], angle_error=flown.angle_error[kept],
    )  # fmt: skip
    found, warnings = find_exposures(Sources(flown, numbered), Matching(names="P{}"))
    assert found.photo == ("P1", "P2", "P5")
    assert found.is_used == (True, False, True)
    said = {(warning.code, warning.where): warning.text for warning in warnings}
    assert set(said) == {
        ("gap", "e.pos:5"), ("gap", "e.pos:6"), ("outside-trajectory", "e.pos:8"), ("not-fixed", "e.pos:4"),
    }  # fmt: skip
    assert "falls into a gap of 3.50 s of t.pos after its line 12" in said["gap", "e.pos:5"]
    assert "is float, its ambiguities are not fixed: it is only compared" in said["not-fixed", "e.pos:4"]


def test_a_trajectory_of_seconds_of_the_day_is_recognised() -> None:
    numbered = events(number=np.arange(1, 7), time=TIMES + 3 * 86400.0)
    _, warnings = find_exposures(Sources(trajectory(), numbered), Matching(names="P{}"))
    assert all("is the trajectory in seconds of the day?" in warning.text for warning in warnings[:1])
    assert warnings[0].code == "outside-trajectory"


def test_a_trajectory_of_seconds_of_the_week_fits_events_with_weeks() -> None:
    numbered = events(number=np.arange(1, 7), time=TIMES + 2315 * 604800.0)
    flown = replace(trajectory(), has_week=False)
    found, _ = find_exposures(Sources(flown, numbered), Matching(names="P{}"))
    np.testing.assert_allclose(found.place[:, 0], 2 * TIMES, atol=1e-6)


def test_positions_that_are_not_fixed_have_errors_of_their_kind_where_the_file_has_none() -> None:
    named = events(photo=tuple("ABCDEF"), quality=("fixed", "float", "code", "", "fixed", "fixed"))
    found, _ = find_exposures(Sources(named), Matching(accepted=("fixed", "float", "code", "")))
    assert np.isnan(found.covariance[[0, 3, 4, 5]]).any(axis=(1, 2)).all()
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance[1])), [0.5, 0.5, 1.0])
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance[2])), [5.0, 5.0, 10.0])
