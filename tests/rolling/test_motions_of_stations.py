"""Motions that stations say: a drone that swings between its exposures is adjusted as it flew."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.long_cases import every

from orip.bundle.known_motions import known_motions, motion_errors, without_motion
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock
from orip.records.block import Block
from orip.records.camera import READOUT
from orip.records.control import NOT_GIVEN, Station, StationMotion
from orip.records.definition import Antenna
from orip.records.rig import Mounting, Rig, RigExposure, Rigs
from orip.structs import replace
from rolling.rolling_flights import C, Swing, flown
from rolling.test_rolling_flights import MODELLED, adjusted, assert_true, errors, flight

SWINGING = Swing(2.0, 2.3)
"""Of which neighbours show nothing."""

KNOWN = (0.05, 0.3)
"""Standard deviations of velocities and angular rates, degrees a second."""


def off(solved: SolvedBlock) -> float:
    """Return the root mean square error of the points, which start at the truth."""
    of_points = solved.problem.unknowns.names.eliminated
    return float(np.sqrt(np.mean((solved.state.points - solved.block.point_start)[of_points] ** 2)))


def with_motions(block: Block, **changed: object) -> Block:
    """Return a block whose stations say other things of their motions."""
    stations = tuple(replace(one, motion=replace(one.motion, **changed)) for one in block.stations if one.motion)
    return replace(block, stations=stations)


def test_points_and_cameras_are_off_by_what_is_said() -> None:
    assert_true(errors(range(5), swing=SWINGING, unknown=MODELLED, known=KNOWN), 0.35)


@pytest.mark.long
def test_points_and_cameras_of_many_flights_are_off_by_what_is_said() -> None:
    found = errors(range(200), swing=SWINGING, unknown=MODELLED, known=KNOWN)
    assert_true(found, 0.07)
    assert np.sqrt(np.mean(found.readout**2)) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("seed", every(2, range(2)))
def test_neighbours_leave_what_they_do_not_show_in_the_points(seed: int) -> None:
    by_stations, _ = flight(seed, swing=SWINGING, unknown=MODELLED, known=KNOWN)
    by_neighbours, _ = flight(seed, swing=SWINGING, unknown=MODELLED)
    assert by_stations.variance.sigma0 == pytest.approx(1.0, abs=0.06)
    assert by_neighbours.variance.sigma0 > 1.7
    assert off(by_neighbours) > 2.0 * off(by_stations)


def test_motions_that_are_constant_are_no_unknowns() -> None:
    made = flown(1, 0.04, 9.0, swing=SWINGING, given=0.04, known=(1e-6, 1e-6))
    held = adjusted(with_motions(made.block, velocity_error=(0.0,) * 3, rate_error=(0.0,) * 3))
    assert held.variance.sigma0 == pytest.approx(1.0, abs=0.06)
    motions = solution_of(held).motions
    said = [station.motion for station in made.block.stations]
    np.testing.assert_allclose([(row.VX, row.VY, row.VZ) for row in motions], [one.velocity for one in said])
    np.testing.assert_allclose(np.radians([(row.WX, row.WY, row.WZ) for row in motions]), [one.rate for one in said])
    assert all(np.isnan(row.WX_sd) for row in motions)
    # turned the other way it does not fit
    turned = tuple(
        replace(one, motion=replace(one.motion, rate=tuple(-rate for rate in one.motion.rate)))
        for one in held.block.stations
    )
    assert adjusted(replace(held.block, stations=turned)).variance.sigma0_all > 5.0


def test_of_a_velocity_alone_the_turning_is_as_neighbours_say() -> None:
    made = flown(1, 0.05, 9.0, swing=Swing(20.0, 40.0), unknown=MODELLED, known=KNOWN)
    alone = adjusted(with_motions(made.block, rate=NOT_GIVEN, rate_error=NOT_GIVEN))
    assert np.degrees(np.abs(alone.state.motions[:, 3:])).max() > 0.5
    errors_of_bundle = motion_errors(alone.block).values
    assert np.isfinite(errors_of_bundle[:, :3]).all()
    assert np.isnan(errors_of_bundle[:, 3:]).all()
    assert alone.state.cameras[0, READOUT] == pytest.approx(0.05, abs=0.005)


def test_photos_whose_motion_is_given_need_no_times() -> None:
    block = flown(1, 0.03, 8.0, unknown=MODELLED, known=KNOWN).block
    stations = tuple(replace(one, time=float("nan"), strip="") for one in block.stations)
    assert not list(without_motion(replace(block, stations=stations)))
    (said,) = without_motion(replace(block, stations=stations[1:]))
    assert "1 photo of 18 have no known motion (P1)" in said.text


def test_a_centre_moves_with_the_antenna_and_the_turn_about_it() -> None:
    """On a body that turns, the centres of two cameras of a rig and the antenna are points of it."""
    arm, offset, moment = np.array([0.3, -0.5, 1.2]), np.array([0.8, 0.1, -0.2]), 1e-5
    rate = np.array([0.4, -0.3, 0.9])
    start = Rotation.from_euler("XYZ", [5.0, -8.0, 130.0], degrees=True)

    def places(time: float) -> np.ndarray:
        rotation = Rotation.from_rotvec(rate * time) * start
        centre = np.array([3.0, 7.0, 50.0]) + np.array([9.0, -4.0, 1.0]) * time
        return np.array([centre, centre + rotation.apply(offset), centre + rotation.apply(arm)])

    velocity, other, of_antenna = (places(moment) - places(-moment)) / (2.0 * moment)
    block = flown(1, 0.03, 8.0, given=0.03).block
    said = StationMotion(tuple(of_antenna), (0.1,) * 3, tuple(rate))
    cameras = (block.cameras[0], replace(block.cameras[0], name="SIDE"))
    photos = (block.photos[0], replace(block.photos[1], camera="SIDE"))
    angles = start.as_euler("XYZ")
    block = replace(
        block, cameras=cameras, photos=photos, photo_camera=np.array([0, 1]),
        photo_orientation=np.hstack([places(0.0)[:2], [angles, angles]]),
        antennas=(Antenna("GNSS", lever_arm=tuple(arm)),),
        stations=(Station("P1", NOT_GIVEN, NOT_GIVEN, motion=said),),
        rigs=Rigs((Rig("HEAD", (Mounting("CAM"), Mounting("SIDE"))),), (RigExposure("E1", ("P1", "P2")),)),
    )  # fmt: skip
    antennas = np.array([[*arm, 0.0, 0.0, 0.0, 0.0]])
    rotations = np.array([start.as_matrix()] * 2)
    found = known_motions(block).at(places(0.0)[:2], rotations, antennas)
    np.testing.assert_allclose(found[:, :3], [velocity, other], atol=1e-6)
    np.testing.assert_allclose(found[:, 3:], [rate, rate])


def test_the_principal_distance_is_right_with_motions_of_stations() -> None:
    solved, _ = flight(0, swing=SWINGING, unknown=MODELLED, known=KNOWN)
    assert solved.state.cameras[0, 0] == pytest.approx(C, abs=0.01)
