"""A shift or drift that the stations of a strip have in common is named; a single wrong station is no such thing."""

from __future__ import annotations

import re

import numpy as np
import pytest
from bundle.solving import noisy
from bundle.stations_of_block import ARM, MADE, NO_VECTOR, STRIP, stations, with_stations
from scipy.stats import chi2

from orip.bundle.groups import observation_groups
from orip.bundle.groups.observation_groups import largest_exact
from orip.bundle.methods import Method, adjust_block
from orip.bundle.snooping.search import SnoopingSettings
from orip.records.control import NOT_GIVEN
from orip.records.definition import Antenna
from orip.records.results.solution import Solution
from orip.structs import replace

SHIFT = np.array([0.4, -0.3, 0.5])
ERROR = 0.03


def observed(seed: int, shift=0.0, drift=0.0, wrong: int | None = None, of_all=0.0, arm=NO_VECTOR):
    """Return stations with errors, those of strip 2 shifted and drifting, and one of them perhaps wrong by 2 m.

    `of_all` is a shift of all strips, `arm` the way from the projection centres to where the stations are.
    """
    random = np.random.default_rng(seed)
    shifts, drifts = np.zeros((3, 3)) + of_all, np.zeros((3, 3))
    shifts[1] += shift
    drifts[1] = drift
    found = []
    for row, station in enumerate(stations(arm=arm, shifts=shifts, drifts=drifts, error=ERROR)):
        position = np.array(station.position) + ERROR * random.normal(size=3) + (2.0 if row == wrong else 0.0)
        found.append(replace(station, position=tuple(position.tolist()), angles=NOT_GIVEN, angle_error=NOT_GIVEN))
    return tuple(found)


DANISH = Method()


def adjusted(seed: int, antenna: Antenna | None = None, method: Method = DANISH, **planted) -> Solution:
    block = with_stations(observed(seed, **planted), antenna, noisy(MADE, seed))
    found, _ = adjust_block(replace(block, definition=MADE.block.definition), method, lambda _: None, lambda: False)
    return found


def test_a_shifted_strip_is_named_first_with_size_and_setting() -> None:
    found = adjusted(1, shift=SHIFT)
    first = found.diagnosis[0]
    assert first.code == "group"
    assert "the exposure stations of strip 2 are all off by X +0." in first.text
    assert "drift" not in first.text
    assert 'shift = "strip"' in first.remedy
    assert 'strips = ["2"]' in first.remedy
    assert "exposure stations of strip 2" in found.verdict
    doubted = {(group.kind, group.of) for group in found.groups if group.doubted}
    assert ("station", "2") in doubted


def test_with_the_setting_nothing_is_doubted_and_the_shift_is_estimated() -> None:
    found = adjusted(1, Antenna("GNSS", shift="strip", strips=("2",)), shift=SHIFT)
    assert not [each for each in found.diagnosis if each.code == "group"]
    assert [(each.strip, each.name) for each in found.antennas[-3:]] == [("2", "SX"), ("2", "SY"), ("2", "SZ")]
    for estimate, planted in zip(found.antennas[-3:], SHIFT, strict=True):
        assert abs(estimate.value - planted) < 4.0 * estimate.sd


def test_a_drift_is_named_with_its_rate() -> None:
    found = adjusted(2, shift=SHIFT, drift=(0.05, 0.0, -0.04))
    first = found.diagnosis[0]
    assert "the exposure stations of strip 2 are all off by" in first.text
    assert "with a drift of X +0.0" in first.text
    assert 'drift = "strip"' in first.remedy


def sizes(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors that a sentence states, and their standard deviations."""
    found = np.array(re.findall(r"[LXYZ]+ ([+-][0-9.]+) ± ([0-9.]+)", text), dtype=np.float64)
    return found[:, 0], found[:, 1]


def test_a_shift_of_all_strips_is_named_as_one() -> None:
    found = adjusted(4, of_all=SHIFT)
    first = found.diagnosis[0]
    assert first.text.startswith("the exposure stations are all off by X ")
    assert "strip" not in first.text
    assert 'shift = "session"' in first.remedy
    size, sd = sizes(first.text)
    assert (np.abs(size - SHIFT) < 4.0 * sd).all()
    assert len([each for each in found.diagnosis if each.code == "group"]) == 1


def test_a_lever_arm_is_a_shift_where_all_photos_are_turned_alike() -> None:
    (first, *others) = [each for each in adjusted(5, arm=ARM).diagnosis if each.code == "group"]
    assert not others
    assert "lever arm of" not in first.text
    size, sd = sizes(first.text)
    # the photos are turned by some degrees only: their axes are those of the ground within 0.1 of the arm
    assert (np.abs(size - ARM) < 4.0 * sd + 0.1 * np.linalg.norm(ARM)).all()


def test_without_errors_in_common_no_stations_are_doubted() -> None:
    assert not [group for group in adjusted(6).groups if group.doubted]


def test_a_single_wrong_station_is_no_shift_of_its_strip() -> None:
    found = adjusted(3, wrong=7)
    assert not [each for each in found.diagnosis if "are all off" in each.text]


def test_a_wrong_station_loses_its_weight_as_a_whole() -> None:
    block = with_stations(observed(3, wrong=7), None, noisy(MADE, 3))
    _, solved = adjust_block(replace(block, definition=MADE.block.definition), DANISH, lambda _: None, lambda: False)
    kinds = [kind.rows.kind.name for kind in solved.problem.observations]
    first = sum(len(kind.rows.error) for kind in solved.problem.observations[: kinds.index("station")])
    weights = solved.weight_factors[first : first + 45].reshape(15, 3)
    assert (weights == weights[:, :1]).all()
    assert np.flatnonzero(weights[:, 0] < 1.0).tolist() == [7]


@pytest.mark.parametrize(
    ("sizes", "largest"), [([200, 10], 150), ([50] * 60, 150), ([50] * 61, 49), ([150] * 5 + [2] * 2000, 1)]
)
def test_groups_are_tested_with_covariances_up_to_a_size(sizes: list[int], largest: int) -> None:
    assert largest_exact(sizes) == largest
    assert sum(size for size in sizes if size <= largest) <= 3000


def test_strips_are_told_apart_without_covariances_of_their_residuals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observation_groups, "_MOST_EXACT_IN_ALL", 10)
    found = adjusted(4)
    assert not [each for each in found.diagnosis if each.code == "group"]
    for one in (one for one in found.groups if one.kind == "station"):
        # photo points that are worse than is said make it less likely that stations are
        assert one.p_sigma0 >= chi2.sf(one.sigma0**2 * one.redundancy, one.redundancy) * (1.0 - 1e-9)
    assert "the exposure stations of strip 2 are all off by" in adjusted(1, shift=SHIFT).diagnosis[0].text


def test_right_stations_are_not_doubted() -> None:
    for seed in range(4, 8):
        assert not [each for each in adjusted(seed).diagnosis if each.code == "group"]


@pytest.mark.parametrize("wrong", [2, 7])
def test_snooping_names_the_station_as_a_whole_and_leaves_the_photo_points_alone(wrong: int) -> None:
    found = adjusted(9, method=Method(snooping=SnoopingSettings()), wrong=wrong)
    assert {(each.kind, each.photo) for each in found.blunders} == {("station", f"P{wrong + 1}")}
    assert [each.component for each in found.blunders] == ["X", "Y", "Z"]
    for blunder in found.blunders:
        assert abs(blunder.size - 2.0) < 4.0 * blunder.sd
    text = next(each.text for each in found.diagnosis if each.code == "blunder")
    assert text.startswith(f"station of photo P{wrong + 1} contradicts the other observations; it is off by X +")
    assert STRIP[wrong] in (0, 1)
