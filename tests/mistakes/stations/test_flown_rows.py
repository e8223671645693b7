"""Flights with a rolling shutter, adjusted without it: it is named, with its readout time within its error."""

from __future__ import annotations

import numpy as np
import pytest
from mistakes.stations.flown_rows import flight
from support.long_cases import every

from orip.bundle.groups.held_cameras import readout_tests
from orip.bundle.known_motions import known_motions
from orip.bundle.solve import SolvedBlock, solve_block
from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Readjuster
from orip.mistakes.mistake import mistake_of
from orip.mistakes.stations.rolling_shutters import READOUT_TIME, ROLLING_SHUTTER, rolling_shutters
from orip.records.block import Block
from orip.records.camera import READOUT
from orip.solving.solve import solve
from orip.structs import replace


def adjusted(seed: int, readout: float, speed: float, unknown: tuple[str, ...] = ()) -> SolvedBlock:
    return solve_block(flight(seed, readout, speed, unknown), lambda _: None, lambda: False)


def said_of(solved: SolvedBlock) -> list[ProjectWarning]:
    return rolling_shutters(solved, Readjuster(solved.block, lambda block: block))


def normed(solved: SolvedBlock, readout: float) -> float:
    state = solved.state
    motion = known_motions(solved.block).at(state.centres, state.rotations, state.antennas)
    found = readout_tests(solved, 0, motion)[0]
    return (found.readout - readout) / found.sd


@pytest.mark.parametrize("readout", [0.03, -0.03])
def test_a_rolling_shutter_is_named_with_its_readout(readout: float) -> None:
    solved = adjusted(1, readout, 10.0)
    (found,) = said_of(solved)
    assert found.code == "rolling-shutter"
    assert found.where == "camera CAM"
    assert f"({'upper' if readout > 0.0 else 'lower'} row first)" in found.text
    assert abs(normed(solved, readout)) < 3.0


def test_a_global_shutter_is_not_named() -> None:
    assert not said_of(adjusted(2, 0.0, 10.0))


def errors_along_flight(solved: SolvedBlock) -> float:
    """Return the root mean square of the errors of points in Y over their standard deviations."""
    points = solved.problem.unknowns.names.eliminated
    sd = solved.deviation_scale * np.sqrt(solved.cofactors.blocks[:, 1, 1])
    error = (solved.state.points - solved.block.point_start)[points, 1]  # points start at the truth
    return float(np.sqrt(np.mean((error / sd) ** 2)))


def test_what_the_warning_advises_makes_errors_as_small_as_is_said() -> None:
    assert errors_along_flight(adjusted(4, 0.03, 10.0)) > 5.0
    assert 'unknown = [..., "READOUT"]' in said_of(adjusted(4, 0.03, 10.0))[0].text
    advised = adjusted(4, 0.03, 10.0, ("C", "READOUT"))
    assert errors_along_flight(advised) < 1.2
    assert not said_of(advised)


@pytest.mark.long
def test_readouts_of_many_flights_are_within_their_errors_and_global_shutters_are_not_significant() -> None:
    random, rolling, still, named = np.random.default_rng(3), [], [], 0
    for seed in range(50):
        readout, speed = random.uniform(0.008, 0.06), random.uniform(3.0, 15.0)
        solved = adjusted(seed, readout, speed)
        rolling.append(normed(solved, readout))
        named += bool(said_of(solved))
        still.append(normed(adjusted(1000 + seed, 0.0, speed), 0.0))
    assert named >= 48
    assert np.mean(np.abs(rolling) < 2.0) >= 0.86  # 95 % less three standard errors
    assert np.mean(np.abs(still) < 1.96) >= 0.86


def with_readout(block: Block, readout: float) -> Block:
    (camera,) = block.cameras
    return replace(block, cameras=(replace(camera, parameters=(*camera.parameters[:READOUT], readout)),))


@pytest.mark.parametrize(("seed", "readout", "control"), every(3, [(1, 0.02, 99), (2, 0.2, 0), (4, 0.1, 1)]))
def test_a_readout_given_to_a_global_shutter_is_the_cause_and_no_station_is_accused(
    seed: int, readout: float, control: int
) -> None:
    block = with_readout(flight(seed, 0.0, 10.0), readout)
    found, _ = solve(replace(block, control_points=block.control_points[:control]))
    first = found.diagnosis[0]
    assert (first.where, first.text) == ("camera CAM", mistake_of(READOUT_TIME).words)
    assert not [one.where for one in found.diagnosis if "station" in one.where or "control" in one.where]
    assert found.status != "converged"
    (said,) = [text for code, _, text in found.warnings if code == READOUT_TIME]
    assert f"readout = {readout:g} does not fit" in said
    assert "its shutter exposes all rows at once" in said


def test_a_readout_with_the_wrong_sign_is_told_with_the_right_one() -> None:
    found, _ = solve(with_readout(flight(1, 0.02, 10.0), -0.02))
    (said,) = [text for code, _, text in found.warnings if code == READOUT_TIME]
    assert 0.018 < float(said.split("write readout = ")[1].split()[0]) < 0.022


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_a_readout_that_is_right_is_not_accused(seed: int) -> None:
    found, _ = solve(with_readout(flight(seed, 0.03, 10.0), 0.03))
    assert not [code for code, _, _ in found.warnings if code in (READOUT_TIME, ROLLING_SHUTTER)]
