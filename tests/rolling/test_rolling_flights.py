"""Flights of rolling shutters, with the readout as an unknown: errors are as their standard deviations say."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest

from orip.bundle.calibration import parameter_tests
from orip.bundle.diagnosis import diagnose
from orip.bundle.solve import SolvedBlock, solve_block
from orip.records.block import Block
from orip.records.camera import READOUT
from orip.structs import replace
from rolling.rolling_flights import STEADY, SWINGING, C, Swing, flown

MODELLED, IGNORED = ("C", "READOUT"), ("C",)
LONGEST_SD = 2.0


class Errors(NamedTuple):
    """Errors over standard deviations, of flights: C, readout, and root mean squares of X, Y and Z of the points."""

    c: np.ndarray
    readout: np.ndarray
    points: np.ndarray


def adjusted(block: Block) -> SolvedBlock:
    return solve_block(block, lambda _: None, lambda: False)


def flight(seed: int, readout: float | None = None, **settings: Any) -> tuple[SolvedBlock, float]:
    """Adjust a flight of 8 to 60 ms, or of a given readout, at 3 to 15 m/s; the upper or the lower row first."""
    random = np.random.default_rng(10_000 + seed)
    usual, speed = random.uniform(0.008, 0.06) * random.choice([-1.0, 1.0]), random.uniform(3.0, 15.0)
    made = flown(seed, usual if readout is None else readout, speed, **settings)
    return adjusted(made.block), made.readout


def errors(seeds: range, **settings: Any) -> Errors:
    c, readouts, points = [], [], []
    for seed in seeds:
        solved, readout = flight(seed, **settings)
        assert solved.converged
        sd = solved.deviation_scale * np.sqrt(np.append(solved.cofactors.reduced.diagonal(), np.nan))
        columns = solved.problem.unknowns.cameras[0]
        c.append((solved.state.cameras[0, 0] - C) / sd[columns[0]])
        readouts.append((solved.state.cameras[0, READOUT] - readout) / sd[columns[READOUT]])
        of_points = solved.problem.unknowns.names.eliminated
        off = (solved.state.points - solved.block.point_start)[of_points]  # points start at the truth
        variances = np.einsum("bii->bi", solved.cofactors.blocks)
        points.append(np.sqrt(np.mean(off**2 / variances, axis=0)) / solved.deviation_scale)
    return Errors(np.array(c), np.array(readouts), np.array(points))


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))


FLIGHTS = {
    "RTK": partial(errors, rtk=True, unknown=MODELLED),
    "control": partial(errors, rtk=False, unknown=MODELLED),
    "columns": partial(errors, rtk=True, unknown=MODELLED, direction="right"),
    "columns to the left, control": partial(errors, rtk=False, unknown=MODELLED, direction="left"),
    "swinging": partial(errors, rtk=True, swing=SWINGING, unknown=MODELLED, rate_error=2.0),
}


def assert_true(found: Errors, allowed: float) -> None:
    """Assert that errors are those of the standard deviations, but for a part."""
    assert np.abs(rms(found.points) - 1.0).max() < allowed
    assert abs(float(rms(found.c)) - 1.0) < 5.0 * allowed
    assert np.mean(np.abs(found.readout) < LONGEST_SD) > 0.95 - allowed


@pytest.mark.parametrize("kind", FLIGHTS)
def test_points_and_cameras_are_off_by_what_is_said(kind: str) -> None:
    assert_true(FLIGHTS[kind](range(5)), 0.2)


@pytest.mark.long
@pytest.mark.parametrize("kind", FLIGHTS)
def test_points_and_cameras_of_many_flights_are_off_by_what_is_said(kind: str) -> None:
    found = FLIGHTS[kind](range(200))
    assert_true(found, 0.05)


@pytest.mark.parametrize("rtk", [True, False])
def test_without_the_readout_points_are_off(rtk: bool) -> None:
    assert rms(errors(range(4), rtk=rtk, unknown=IGNORED).points).max() > 5.0


@pytest.mark.long
@pytest.mark.parametrize("rtk", [True, False])
def test_without_the_readout_points_of_many_flights_are_off(rtk: bool) -> None:
    found = errors(range(200), rtk=rtk, unknown=IGNORED)
    assert rms(found.points).max() > 5.0
    assert rms(found.c) > 1.5


def verdicts(seeds: range) -> list[str]:
    """Return what is said of the readouts of global shutters."""
    return [
        test.verdict
        for seed in seeds
        for test in parameter_tests(flight(seed, 0.0, rtk=seed % 2 == 0, unknown=MODELLED)[0])
        if test.parameters == ("READOUT",)
    ]


def test_readouts_of_global_shutters_are_not_significant() -> None:
    assert verdicts(range(6)).count("not significant") >= 5


@pytest.mark.long
def test_readouts_of_many_global_shutters_are_not_significant() -> None:
    found = verdicts(range(200))
    assert len(found) == 200
    assert found.count("not significant") >= 184  # 95 % less two standard errors


def test_a_readout_that_is_known_does_as_well_as_one_that_is_found() -> None:
    held, _ = flight(3, 0.03, given=0.03, unknown=IGNORED)
    found, _ = flight(3, 0.03, given=0.02, unknown=MODELLED)
    assert held.variance.sigma0 == pytest.approx(found.variance.sigma0, abs=0.02)
    assert np.abs(held.state.points - found.state.points).max() < 0.1
    assert held.state.cameras[0, READOUT] == 0.03


def test_a_readout_of_zero_changes_nothing() -> None:
    plain, _ = flight(2, 0.0, unknown=IGNORED)
    zero, _ = flight(2, 0.0, given=1e-12, unknown=IGNORED)
    assert np.abs(plain.state.points - zero.state.points).max() < 1e-6


def test_a_camera_that_is_led_round_an_object_turns_as_its_neighbours_say() -> None:
    """Its photos turn by the same angle from one to the next."""
    solved, _ = flight(1, 0.05, swing=Swing(20.0, 40.0), unknown=MODELLED)
    rates = np.degrees(np.abs(solved.state.motions[:, 3:]))
    assert rates.max() > 0.5
    assert (errors(range(1, 2), swing=Swing(20.0, 40.0), unknown=MODELLED).points < 1.6).all()


def test_what_neighbours_do_not_show_is_no_motion() -> None:
    solved, _ = flight(1, 0.03, swing=SWINGING, unknown=MODELLED)
    assert not solved.state.motions[:, 3:].any()
    assert np.abs(solved.state.motions[:, 1]).min() > 1.0


def test_a_readout_without_known_motion_is_named() -> None:
    block = flown(1, 0.03, 8.0, swing=STEADY, unknown=MODELLED).block
    still = replace(block, stations=tuple(replace(station, time=float("nan")) for station in block.stations))
    (said,) = [found for found in diagnose(adjusted(still)) if found.code == "undetermined"]
    assert "READOUT of camera CAM cannot be determined" in said.text
    assert "acts together with the readout" in said.text
