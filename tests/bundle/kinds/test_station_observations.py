"""Exposure stations: what was planted in lever arm, boresight, time offset, shift and drift is found again."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.solving import OFF, noisy, redefined, rows, solution, solved
from bundle.stations_of_block import ARM, DRIFTS, MADE, OFFSET, SHIFTS, TURN, stations, with_stations
from scipy.spatial.transform import Rotation
from support.synthetic_block import synthetic_block

from orip.geometry.rotation import angles_from_rotation
from orip.records.control import NOT_GIVEN, Station
from orip.records.definition import ANTENNA_PARAMETERS, BORESIGHT, DRIFT, LEVER_ARM, SHIFT, Antenna
from orip.structs import replace


def values(found, antenna_row=0):
    return found.state.antennas[antenna_row]


def test_lever_arm_and_boresight_are_found_again() -> None:
    antenna = Antenna("GNSS", unknown=(*LEVER_ARM, *BORESIGHT))
    found = solved(with_stations(stations(ARM, TURN), antenna))
    assert found.converged
    # without errors of observations nothing but rounding is left: 1e-9 of a lever arm, of radians
    assert values(found)[:3] == pytest.approx(ARM, abs=1e-6)
    assert np.degrees(values(found)[3:6]) == pytest.approx(TURN, abs=1e-7)
    assert found.variance.sigma0 < 1e-4


def test_given_values_are_constants_without_unknown() -> None:
    antenna = Antenna("GNSS", lever_arm=tuple(ARM.tolist()), boresight=tuple(TURN.tolist()))
    found = solved(with_stations(stations(ARM, TURN), antenna))
    assert found.variance.sigma0 < 1e-4
    assert (found.problem.unknowns.antennas == -1).all()


def test_shift_and_drift_of_each_strip_are_found_again() -> None:
    antenna = Antenna("GNSS", shift="strip", drift="strip")
    found = solved(with_stations(stations(shifts=SHIFTS, drifts=DRIFTS), antenna))
    assert found.state.shifts == pytest.approx(SHIFTS, abs=1e-6)
    assert found.state.drifts == pytest.approx(DRIFTS, abs=1e-7)


def test_a_session_is_all_stations_of_an_antenna() -> None:
    antenna = Antenna("GNSS", cameras=("cam",), shift="session")
    found = solved(with_stations(stations(shifts=np.tile(SHIFTS[:1], (3, 1))), antenna))
    assert found.state.shifts == pytest.approx(SHIFTS[:1], abs=1e-6)


def test_an_antenna_of_another_camera_changes_nothing() -> None:
    found = solved(with_stations(stations(), Antenna("GNSS", cameras=("OTHER",), shift="strip")))
    assert len(found.state.shifts) == 0
    assert found.variance.sigma0 < 1e-4


def test_positions_that_are_late_give_the_time_offset() -> None:
    exact = stations()
    late = []
    for station in exact:
        mine = [other for other in exact if other.strip == station.strip]
        time = np.array([other.time for other in mine])
        velocity = np.gradient(np.array([other.position for other in mine]), time, axis=0)
        moved = np.array(station.position) + OFFSET * velocity[mine.index(station)]
        late.append(replace(station, position=tuple(moved.tolist())))
    found = solved(with_stations(tuple(late), Antenna("GNSS", unknown=("DT",))))
    # the velocities are those of the late positions, which differ from these by a part of 1e-5
    assert values(found)[6] == pytest.approx(OFFSET, rel=1e-3)


def test_a_priori_errors_of_antenna_parameters_are_weights() -> None:
    """With nothing else on the ground in that direction, the parameter stays at its given value."""
    antenna = Antenna(
        "GNSS", lever_arm=(0.1, 0.2, 0.3), lever_arm_error=(0.02, 0.02, 0.02), unknown=LEVER_ARM, shift="session"
    )
    found = solution(with_stations(stations(), antenna, replace(MADE.block, control_points=())))
    row = rows(found, "antenna")
    assert [found.residuals.component[index] for index in row] == ["LX", "LY", "LZ"]
    assert found.residuals.a_priori[row].tolist() == [0.02] * 3


def correlated(scale=1.0):
    """Return the stations with strongly correlated errors, and errors drawn from them."""
    random = np.random.default_rng(4)
    factor = scale * np.array([[0.02, 0.0, 0.0], [0.015, 0.01, 0.0], [-0.02, 0.01, 0.02]])
    covariance = factor @ factor.T
    return tuple(
        replace(
            station,
            position=tuple((np.array(station.position) + factor @ random.normal(size=3)).tolist()),
            position_error=tuple(np.sqrt(np.diag(covariance)).tolist()),
            covariance=tuple(map(tuple, covariance.tolist())),
        )
        for station in stations()
    )


def test_a_full_covariance_weights_as_its_inverse() -> None:
    """The square sum of the decorrelated residuals is that of the residuals with the inverse of the covariance."""
    block = with_stations(correlated())
    found = solution(block)
    row = rows(found, "station")
    physical = found.residuals.residual[row].reshape(-1, 3)
    expected = found.photos.values[:, :3] - [station.position for station in block.stations]
    assert physical == pytest.approx(expected, abs=1e-9)
    inverse = np.linalg.inv(np.array(block.stations[0].covariance))
    expected = np.einsum("ni,ij,nj->", physical, inverse, physical)
    assert np.sum(found.residuals.standard_residual[row] ** 2) == pytest.approx(expected, rel=1e-9)


def test_a_diagonal_covariance_is_that_of_independent_errors() -> None:
    plain = stations(error=0.03)
    given = tuple(replace(station, covariance=tuple(map(tuple, (9e-4 * np.eye(3)).tolist()))) for station in plain)
    block = noisy(MADE, 3)
    one, other = (solution(with_stations(observed, block=block)) for observed in (plain, given))
    # both sum up the same figures, in another order
    assert one.photos.values == pytest.approx(other.photos.values, abs=1e-9)
    assert one.photos.sd == pytest.approx(other.photos.sd, rel=1e-9)


def test_a_constant_station_is_met_exactly_and_a_negative_error_only_compares() -> None:
    observed = list(stations(ARM))
    held = np.array(observed[4].position) + np.array([0.05, -0.02, 0.03])
    observed[4] = replace(
        observed[4], position=tuple(held.tolist()), position_error=(0.0,) * 3, angles=NOT_GIVEN, angle_error=NOT_GIVEN
    )
    observed[7] = replace(observed[7], position_error=(-0.01,) * 3, position=(0.0, 0.0, 0.0))
    found = solution(with_stations(tuple(observed), Antenna("GNSS", lever_arm=tuple(ARM.tolist()))))
    exact = rows(found, "constant station")
    assert np.abs(found.residuals.residual[exact]).max() < 1e-6
    compared = [row for row in rows(found, "station") if found.residuals.photo[row] == "P8"]
    assert np.isnan(found.residuals.weight_factor[compared]).all()
    assert np.abs(found.residuals.residual[compared]).min() > 100.0


def test_a_free_network_uses_no_stations_and_has_no_antenna_unknowns() -> None:
    antenna = Antenna("GNSS", unknown=ANTENNA_PARAMETERS, shift="strip", drift="strip")
    found = solved(redefined(with_stations(stations(), antenna), datum="free"))
    assert found.problem.defect == 7
    assert (found.problem.unknowns.antennas == -1).all()
    assert not len(found.state.shifts)


def test_a_shift_without_control_is_free_like_the_block() -> None:
    block = replace(MADE.block, control_points=())
    found = solution(with_stations(stations(), Antenna("GNSS", shift="session"), block))
    (datum,) = [diagnosis for diagnosis in found.diagnosis if diagnosis.code == "datum"]
    assert "3 shifts" in datum.text


def test_parameters_are_in_the_solution() -> None:
    antenna = Antenna("GNSS", unknown=LEVER_ARM, shift="strip")
    found = solution(with_stations(stations(ARM, shifts=SHIFTS), antenna, noisy(MADE, 5)))
    by_name = {(antenna.strip, antenna.name): antenna for antenna in found.antennas}
    assert set(by_name) == {
        *(("", name) for name in ANTENNA_PARAMETERS),
        *((strip, name) for strip in "123" for name in SHIFT),
    }
    assert not set(DRIFT) & {name for _, name in by_name}
    assert by_name["2", "SX"].antenna == "GNSS"
    assert np.isnan(by_name["", "BX"].sd)
    for strip in range(3):
        for axis, name in enumerate(SHIFT):
            estimate = by_name[str(strip + 1), name]
            assert abs(estimate.value - SHIFTS[strip, axis]) < 5.0 * estimate.sd + 0.05


def stations_along_x(error, turns):
    """Return a block of photos at phi = ±90 with attitudes turned about the ground axes by planted angles, degrees."""
    made = synthetic_block("terrestrial", "attitudes")
    observed = []
    for row, (photo, orientation) in enumerate(zip(made.block.photos, made.orientations, strict=True)):
        given = Rotation.from_rotvec(turns[row], degrees=True) * Rotation.from_euler("XYZ", orientation[3:])
        angles = angles_from_rotation(given.as_matrix())
        observed.append(
            Station(photo.name, tuple(orientation[:3].tolist()), (-1.0,) * 3, tuple(angles.tolist()), (error,) * 3)
        )
    return made, replace(redefined(made.block, **OFF), stations=tuple(observed))


def test_attitudes_of_photos_that_look_along_x_are_turns_about_the_axes() -> None:
    turns = np.random.default_rng(5).normal(size=(6, 3)) * 0.05
    _, block = stations_along_x(np.radians(5.0), turns)
    found = solution(block)
    residual = found.residuals.residual[rows(found, "attitude")].reshape(-1, 3)
    # the control orients the photos, and nothing else has errors
    assert residual == pytest.approx(-turns, abs=1e-3)


def test_precise_attitudes_of_photos_that_look_along_x_turn_them() -> None:
    made, block = stations_along_x(np.radians(1e-6), np.tile([0.01, -0.02, 0.015], (6, 1)))
    found = solved(block)
    for row, orientation in enumerate(made.orientations):
        expected = Rotation.from_rotvec([0.01, -0.02, 0.015], degrees=True) * Rotation.from_euler(
            "XYZ", orientation[3:]
        )
        assert found.state.rotations[row] == pytest.approx(expected.as_matrix(), abs=1e-7)
