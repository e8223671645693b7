"""Ground frames: exact, reversible, and refused where something is missing."""

from __future__ import annotations

import os
import struct
from functools import cache
from pathlib import Path

import numpy as np
import pyproj
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orip.errors import InputError
from orip.geometry.ground_ellipsoid import geocentric_from_geographic, geographic_from_geocentric, place_axes
from orip.geometry.ground_frame import GroundFrame, ground_frame

PROJECTS = {
    "EPSG:25832": ("m", (620000.0, 5550000.0, 300.0)),
    "EPSG:2056": ("m", (2650000.0, 1200000.0, 600.0)),
    "EPSG:32622": ("m", (400000.0, 7950000.0, 50.0)),
    "EPSG:2263": ("US survey foot", (1000000.0, 200000.0, 100.0)),
    "EPSG:2256": ("foot", (1500000.0, 500000.0, 3000.0)),
    "EPSG:31467": ("m", (3520000.0, 5500000.0, 200.0)),  # registered as northing, easting
    "EPSG:5514": ("m", (-600000.0, -1100000.0, 300.0)),  # oblique, turned by 6 degrees
    "EPSG:27571": ("m", (700000.0, 1150000.0, 100.0)),  # grads from Paris
    "EPSG:3031": ("m", (100000.0, -300000.0, 2000.0)),  # turned by 162 degrees
    "EPSG:32661": ("m", (2000000.0, 2000100.0, 0.0)),  # 100 m from the pole
    "EPSG:32701": ("m", (200000.0, 8100000.0, 500.0)),  # across the 180th meridian
    "EPSG:3035": ("m", (4500000.0, 2500000.0, 100.0)),  # equal-area
    "EPSG:32632+ESRI:115700": ("m", (500000.0, 5550000.0, 100.0)),  # ellipsoidal heights, named
}
CONFORMAL = [crs for crs in PROJECTS if crs not in ("EPSG:3035", "EPSG:27571")]


@cache
def frame_of(crs: str) -> GroundFrame:
    unit, origin = PROJECTS[crs]
    return ground_frame(crs, unit, np.array(origin))


def scattered(frame: GroundFrame, count: int = 50) -> np.ndarray:
    """Return local places within 50 km and 5 km of height."""
    metres = np.random.default_rng(7).uniform(-1.0, 1.0, (count, 3)) * [5e4, 5e4, 5e3]
    return metres / frame.crs.metres_per_unit


def complaint(crs: str, unit: str, origin: tuple[float, float, float]) -> str:
    with pytest.raises(InputError) as caught:
        ground_frame(crs, unit, np.array(origin))
    return str(caught.value)


def installed(grid: str) -> bool:
    folders = [*pyproj.datadir.get_data_dir().split(os.pathsep), pyproj.datadir.get_user_data_dir()]
    return any((Path(folder) / grid).is_file() for folder in folders)


def write_geoid(path: Path, heights: np.ndarray) -> Path:
    """Write geoid heights on a grid of half degrees from 8 E 49 N (GTX format)."""
    path.write_bytes(struct.pack(">ddddii", 49.0, 8.0, 0.5, 0.5, *heights.shape) + heights.astype(">f4").tobytes())
    return path


@pytest.mark.parametrize("crs", PROJECTS)
@settings(max_examples=30, deadline=None)
@given(metres=st.tuples(st.floats(-5e4, 5e4), st.floats(-5e4, 5e4), st.floats(-1e3, 9e3)))
def test_local_to_project_and_back_is_the_same(crs: str, metres: tuple[float, float, float]) -> None:
    frame = frame_of(crs)
    unit = frame.crs.metres_per_unit
    local = np.array([metres]) / unit
    project = frame.to_project(local)
    # eastings and northings are held to 1e-9 m, and projections are iterated to a little more
    np.testing.assert_allclose(frame.to_local(project) * unit, local * unit, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(frame.to_project(frame.to_local(project)), project, rtol=0.0, atol=1e-7 / unit)


@pytest.mark.parametrize("crs", PROJECTS)
def test_the_origin_is_the_origin(crs: str) -> None:
    frame = frame_of(crs)
    np.testing.assert_allclose(frame.to_local(frame.origin[None]), np.zeros((1, 3)), rtol=0.0, atol=1e-7)


def test_agrees_with_proj_topocentric() -> None:
    frame = frame_of("EPSG:25832")
    place = frame.crs.to_geographic(frame.origin[None])[0]
    longitude, latitude, height = [*np.degrees(place[:2]).tolist(), float(place[2])]
    pipeline = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=utm +zone=32 +ellps=GRS80 +step +proj=cart +ellps=GRS80 "
        f"+step +proj=topocentric +ellps=GRS80 +lon_0={longitude!r} +lat_0={latitude!r} +h_0={height!r}"
    )
    project = frame.to_project(scattered(frame))
    expected = np.stack(pipeline.transform(*project.T), axis=1)
    np.testing.assert_allclose(frame.to_local(project), expected, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("latitude", [-90.0, -45.0, 0.0, 51.0, 89.9999, 90.0])
def test_geocentric_to_geographic_is_exact(latitude: float) -> None:
    height = np.array([-1e3, 0.0, 9e3, 1e6])
    places = np.stack([np.full(4, 0.3), np.full(4, np.radians(latitude)), height], axis=1)
    axes = (6378137.0, 6356752.314140356)
    geocentric = geocentric_from_geographic(places, axes)
    expected = np.stack(pyproj.Transformer.from_pipeline("+proj=cart +ellps=GRS80").transform(*places.T, radians=True))
    np.testing.assert_allclose(geocentric, expected.T, rtol=0.0, atol=1e-8)
    back = geographic_from_geocentric(geocentric, axes)
    np.testing.assert_allclose(back[:, 1], places[:, 1], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(back[:, 2], height, rtol=0.0, atol=3e-9)


@pytest.mark.parametrize(("kilometres", "drop"), [(1.0, 0.078), (5.0, 1.96), (10.0, 7.83)])
@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:2263"])
def test_a_place_of_equal_height_lies_lower_by_the_curvature(crs: str, kilometres: float, drop: float) -> None:
    frame = frame_of(crs)
    metres = 1000.0 * kilometres
    directions = np.radians(np.arange(0.0, 360.0, 30.0))
    around = frame.origin + metres / frame.crs.metres_per_unit * np.stack(
        [np.cos(directions), np.sin(directions), np.zeros(12)], axis=1
    )
    up = frame.to_local(around)[:, 2] * frame.crs.metres_per_unit
    # -d² / 2R: within 1 % for the radius that changes with direction and the scale of the grid
    np.testing.assert_allclose(up, -drop, rtol=0.01)


def test_local_lengths_are_true_lengths_and_grid_lengths_are_not() -> None:
    frame = frame_of("EPSG:25832")
    ends = np.array([[-500.0, 0.0, 0.0], [500.0, 0.0, 0.0]])
    on_grid = np.diff(frame.to_project(ends), axis=0)[0]
    # 300 m up, lengths to the east and to the north differ from their mean by 300 m (1/M - 1/N) / 2
    assert np.hypot(*on_grid[:2]) / 1000.0 == pytest.approx(frame.scale, abs=1e-7)
    assert frame.scale < 0.99980
    inverse = pyproj.Geod(ellps="GRS80")
    (lon, lat, _), (lon2, lat2, _) = np.degrees(frame.crs.to_geographic(frame.to_project(ends)))
    # the geodesic is on the ellipsoid, 300 m below
    assert inverse.inv(lon, lat, lon2, lat2)[2] * (1.0 + 300.0 / 6.388e6) == pytest.approx(1000.0, abs=1e-4)


@pytest.mark.parametrize("crs", PROJECTS)
def test_axes_are_orthonormal_and_right_handed(crs: str) -> None:
    frame = frame_of(crs)
    axes = frame.axes_at(frame.to_project(scattered(frame)))
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.broadcast_to(np.eye(3), axes.shape), atol=2e-15)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0, atol=2e-15)


@pytest.mark.parametrize("crs", CONFORMAL)
@pytest.mark.filterwarnings("ignore:You will likely lose important projection information")
def test_axes_have_the_meridian_convergence_of_proj(crs: str) -> None:
    frame = frame_of(crs)
    project = frame.to_project(scattered(frame))
    place = frame.crs.to_geographic(project)
    axes = frame.axes_at(project)
    grid_in_place = axes @ frame.axes @ place_axes(place).transpose(0, 2, 1)
    # grid north seen from true north, to the east; the ellipsoid's normal stays where it is
    ours = np.arctan2(grid_in_place[:, 1, 0], grid_in_place[:, 1, 1])
    np.testing.assert_allclose(grid_in_place[:, 2], np.broadcast_to([0.0, 0.0, 1.0], (50, 3)), atol=2e-15)
    horizontal = pyproj.CRS(crs.split("+", maxsplit=1)[0])
    factors = pyproj.Proj(horizontal).get_factors(place[:, 0], place[:, 1], radians=True)
    theirs = np.radians(factors.meridian_convergence)
    difference = (ours - theirs + np.pi) % (2.0 * np.pi) - np.pi
    # both are numerical derivatives, ours good to some 5e-11
    np.testing.assert_allclose(difference, 0.0, atol=1e-10)


def test_axes_at_the_origin_turn_by_the_convergence_alone() -> None:
    frame = frame_of("EPSG:25832")
    sine, cosine = np.sin(frame.convergence), np.cos(frame.convergence)
    expected = [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(frame.axes_at(frame.origin[None])[0], expected, atol=1e-9)
    # (longitude - 9°) sin(latitude)
    assert np.degrees(frame.convergence) == pytest.approx(1.6776 * np.sin(np.radians(50.09)), abs=1e-3)


def test_the_vertical_tilts_by_a_minute_of_arc_in_1855_metres() -> None:
    frame = frame_of("EPSG:25832")
    axes = frame.axes_at(frame.to_project(np.array([[0.0, 1855.0, 0.0]])))[0]
    assert np.degrees(np.arccos(axes[2, 2])) * 60.0 == pytest.approx(1.0, rel=0.005)
    assert axes[2, 1] > 0.0


def test_where_the_grid_is_not_conformal_axes_are_the_nearest_rotation() -> None:
    frame = frame_of("EPSG:3035")
    place = frame.to_project(scattered(frame, 10))
    jacobian, axes = frame.jacobian_at(place), frame.axes_at(place)
    # in two dimensions the nearest rotation leaves a symmetric rest
    rest = (jacobian @ axes.transpose(0, 2, 1))[:, :2, :2]
    np.testing.assert_allclose(rest[:, 0, 1], rest[:, 1, 0], atol=1e-14)
    assert "crs-not-conformal" in [warning.code for warning in frame.warnings]
    assert "crs-not-conformal" not in [warning.code for warning in frame_of("EPSG:25832").warnings]


def test_high_mountains_do_not_make_a_conformal_system_another() -> None:
    low, high = (ground_frame("EPSG:32645", "m", np.array([480000.0, 3095000.0, z])) for z in (0.0, 8849.0))
    assert [warning.code for warning in high.warnings] == [warning.code for warning in low.warnings]
    assert high.convergence == pytest.approx(low.convergence, abs=1e-10)


@pytest.mark.parametrize("crs", PROJECTS)
def test_partials_are_the_derivatives(crs: str) -> None:
    frame = frame_of(crs)
    local, step = scattered(frame), 20.0 / frame.crs.metres_per_unit
    value, by_local = frame.project_with_partials(local)
    np.testing.assert_array_equal(value, frame.to_project(local))
    numerical = np.stack(
        [(frame.to_project(local + step * e) - frame.to_project(local - step * e)) / (2.0 * step) for e in np.eye(3)],
        axis=2,
    )
    np.testing.assert_allclose(by_local, numerical, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(frame.jacobian_at(value), by_local, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(frame.to_local(value), local, rtol=0.0, atol=1e-6)


def test_unknown_and_impossible_coordinates_have_no_place() -> None:
    frame = frame_of("EPSG:25832")
    given_places = np.array([[np.nan, 5.5e6, 3.0], [6e5, 5.5e6, np.nan], [1e30, 1e30, 1.0], frame.origin])
    np.testing.assert_array_equal(np.isnan(frame.to_local(given_places)).all(axis=1), [True, True, True, False])
    jacobian = frame.jacobian_at(given_places)
    np.testing.assert_array_equal(np.isnan(jacobian).any(axis=(1, 2)), [True, True, True, False])
    assert frame.to_project(np.empty((0, 3))).shape == (0, 3)
    assert frame.jacobian_at(np.empty((0, 3))).shape == (0, 3, 3)


def test_heights_above_a_geoid_are_taken_to_the_ellipsoid(tmp_path: Path) -> None:
    rows, columns = np.mgrid[0:5, 0:5]
    path = write_geoid(tmp_path / "geoid.gtx", 45.0 + 2.0 * columns + 1.0 * rows)
    crs = f"+proj=utm +zone=32 +datum=WGS84 +units=m +geoidgrids={path} +type=crs"
    origin = np.array([500000.0, 5550000.0, 100.0])
    frame = ground_frame(crs, "m", origin)
    longitude, latitude, height = frame.crs.to_geographic(origin[None])[0]
    separation = 45.0 + 2.0 * (np.degrees(longitude) - 8.0) / 0.5 + (np.degrees(latitude) - 49.0) / 0.5
    assert height == pytest.approx(100.0 + separation, abs=1e-6)
    assert not frame.warnings
    local = np.array([[3000.0, 4000.0, 50.0], [-7000.0, 2000.0, 0.0]])
    project = frame.to_project(local)
    np.testing.assert_allclose(frame.to_local(project), local, rtol=0.0, atol=1e-7)
    # the geoid rises by 4 m per degree of longitude: heights above it fall to the east by that
    by_local = frame.jacobian_at(origin[None])[0]
    assert by_local[2, 0] == pytest.approx(-4.0 / (111320.0 * np.cos(latitude)), rel=0.01)
    numerical = np.stack(
        [(frame.to_project(local + 20 * e) - frame.to_project(local - 20 * e)) / 40 for e in np.eye(3)], axis=2
    )
    np.testing.assert_allclose(frame.jacobian_at(project), numerical, rtol=0.0, atol=1e-8)


def test_a_geoid_that_does_not_reach_the_block_is_refused(tmp_path: Path) -> None:
    path = write_geoid(tmp_path / "geoid.gtx", np.full((5, 5), 45.0))
    crs = f"+proj=utm +zone=32 +datum=WGS84 +units=m +geoidgrids={path} +type=crs"
    text = complaint(crs, "m", (500000.0, 6550000.0, 100.0))
    assert "does not reach the middle of the block" in text


@pytest.mark.parametrize(
    ("crs", "origin", "grids"),
    [
        ("EPSG:32622+5773", (400000.0, 7950000.0, 50.0), ["us_nga_egm96_15.tif"]),
        ("EPSG:25832+7837", (500000.0, 5550000.0, 100.0), ["de_bkg_gcg2016.tif"]),
        ("EPSG:28992+5709", (155000.0, 463000.0, 0.0), ["nl_nsgi_nlgeo2018.tif"]),  # older PROJ wants a second one
    ],
)
def test_without_the_geoid_grid_heights_are_refused(
    crs: str, origin: tuple[float, float, float], grids: list[str]
) -> None:
    if pyproj.network.is_network_enabled() or any(installed(grid) for grid in grids):
        pytest.skip("PROJ has, or may fetch, the grid")
    text = complaint(crs, "m", origin)
    for grid in grids:
        assert f"pyproj sync --file {grid}" in text
    assert "leave heights unchanged" in text
    assert crs in text


def test_a_grid_that_proj_does_not_distribute_is_named_too(tmp_path: Path) -> None:
    path = tmp_path / "missing.gtx"
    text = complaint(f"+proj=utm +zone=32 +datum=WGS84 +geoidgrids={path} +type=crs", "m", (5e5, 5.55e6, 100.0))
    assert f"get {path} from its publisher" in text


def test_heights_that_nothing_leads_from_are_refused() -> None:
    text = complaint("EPSG:25832+5783", "m", (500000.0, 5550000.0, 100.0))
    assert "DHHN92 height" in text
    assert "PROJ knows no transformation" in text


@pytest.mark.parametrize(
    ("crs", "unit", "words"),
    [
        ("EPSG:2263", "m", 'set ground_unit = "US survey foot"'),
        ("EPSG:2263", "foot", 'set ground_unit = "US survey foot"'),
        ("EPSG:2256", "US survey foot", 'set ground_unit = "foot"'),
        ("EPSG:25832", "US survey foot", 'set ground_unit = "m"'),
        ("EPSG:25832", "km", 'set ground_unit = "m"'),
        ("EPSG:25832", "ell", 'set ground_unit = "m"'),
        ("EPSG:2263+5703", "US survey foot", "X, Y and Z must have one unit"),
        ("EPSG:2227+6360", "m", 'set ground_unit = "US survey foot"'),
        ("EPSG:27291", "m", "which orip does not know"),
        ("EPSG:25832+5715", "m", "not of depths"),
        ("EPSG:2048", "m", "Westing (west) and Southing (south)"),
        ("EPSG:5513", "m", "EPSG:5514"),
        ("EPSG:4326", "m", "Geographic 2D CRS"),
        ("EPSG:4979", "m", "is not a projected system"),
        ("EPSG:4978", "m", "Geocentric CRS"),
        ("EPSG:5773", "m", "Vertical CRS"),
        ("EPSG:4326+5773", "m", "is not a projected system"),
        ("+proj=topocentric +lat_0=50 +lon_0=9", "m", "is not a projected system"),
        ("EPSG:99999", "m", "crs not found: EPSG:99999"),
        ("Gauss-Boaga on Sundays", "m", "is not known to PROJ; give the code of a projected system"),
        ("EPSG 25832", "m", "is not known to PROJ; did you mean "),
    ],
)
def test_a_system_that_does_not_fit_is_refused(crs: str, unit: str, words: str) -> None:
    assert words in complaint(crs, unit, (500000.0, 5550000.0, 0.0))


def test_axes_and_unit_are_complained_of_together() -> None:
    with pytest.raises(InputError) as caught:
        ground_frame("EPSG:2048", "foot", np.array([0.0, 3500000.0, 0.0]))
    assert len(caught.value.complaints) == 2


def test_coordinates_that_are_nowhere_are_refused() -> None:
    text = complaint("EPSG:25832", "m", (5e30, 5550000.0, 0.0))
    assert "the middle of the block" in text
    assert "X is the easting" in text


def test_interchanged_coordinates_are_warned_of() -> None:
    frame = ground_frame("EPSG:2056", "m", np.array([1200000.0, 2650000.0, 600.0]))
    found = [warning for warning in frame.warnings if warning.code == "crs-outside-area"]
    assert len(found) == 1
    assert "Switzerland" in found[0].text


@pytest.mark.parametrize("crs", PROJECTS)
def test_the_projects_of_these_tests_lie_in_their_systems(crs: str) -> None:
    codes = {warning.code for warning in frame_of(crs).warnings}
    assert "crs-outside-area" not in codes
    assert ("crs-without-heights" in codes) == ("+" not in crs)


def test_a_datum_shift_bound_to_the_system_changes_nothing() -> None:
    origin = np.array([500000.0, 5550000.0, 100.0])
    plain = ground_frame("+proj=utm +zone=32 +ellps=GRS80 +type=crs", "m", origin)
    bound = ground_frame("+proj=utm +zone=32 +ellps=GRS80 +towgs84=100,200,300 +type=crs", "m", origin)
    place = origin + np.array([1000.0, 2000.0, 30.0])
    np.testing.assert_array_equal(plain.to_local(place[None]), bound.to_local(place[None]))


def test_a_system_in_wkt_is_shown_by_its_name() -> None:
    wkt = pyproj.CRS("EPSG:25832").to_3d().to_wkt()
    frame = ground_frame(wkt, "m", np.array([500000.0, 5550000.0, 100.0]))
    assert frame.crs.shown == "ETRS89 / UTM zone 32N"
    assert not frame.warnings


def test_the_description_says_what_coordinates_and_rotations_refer_to() -> None:
    lines = frame_of("EPSG:32622").description()
    assert "local topocentric frame at 71.629832° N 53.843859° W (WGS 84)" in lines[0]
    assert "EPSG:32622 (WGS 84 / UTM zone 22N)" in lines[1]
    assert "grid north" in lines[2]
    assert "convergence -2.69916°" in lines[3]
