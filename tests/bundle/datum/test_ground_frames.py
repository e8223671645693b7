"""Blocks on the curved earth: what a crs makes of them, compared with a truth that orip had no part in."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pyproj
import pytest
from cli.command_line import orip
from support.aerial_block_in_crs import CRS, AerialBlock, aerial_block, geocentric, grid_axes
from threadpoolctl import threadpool_limits
from workflow.small_projects import replace_in

from orip.bundle.results.solution import solution_of
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.bundle.solve import solve_block
from orip.errors import InputError
from orip.records.block import Block
from orip.records.control import Control, ControlDirection, ControlDistance, ControlElement, DistanceCode
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Solution
from orip.structs import replace

pytestmark = pytest.mark.slow

EXACT = 1e-5
"""Metres and degrees: what rounding and the end of the iterations leave, with two digits to spare to a millimetre."""

POSITION, ANGLES = PHOTO_PARAMETERS[:3], PHOTO_PARAMETERS[3:]


@cache
def aerial() -> AerialBlock:
    return aerial_block()


def corners(x: float, y: float, z: float) -> dict[int, tuple[float, float, float]]:
    """Return the a-priori errors of control at the four corners."""
    return dict.fromkeys(aerial().corners, (x, y, z))


def control(errors: Mapping[int, tuple[float, float, float]], **others: tuple[object, ...]) -> Control:
    return Control(points=tuple(aerial().control(errors)), **others)


def solved(block: Block) -> Solution:
    with threadpool_limits(1):  # as the command line does: with more threads small systems take longer
        return solution_of(solve_block(block, lambda _: None, lambda: False))


def of_truth(solution: Solution) -> np.ndarray:
    """Return adjusted minus true coordinates of all points, in the order of the truth."""
    place = {name: row for row, name in enumerate(solution.points.names)}
    return solution.points.values[[place[name] for name in aerial().point_names]] - aerial().points


def deviations_of(solution: Solution, point: int) -> np.ndarray:
    return solution.points.sd[solution.points.names.index(aerial().point_names[point])]


def assert_true(solution: Solution) -> None:
    assert solution.status == "converged"
    np.testing.assert_allclose(of_truth(solution), 0.0, atol=EXACT)
    np.testing.assert_allclose(solution.photos.values, aerial().orientations, rtol=0.0, atol=EXACT)


def residuals_of(solution: Solution, kind: str) -> np.ndarray:
    return solution.residuals.residual[np.array(solution.residuals.kind) == kind]


# the earth's curvature


@pytest.mark.parametrize("error", [0.01, 0.0], ids=["weighted", "constant"])
def test_with_a_crs_the_block_is_true_everywhere(error: float) -> None:
    assert_true(solved(aerial().assembled(control(corners(error, error, error)))))


@pytest.mark.parametrize("error", [0.01, 0.0], ids=["weighted", "constant"])
def test_without_a_crs_check_points_show_the_curvature(error: float) -> None:
    solution = solved(aerial().assembled(control(corners(error, error, error)), crs=None))
    height = {point.name: point.dZ for point in solution.check_points}
    names = aerial().point_names
    # d² / 2R: 7071 m from the corners, and 5000 m along a side
    assert height[names[aerial().middle]] == pytest.approx(3.92, abs=0.02)
    for side in aerial().middles_of_the_sides:
        assert height[names[side]] == pytest.approx(1.96, abs=0.02)


def test_check_points_are_compared_in_the_crs() -> None:
    solution = solved(aerial().assembled(control(corners(0.01, 0.01, 0.01))))
    assert len(solution.check_points) == len(aerial().points) - 4
    differences = [(point.dX, point.dY, point.dZ) for point in solution.check_points]
    np.testing.assert_allclose(differences, 0.0, atol=EXACT)
    np.testing.assert_allclose(residuals_of(solution, "control"), 0.0, atol=EXACT)


def test_a_block_with_heights_above_a_geoid_is_true_too() -> None:
    # ellipsoidal heights by another name: the transformation of heights is used, and changes nothing
    solution = solved(aerial().assembled(control(corners(0.01, 0.01, 0.01)), crs="EPSG:32632+ESRI:115700"))
    # the ellipsoids of ETRS89 and WGS 84 differ by 0.1 mm
    np.testing.assert_allclose(of_truth(solution), 0.0, atol=1e-3)


# precision about the project's axes


def test_a_priori_errors_and_deviations_are_about_the_axes_of_the_project() -> None:
    # eastings 500 times as good as northings, and the grid is turned by 1.9 degrees against the local frame
    given = control(corners(0.001, 0.5, 0.5))
    curved, plain = (solved(aerial().assembled(given, crs)) for crs in (CRS, None))
    ratio = (curved.points.sd / curved.sigma0) / (plain.points.sd / plain.sigma0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.02)
    ratio = (curved.photos.sd / curved.sigma0) / (plain.photos.sd / plain.sigma0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.02)
    corner = deviations_of(curved, aerial().corners[0]) / curved.sigma0
    assert corner[0] < 0.001
    assert corner[1] > 0.1


def test_rotations_that_are_observed_are_about_the_axes_of_the_project() -> None:
    errors = (0.5, 0.001, 0.2)
    elements = tuple(
        ControlElement("P1", "PHOTO", kind, aerial().orientations[0, 3 + place], error)
        for place, (kind, error) in enumerate(zip(ANGLES, errors, strict=True))
    )
    given = control(corners(50.0, 50.0, 50.0), elements=elements)
    curved, plain = (solved(aerial().assembled(given, crs)) for crs in (CRS, None))
    assert_true(curved)
    np.testing.assert_allclose(residuals_of(curved, "element"), 0.0, atol=EXACT)
    ratio = (curved.photos.sd / curved.sigma0) / (plain.photos.sd / plain.sigma0)
    np.testing.assert_allclose(ratio[:, 3:], 1.0, atol=0.02)


def test_what_a_removed_unknown_belongs_to_has_no_deviations() -> None:
    block = aerial().assembled(control(corners(0.01, 0.01, 0.01)))
    name = aerial().point_names[aerial().middle]
    rays = np.flatnonzero(block.photo_points.point == block.point_names.index(name))
    block.photo_points.used[rays[1:]] = False
    solution = solved(block)
    (singular,) = solution.singular
    assert (singular.group, singular.name) == ("POINT", name)
    assert np.isinf(deviations_of(solution, aerial().middle)).all()
    assert name not in [point.name for point in solution.check_points]


# constants


def test_single_coordinates_are_held_in_the_project() -> None:
    west, north = aerial().corners[0], aerial().corners[3]
    errors = {
        **dict.fromkeys(aerial().corners, (0.01, 0.01, 0.01)),
        west: (0.0, 0.0, 0.01),
        north: (0.01, 0.01, 0.0),
    }
    points = aerial().control(errors)
    middle = points[aerial().middle]
    points[aerial().middle] = replace(middle, coordinates=(None, middle.coordinates[1], None), errors=(None, 0.0, None))
    solution = solved(aerial().assembled(Control(points=tuple(points))))
    assert_true(solution)
    held = {point: np.isnan(deviations_of(solution, point)).tolist() for point in (west, north, aerial().middle)}
    assert held[west] == [True, True, False]
    assert held[north] == [False, False, True]
    assert held[aerial().middle] == [False, True, False]
    assert np.isnan(solution.points.sd).sum() == 4
    np.testing.assert_allclose(residuals_of(solution, "constant element"), 0.0, atol=1e-6)


def test_a_held_coordinate_is_held_though_all_else_contradicts() -> None:
    points = aerial().control({**corners(0.01, 0.01, 0.01), aerial().middle: (-1.0, -1.0, 0.0)})
    x, y, z = points[aerial().middle].coordinates
    points[aerial().middle] = replace(points[aerial().middle], coordinates=(x, y, z + 0.3))
    block = aerial().assembled(Control(points=tuple(points)))
    # photo errors so large that the block bends to the height
    weak = replace(block, photo_points=replace(block.photo_points, error=block.photo_points.error * 100.0))
    solution = solved(weak)
    assert solution.status == "converged"
    assert of_truth(solution)[aerial().middle, 2] == pytest.approx(0.3, abs=1e-5)


@pytest.mark.parametrize(
    ("kinds", "unknowns_less", "equations"),
    [
        (POSITION, 3, 0),
        (PHOTO_PARAMETERS, 6, 0),
        (("Z0",), 0, 1),
        (("X0", "KAPPA"), 0, 2),
        ((*POSITION, "PHI"), 3, 1),
        (ANGLES, 0, 3),
    ],
    ids=str,
)
def test_constant_elements_of_photos(kinds: tuple[str, ...], unknowns_less: int, equations: int) -> None:
    photo = 8
    given = control(corners(0.01, 0.01, 0.01))
    free = solved(aerial().assembled(given))
    solution = solved(aerial().assembled(given, constant={photo: kinds}))
    assert_true(solution)
    assert free.unknowns - solution.unknowns == unknowns_less
    assert solution.observations - free.observations == equations
    assert solution.redundancy - free.redundancy == len(kinds)
    held = [PHOTO_PARAMETERS.index(kind) for kind in kinds]
    np.testing.assert_allclose(solution.photos.values[photo, held], aerial().orientations[photo, held], atol=1e-7)
    assert np.flatnonzero(np.isnan(solution.photos.sd[photo])).tolist() == held


def test_an_element_with_error_0_holds_the_coordinate_of_the_project() -> None:
    name = aerial().point_names[aerial().middle]
    elements = (
        ControlElement(name, "POINT", "Y", aerial().points[aerial().middle, 1], 0.0),
        ControlElement("P3", "PHOTO", "Z0", aerial().orientations[2, 2], 0.0),
        ControlElement("P4", "PHOTO", "X0", aerial().orientations[3, 0], 0.01),
        ControlElement(aerial().point_names[5], "POINT", "Z", aerial().points[5, 2], 0.01),
    )
    solution = solved(aerial().assembled(control(corners(0.01, 0.01, 0.01), elements=elements)))
    assert_true(solution)
    assert np.isnan(deviations_of(solution, aerial().middle)).tolist() == [False, True, False]
    assert np.isnan(solution.photos.sd[2]).tolist() == [False, False, True, False, False, False]


def test_photos_positioned_from_the_air_need_no_control() -> None:
    elements = tuple(
        ControlElement(name, "PHOTO", kind, value, 0.05)
        for name, row in zip(aerial().photo_names, aerial().orientations.tolist(), strict=True)
        for kind, value in zip(POSITION, row, strict=False)
    )
    assert_true(solved(aerial().assembled(Control(elements=elements))))


# distances and directions


def distances(error: float, codes: tuple[DistanceCode, ...]) -> tuple[ControlDistance, ...]:
    """Return true distances between the ends of a diagonal and of a side."""
    first, second, _, last = aerial().corners
    found = []
    for start, end in ((first, last), (first, second)):
        on_grid = aerial().points[end] - aerial().points[start]
        spatial = float(np.linalg.norm(np.diff(geocentric(aerial().points[[start, end]]), axis=0)))
        length = {"X": on_grid[0], "Y": on_grid[1], "XY": np.hypot(*on_grid[:2]), "XYZ": spatial}
        a, b = aerial().point_names[start], aerial().point_names[end]
        found += [ControlDistance(f"{code}{a}{b}", a, b, code, float(length[code]), error) for code in codes]
    return tuple(found)


@pytest.mark.parametrize("error", [0.01, 0.0, -0.01], ids=["weighted", "constant", "disregarded"])
def test_spatial_distances_are_true_lengths_and_plane_ones_are_on_the_grid(error: float) -> None:
    given = distances(error, ("XYZ", "XY", "X", "Y"))
    assert given[0].distance - given[1].distance > 0.4, "the grid is smaller than the ground"
    solution = solved(aerial().assembled(control(corners(0.01, 0.01, 0.01), distances=given)))
    assert_true(solution)
    kind = "distance" if error else "constant distance"
    np.testing.assert_allclose(residuals_of(solution, kind), np.zeros(8), atol=EXACT)


def test_directions_refer_to_grid_north_and_the_normal_at_the_station() -> None:
    stations, targets = (0, 70), (13, 24, 80)
    found = []
    for station in stations:
        places = aerial().points[[station, *targets]]
        axes, geocentric_places = grid_axes(places[:1])[0], geocentric(places)
        for target, offset in zip(targets, (geocentric_places[1:] - geocentric_places[0]) @ axes.T, strict=True):
            azimuth = np.degrees(np.arctan2(offset[0], offset[1]))
            zenith = np.degrees(np.arctan2(np.hypot(*offset[:2]), offset[2]))
            names = (aerial().point_names[station], aerial().point_names[target])
            found.append(ControlDirection(f"S{station}", *names, (azimuth - 17.0) % 360.0, 0.001, zenith, 0.001))
    solution = solved(aerial().assembled(control(corners(0.01, 0.01, 0.01), directions=tuple(found))))
    assert_true(solution)
    np.testing.assert_allclose(residuals_of(solution, "direction"), np.zeros(12), atol=1e-8)


def test_a_free_network_is_adjusted_in_the_frame() -> None:
    block = aerial().assembled(Control(distances=distances(0.01, ("XYZ",))), datum="free", shift=5.0)
    solution = solved(block)
    assert solution.status == "converged"
    assert solution.sigma0 < 1e-3
    # the network floats by what its photos started off, but is not bent: heights are those of a plane
    off = of_truth(solution)[:, 2]
    plane = np.column_stack([aerial().points[:, :2] - aerial().points[:, :2].mean(axis=0), np.ones(len(off))])
    rest = off - plane @ np.linalg.lstsq(plane, off, rcond=None)[0]
    np.testing.assert_allclose(rest, 0.0, atol=0.01)


# blunders, starting values, refusals


def test_snooping_finds_a_wrong_coordinate_along_the_axis_of_the_project() -> None:
    errors = {**corners(0.05, 0.05, 0.05), **dict.fromkeys((35, 60, 85), (0.05, 0.05, 0.05))}
    points = aerial().control(errors)
    x, y, z = points[60].coordinates
    points[60] = replace(points[60], coordinates=(x, y + 2.0, z))
    found = snoop(
        aerial().assembled(Control(points=tuple(points))), SnoopingSettings(), lambda _: None, lambda: False
    ).blunders
    assert {(blunder.kind, blunder.point) for blunder in found} == {("control", aerial().point_names[60])}
    # size is what the observation has too much
    assert {blunder.component: round(blunder.size, 4) for blunder in found} == {"X": 0.0, "Y": 2.0, "Z": 0.0}


def test_an_observation_far_from_its_place_is_named() -> None:
    points = aerial().control(corners(0.01, 0.01, 0.01))
    points[7] = replace(points[7], coordinates=(1e30, 5e6, 500.0))
    with pytest.raises(InputError, match=f"control point {points[7].name} has the coordinates"):
        aerial().assembled(Control(points=tuple(points)))


def test_a_misprint_does_not_move_the_frame() -> None:
    points = aerial().control(corners(0.01, 0.01, 0.01))
    before = aerial().assembled(Control(points=tuple(points))).ground
    x, y, z = points[7].coordinates
    points[7] = replace(points[7], coordinates=(x, y * 1.01, z))
    after = aerial().assembled(Control(points=tuple(points))).ground
    assert before.description() == after.description()


def test_a_free_network_with_distances_on_the_grid_is_refused() -> None:
    with pytest.raises(InputError, match=r"is taken on the map grid .* give a spatial distance \(XYZ\)"):
        aerial().assembled(Control(distances=distances(0.01, ("XY",))), datum="free")


# the command line


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return aerial().write(tmp_path / "aerial", CRS, aerial().control(corners(0.01, 0.01, 0.01)))


def test_orip_run_with_a_crs(project: Path) -> None:
    said = orip(project, "run", "--json")
    assert said.code == 0, said.err
    differences = [point[axis] for point in said.document["check_points"] for axis in ("dX", "dY", "dZ")]
    # photo coordinates are written to a millionth of a millimetre, 0.02 mm on the ground
    assert np.abs(differences).max() < 0.001
    assert [warning["code"] for warning in said.document["warnings"]].count("crs-without-heights") == 1
    listing = (project / "BUNDLE_RESULT.OUT").read_text()
    assert "GROUND SYSTEM" in listing
    assert "Coordinates are in crs EPSG:25832 (ETRS89 / UTM zone 32N)" in listing
    assert "Rotations refer to grid east, grid north and the ellipsoid's normal at each projection centre" in listing
    files = {path.name: path.read_bytes() for path in project.iterdir()}
    assert orip(project, "solve").code == 0
    assert {path.name: path.read_bytes() for path in project.iterdir()} == files, "a second run changes nothing"


def test_a_changed_crs_is_a_changed_input(project: Path) -> None:
    assert orip(project, "run").code == 0
    replace_in(project / "orip.toml", 'crs = "EPSG:25832"\n', "")
    assert "crs of orip.toml" in orip(project, "status").out
    assert orip(project, "run").code == 0
    assert "GROUND SYSTEM" not in (project / "BUNDLE_RESULT.OUT").read_text()
    assert "up to date" in orip(project, "status").out


def test_heights_that_need_a_missing_grid_are_refused(project: Path) -> None:
    assert orip(project, "init").code == 0
    assert orip(project, "measure").code == 0
    replace_in(project / "orip.toml", "EPSG:25832", "EPSG:25832+7837")
    folders = [*pyproj.datadir.get_data_dir().split(":"), pyproj.datadir.get_user_data_dir()]
    if pyproj.network.is_network_enabled() or any((Path(folder) / "de_bkg_gcg2016.tif").exists() for folder in folders):
        pytest.skip("PROJ has, or may fetch, the grid")
    said = orip(project, "solve")
    assert said.code == 3
    assert "de_bkg_gcg2016.tif" in said.err
    assert "pyproj sync --file de_bkg_gcg2016.tif" in " ".join(said.err.split())
    assert not (project / "result.json").exists()


def test_a_unit_that_is_not_that_of_the_crs_is_refused(project: Path) -> None:
    replace_in(project / "orip.toml", 'ground_unit = "m"', 'ground_unit = "foot"')
    said = orip(project, "run")
    assert said.code == 3
    assert 'set ground_unit = "m"' in " ".join(said.err.split())


def test_pyproj_is_imported_for_a_crs_alone() -> None:
    program = "import sys, orip.workflow.adjust.solve; sys.exit('pyproj' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
