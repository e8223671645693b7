"""Flights with a rolling shutter, adjusted without it: it is named, with its readout time within its error."""

from __future__ import annotations

import numpy as np
import pytest
from mistakes.stations.flown_rows import flight

from orip.bundle.groups.held_readouts import readout_test, velocities_in_strips
from orip.bundle.solve import SolvedBlock, solve_block
from orip.mistakes.camera_values import rolling_shutters


def adjusted(seed: int, readout: float, speed: float, unknown: tuple[str, ...] = ()) -> SolvedBlock:
    return solve_block(flight(seed, readout, speed, unknown), lambda _: None, lambda: False)


def normed(solved: SolvedBlock, readout: float) -> float:
    found = readout_test(solved, 0, velocities_in_strips(solved.block, solved.state.centres))
    return (found.readout - readout) / found.sd


@pytest.mark.parametrize("readout", [0.03, -0.03])
def test_a_rolling_shutter_is_named_with_its_readout(readout: float) -> None:
    solved = adjusted(1, readout, 10.0)
    (found,) = rolling_shutters(solved)
    assert found.code == "rolling-shutter"
    assert found.where == "camera CAM"
    assert f"({'upper' if readout > 0.0 else 'lower'} row first)" in found.text
    assert abs(normed(solved, readout)) < 3.0


def test_a_global_shutter_is_not_named() -> None:
    assert not rolling_shutters(adjusted(2, 0.0, 10.0))


def errors_along_flight(solved: SolvedBlock) -> float:
    """Return the root mean square of the errors of points in Y over their standard deviations."""
    points = solved.problem.unknowns.names.eliminated
    sd = solved.deviation_scale * np.sqrt(solved.cofactors.blocks[:, 1, 1])
    error = (solved.state.points - solved.block.point_start)[points, 1]  # points start at the truth
    return float(np.sqrt(np.mean((error / sd) ** 2)))


def test_what_the_warning_advises_makes_errors_as_small_as_is_said() -> None:
    assert errors_along_flight(adjusted(4, 0.03, 10.0)) > 5.0
    advised = adjusted(4, 0.03, 10.0, ("C", "B1", "B2"))
    assert errors_along_flight(advised) < 1.4
    assert not any("unknown =" in found.text for found in rolling_shutters(advised))


@pytest.mark.long
def test_readouts_of_many_flights_are_within_their_errors_and_global_shutters_are_not_significant() -> None:
    random, rolling, still, named = np.random.default_rng(3), [], [], 0
    for seed in range(50):
        readout, speed = random.uniform(0.008, 0.06), random.uniform(3.0, 15.0)
        solved = adjusted(seed, readout, speed)
        rolling.append(normed(solved, readout))
        named += bool(rolling_shutters(solved))
        still.append(normed(adjusted(1000 + seed, 0.0, speed), 0.0))
    assert named >= 48
    assert np.mean(np.abs(rolling) < 2.0) >= 0.86  # 95 % less three standard errors
    assert np.mean(np.abs(still) < 1.96) >= 0.86
