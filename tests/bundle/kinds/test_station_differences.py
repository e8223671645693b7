"""Relative control: what drops out of it, its weights, wrong ones, and stations whose six components are correlated."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from bundle.solving import noisy, redefined, solved, with_photo_points
from bundle.stations_of_block import ARM, DRIFTS, MADE, SHIFTS, TURN, stations, with_stations
from scipy.spatial.transform import Rotation

from orip.bundle.antennas import without_unmeasured_points
from orip.bundle.methods import Method, adjust_block
from orip.bundle.results.solution import solution_of
from orip.bundle.snooping.findings import snooping_diagnosis, without_blunders
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.bundle.solve import iteration_settings
from orip.bundle.variance.components import estimate_errors
from orip.records.control import StationDifference
from orip.records.definition import BORESIGHT, Antenna
from orip.structs import replace

ROOT = np.array([
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.3, 1.0, 0.0, 0.0, 0.0, 0.0],
    [-0.2, 0.4, 1.0, 0.0, 0.0, 0.0],
    [0.5, 0.1, 0.0, 1.0, 0.0, 0.0],
    [0.0, 0.6, 0.2, -0.3, 1.0, 0.0],
    [0.4, -0.5, 0.1, 0.2, 0.3, 1.0],
]) * np.repeat([0.01, 1e-4], 3)[:, None]  # fmt: skip
COVARIANCE = ROOT @ ROOT.T
ERROR = np.sqrt(np.diag(COVARIANCE))


def differences(observed, random=None):
    """Return differences of stations, computed with scipy's rotations; with errors of `COVARIANCE`."""
    found = []
    for one, other in pairwise(observed):
        noise = np.zeros(6) if random is None else ROOT @ random.normal(size=6)
        turned = Rotation.from_euler("XYZ", one.angles).inv() * Rotation.from_euler("XYZ", other.angles)
        turned = Rotation.from_rotvec(noise[3:]) * turned
        position = np.array(other.position) - np.array(one.position) + noise[:3]
        found.append(
            StationDifference(
                one.photo, other.photo, tuple(position.tolist()), tuple(ERROR[:3]),
                tuple(turned.as_euler("XYZ").tolist()), tuple(ERROR[3:]), tuple(map(tuple, COVARIANCE)),
            )
        )  # fmt: skip
    return tuple(found)


def with_differences(observed, lines, antenna=None, block=None):
    return replace(with_stations(observed, antenna, block), differences=lines)


def residuals(found):
    """Return the residuals (m, 6) of differences as observed, ground units and degrees."""
    solution = solution_of(found)
    return solution.residuals.residual[np.array(solution.residuals.kind) == "difference"].reshape(-1, 6)


@pytest.mark.parametrize("has_stations", [True, False])
def test_boresight_and_shift_drop_out(has_stations: bool) -> None:
    """Those of stations that have lever arm, boresight, shift and drift fit a block without errors."""
    observed = stations(
        ARM, TURN, SHIFTS if has_stations else SHIFTS[[0, 0, 0]], DRIFTS if has_stations else 0 * DRIFTS
    )
    known = {"unknown": BORESIGHT} if has_stations else {"boresight": tuple(TURN.tolist())}
    antenna = Antenna("GNSS", lever_arm=tuple(ARM.tolist()), shift="strip", drift="strip", **known)
    lines = differences(observed)
    found = solved(with_differences(observed if has_stations else (), lines, antenna))
    assert found.converged
    assert np.abs(residuals(found)).max() < 1e-6


def test_square_sum_is_that_of_the_whole_covariance() -> None:
    random = np.random.default_rng(2)
    found = solved(with_differences((), differences(stations(), random), block=noisy(MADE, 3)))
    v = residuals(found) * np.repeat([1.0, np.pi / 180.0], 3)
    expected = np.einsum("na,ab,nb->", v, np.linalg.inv(COVARIANCE), v)
    rows = np.concatenate([np.full(len(kind.rows.error), kind.rows.kind.name) for kind in found.problem.observations])
    assert np.sum(found.equations.residual[rows == "difference"] ** 2) == pytest.approx(expected, rel=1e-9)


def test_only_compared_and_free_networks_leave_the_block_as_it_is() -> None:
    block = noisy(MADE, 3)
    wrong = tuple(
        replace(line, position=(0.0, 0.0, 0.0), position_error=(-1.0,) * 3, angle_error=(-1.0,) * 3, covariance=None)
        for line in differences(stations())
    )
    plain, compared = solved(with_stations((), block=block)), solved(with_differences((), wrong, block=block))
    np.testing.assert_allclose(compared.state.points, plain.state.points, atol=1e-6)
    free = redefined(block, datum="free")
    one, other = (solved(replace(free, differences=lines)) for lines in ((), differences(stations())))
    np.testing.assert_allclose(other.state.points, one.state.points, atol=1e-6)


def test_photos_without_common_points_hang_together_by_differences() -> None:
    """Strips of which none shares a point with another, and only the first has control."""
    points = MADE.block.photo_points
    strip = points.photo // 5
    first = np.full(len(MADE.block.point_names), 9)
    np.minimum.at(first, points.point, strip)
    own = first[points.point] == strip
    keep = own & (np.bincount(points.point[own], minlength=len(first))[points.point] > 1)
    cut = without_unmeasured_points(with_photo_points(MADE.block, keep))
    control = tuple(point for point in cut.control_points if first[MADE.block.point_index()[point.name]] == 0)
    cut = replace(cut, control_points=control)
    lines = differences(stations())
    alone = solution_of(solved(with_differences((), (), block=cut)))
    joined = solution_of(solved(with_differences((), lines, block=cut)))
    assert np.isinf(alone.photos.sd).any()
    assert joined.status == "converged"
    assert np.isfinite(joined.photos.sd).all()
    np.testing.assert_allclose(joined.photos.values[:, :3], MADE.orientations[:, :3], atol=1e-3)


def test_a_wrong_difference_is_named() -> None:
    lines = list(differences(stations(), np.random.default_rng(5)))
    lines[6] = replace(lines[6], position=tuple(np.array(lines[6].position) + np.array([0.0, 0.3, 0.0])))
    turned = Rotation.from_rotvec([0.0, 0.0, 0.004]) * Rotation.from_euler("XYZ", lines[10].angles)
    lines[10] = replace(lines[10], angles=tuple(turned.as_euler("XYZ")))
    block = with_differences((), tuple(lines), block=noisy(MADE, 3))
    found = snoop(block, SnoopingSettings("apriori", 1e-6), lambda _: None, lambda: False)
    told = [diagnosis.text for diagnosis in snooping_diagnosis(found.solved, found.findings)]
    assert {text.split(" contradicts")[0] for text in told} == {
        "station difference p7-p8",
        "station difference p11-p12",
    }
    assert any("Y +0.3" in text or "Y +0.2" in text for text in told)
    assert without_blunders(block, solution_of(found.solved).blunders) is not None


def test_their_errors_are_estimated_and_groups_are_named() -> None:
    lines = []
    for line, exact in zip(differences(stations(), np.random.default_rng(9)), differences(stations()), strict=True):
        given, right = (Rotation.from_euler("XYZ", angles) for angles in (line.angles, exact.angles))
        turned = Rotation.from_rotvec(4.0 * (given * right.inv()).as_rotvec()) * right
        lines.append(replace(line, angles=tuple(turned.as_euler("XYZ")), covariance=None))
    block = with_differences((), tuple(lines), block=noisy(MADE, 3))
    solution, *_ = adjust_block(block, Method(), lambda _: None, lambda: False)
    groups = [group for group in solution.groups if group.kind == "difference"]
    assert [group.component for group in groups] == ["X", "Y", "Z", "OMEGA", "PHI", "KAPPA"]
    assert all(group.doubted for group in groups[3:])
    assert not any(group.doubted for group in groups[:3])
    assert any("of the station differences" in one.text for one in solution.diagnosis)
    settings = iteration_settings(block.definition)
    found = estimate_errors(solved(block), settings, lambda _: None, lambda: False)
    of = {part.component: part for part in found.components if part.kind == "difference"}
    assert of["OMEGA PHI KAPPA"].factor == pytest.approx(4.0, abs=3.0 * of["OMEGA PHI KAPPA"].sd)
    assert of["OMEGA PHI KAPPA"].sd < 0.6
    assert of["X0 Y0 Z0"].name == "positions between exposure stations"


def test_stations_with_correlated_positions_and_angles() -> None:
    """The square sum of both kinds is that of their whole covariance; residuals are those of what was observed."""
    random = np.random.default_rng(6)
    observed = []
    for station in stations(ARM, TURN):
        noise = ROOT @ random.normal(size=6)
        observed.append(
            replace(
                station, position=tuple(np.array(station.position) + noise[:3]), position_error=tuple(ERROR[:3]),
                angles=tuple(np.array(station.angles) + noise[3:]), angle_error=tuple(ERROR[3:]),
                covariance=tuple(map(tuple, COVARIANCE)),
            )
        )  # fmt: skip
    antenna = Antenna("GNSS", lever_arm=tuple(ARM.tolist()), unknown=BORESIGHT, shift="strip")
    found = solved(with_stations(tuple(observed), antenna, noisy(MADE, 3)))
    kinds = np.concatenate([np.full(len(kind.rows.error), kind.rows.kind.name) for kind in found.problem.observations])
    seen = solution_of(found).residuals
    of = {name: seen.residual[np.array(seen.kind) == name].reshape(-1, 3) for name in ("station", "attitude")}
    v = np.hstack([of["station"], np.radians(of["attitude"])])
    expected = np.einsum("na,ab,nb->", v, np.linalg.inv(COVARIANCE), v)
    assert np.sum(found.equations.residual[np.isin(kinds, list(of))] ** 2) == pytest.approx(expected, rel=1e-9)
    axes = Rotation.from_matrix(found.state.rotations) * Rotation.from_euler("XYZ", found.state.antennas[0, 3:6]).inv()
    difference = axes.as_euler("XYZ") - np.array([station.angles for station in observed])
    np.testing.assert_allclose(of["attitude"], np.degrees(difference), atol=1e-9)
