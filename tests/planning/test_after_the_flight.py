"""A flight with missing photos beside its plan, and the clock of an exposure log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from planning.test_plan_commands import project, stations

from orip.errors import InputError
from orip.files.control.stations_text import read_stations, stations_text
from orip.planning.clock import fit_clock, seconds_of_marks
from orip.records.control import NOT_GIVEN
from orip.structs import replace

DRIFT, JITTER, OFFSET, START = 20e-6, 1e-4, 812.347, 345600.0


def logged(random: np.random.Generator, count: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """Return clock readings of marks, two of them wrong, and their seconds."""
    seconds = START + np.arange(float(count))
    readings = OFFSET + (1.0 + DRIFT) * (seconds - START) + JITTER * random.normal(size=count)
    readings[137] += 0.0012
    readings[402] -= 0.3
    return readings, seconds


def test_two_wrong_marks_of_500_are_named_and_drift_and_times_are_right():
    errors = []
    for seed in range(20):
        random = np.random.default_rng(seed)
        readings, seconds = logged(random)
        fit = fit_clock(readings, seconds)
        assert fit.wrong == (137, 402)
        assert fit.drift == pytest.approx(DRIFT, abs=4.0 * fit.rate_sd)
        assert fit.jitter == pytest.approx(JITTER, rel=0.15)
        truth = START + random.uniform(0.0, 500.0, 200)
        pulses = OFFSET + (1.0 + DRIFT) * (truth - START) + JITTER * random.normal(size=200)
        times, sd = fit.times(pulses)
        errors.append((times - truth) / sd)
    # standard deviation of 4000 normal numbers, and their largest
    assert np.std(errors) == pytest.approx(1.0, abs=0.05)
    assert np.abs(errors).max() < 5.0


def test_seconds_are_counted_over_gaps_and_wrong_marks():
    readings, seconds = logged(np.random.default_rng(5))
    kept = np.delete(np.arange(500), np.arange(200, 260))
    found = seconds_of_marks(readings[kept], [(0, START)])
    wrong = np.flatnonzero(found != seconds[kept])
    assert np.array_equal(kept[wrong], []) or np.array_equal(kept[wrong], [402])


@pytest.mark.parametrize("known", [[], [(0, START), (10, START + 11.0)]])
def test_seconds_that_are_not_known_are_not_guessed(known):
    with pytest.raises(InputError, match="second"):
        seconds_of_marks(np.arange(20.0), known)


def test_too_few_marks_are_refused():
    with pytest.raises(InputError, match="marks"):
        fit_clock(np.arange(3.0), np.arange(3.0))


def test_the_log_is_read_and_printed_as_a_table(tmp_path):
    readings, _ = logged(np.random.default_rng(1))
    lines = [f"PPS {reading:.6f}" for reading in readings]
    lines[3] += f" {START + 3.0:.0f}"
    lines += [f"PHOTO P{n} {OFFSET + (1.0 + DRIFT) * 10.5 * n:.6f}" for n in range(1, 6)]
    (tmp_path / "log.txt").write_text("\n".join(lines) + "\n")
    found = orip(tmp_path, "plan", "clock", "log.txt", "--json").document
    assert found["wrong_lines"] == [138, 403]
    for number, row in enumerate(found["photos"], 1):
        assert row["time"] == pytest.approx(START + 10.5 * number, abs=1e-4)
    assert orip(tmp_path, "plan", "clock", "log.txt").out.startswith("photo,time")
    (tmp_path / "log.txt").write_text("PPS x\nPULSE 3\nPHOTO A\n")
    refused = orip(tmp_path, "plan", "clock", "log.txt")
    assert [f"log.txt:{line}" in refused.err for line in (1, 2, 3)] == [True] * 3


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    made = project(
        tmp_path / "p", forward="80.0", side="60.0",
        corners="[[561900.0, 5934000.0], [562120.0, 5934000.0], [562120.0, 5934160.0], [561900.0, 5934160.0]]",
    )  # fmt: skip
    assert orip(made, "plan", "make").code == 0
    return made


def test_a_missed_strip_and_six_missed_photos_are_named_and_closed(flight):
    planned = stations(flight)
    strips = list(dict.fromkeys(one.strip for one in planned))
    assert len(strips) >= 4
    inside = [row for row, one in enumerate(planned) if one.strip == strips[3]]
    missed = {row for row, one in enumerate(planned) if one.strip == strips[1]} | set(inside[3:9])
    random = np.random.default_rng(9)
    log = [
        replace(one, photo=f"DJI_{row:04d}", position=tuple(np.array(one.position) + random.normal(size=3) * 0.5))
        for row, one in enumerate(planned)
        if row not in missed
    ]
    (flight / "PLANNED.STA").write_text(stations_text(log))
    found = orip(flight, "plan", "flown", "--again", "AGAIN.PLAN", "--json").document
    assert found["missed_strips"] == [strips[1]]
    assert found["again"] == [planned[row].photo for row in sorted(missed)]
    assert found["gaps"] > 0
    assert found["gaps_after_again"] == 0
    again = read_stations(flight / "AGAIN.PLAN", "AGAIN.PLAN").value
    assert {one.photo for one in again} == set(found["again"])
    told = orip(flight, "plan", "flown").out
    assert f"missed strips: {strips[1]}" in told
    assert planned[inside[3]].photo in told


def test_a_flight_as_planned_misses_nothing(flight):
    (flight / "PLANNED.STA").write_text(stations_text(stations(flight)))
    found = orip(flight, "plan", "flown", "--json").document
    assert (found["again"], found["gaps"], found["missed_strips"]) == ([], 0, [])


def test_the_forecast_of_a_flight_as_planned_is_that_of_the_plan(flight):
    bare = [replace(one, angles=NOT_GIVEN, angle_error=NOT_GIVEN) for one in stations(flight)]
    (flight / "PLANNED.STA").write_text(stations_text(bare))
    as_planned = orip(flight, "plan", "forecast", "--json").document
    assert orip(flight, "plan", "forecast", "--flown", "--json").document == as_planned
    (flight / "PLANNED.STA").write_text(stations_text(bare[::2]))
    thinned = orip(flight, "plan", "forecast", "--flown", "--json").document
    assert thinned["redundancy"] < as_planned["redundancy"]


def test_without_a_log_there_is_nothing_to_compare(flight):
    refused = orip(flight, "plan", "flown")
    assert refused.code != 0
    assert "stations import" in refused.err
