"""Areas, lines and terrain of files: taken to the project, or refused with one clear message."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from orip.errors import InputError
from orip.planning.areas import checked_outline, read_outline, refuse_other_system
from orip.planning.designed import terrain_of_raster

SQUARE = [[10.0, 53.0], [10.004, 53.0], [10.004, 53.003], [10.0, 53.003], [10.0, 53.0]]


def geojson(path: Path, ring: list, kind: str = "Polygon") -> None:
    shape = {"type": kind, "coordinates": [ring] if kind == "Polygon" else ring}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": shape}]}))


def test_areas_of_files_are_taken_to_the_project(tmp_path):
    from pyproj import Transformer

    to_project = Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True)
    expected = np.array(to_project.transform(*np.array(SQUARE).T)).T
    geojson(tmp_path / "a.geojson", SQUARE)
    assert np.allclose(read_outline(tmp_path / "a.geojson", "a", "EPSG:25832", is_line=False), expected, atol=1e-3)
    places = " ".join(f"{x},{y},0" for x, y in SQUARE)
    kml = f"<kml><Placemark><Polygon><coordinates>{places}</coordinates></Polygon></Placemark></kml>"
    (tmp_path / "a.kml").write_text(kml)
    assert np.allclose(read_outline(tmp_path / "a.kml", "a", "EPSG:25832", is_line=False), expected, atol=1e-3)


def test_an_area_over_the_180th_meridian_is_one(tmp_path):
    geojson(tmp_path / "a.geojson", [[179.999, 0.0], [-179.999, 0.0], [-179.999, 0.001], [179.999, 0.001]])
    found = read_outline(tmp_path / "a.geojson", "a", "EPSG:3832", is_line=False)
    assert np.ptp(found[:, 0]) == pytest.approx(math.radians(0.002) * 6378137.0, rel=1e-6)


@pytest.mark.parametrize(
    ("ring", "crs", "said"),
    [
        ([[0.0, 90.0], [120.0, 89.99], [-120.0, 89.99]], "EPSG:25832", "crs"),
        ([[500.0, 53.0], [10.0, 53.0], [10.0, 54.0]], "EPSG:25832", "longitude"),
        ([[10.0, 153.0], [10.0, 53.0], [11.0, 54.0]], "EPSG:25832", "longitude"),
        (SQUARE, None, "no crs"),
    ],
)
def test_places_that_a_project_has_not_are_refused(tmp_path, ring, crs, said):
    geojson(tmp_path / "a.geojson", ring)
    with pytest.raises(InputError, match=said):
        read_outline(tmp_path / "a.geojson", "a.geojson", crs, is_line=False)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"type": "Polygon", "coordinates": [["a"]]}', "<kml>"])
def test_files_that_are_no_areas_are_refused(tmp_path, text):
    for name in ("a.geojson", "a.kml"):
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError):
            read_outline(tmp_path / name, name, "EPSG:25832", is_line=False)


def kml(path: Path, inside: str) -> None:
    head = '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
    path.write_text(f"{head}{inside}</Document></kml>")


def places_of(ring: list) -> str:
    return "<coordinates>" + " ".join(f"{x},{y},0" for x, y in ring) + "</coordinates>"


POLYGON = (
    f"<Polygon><outerBoundaryIs><LinearRing>{places_of(SQUARE)}</LinearRing></outerBoundaryIs><innerBoundaryIs>"
    f"<LinearRing>{places_of([[10.001, 53.001], [10.002, 53.001], [10.001, 53.002]])}</LinearRing></innerBoundaryIs>"
    "</Polygon>"
)
LINE = f"<LineString>{places_of([[10.0, 53.0], [10.01, 53.0]])}</LineString>"
HOME = f"<Placemark><name>home</name><Point>{places_of([[10.0, 53.0]])}</Point></Placemark>"


def test_the_one_area_of_a_kml_is_found_among_points_lines_and_holes(tmp_path):
    kml(tmp_path / "a.kml", f"{HOME}<Placemark><MultiGeometry>{LINE}{POLYGON}</MultiGeometry></Placemark>")
    geojson(tmp_path / "a.geojson", SQUARE)
    area = read_outline(tmp_path / "a.kml", "a.kml", "EPSG:25832", is_line=False)
    assert np.array_equal(area, read_outline(tmp_path / "a.geojson", "a", "EPSG:25832", is_line=False))
    line = read_outline(tmp_path / "a.kml", "a.kml", "EPSG:25832", is_line=True)
    assert len(line) == 2
    assert np.linalg.norm(line[1] - line[0]) == pytest.approx(671.0, abs=1.0)


def test_geojson_of_multipolygons_and_collections_is_read(tmp_path):
    collection = {"type": "GeometryCollection", "geometries": [
        {"type": "Point", "coordinates": [10.0, 53.0]}, {"type": "MultiPolygon", "coordinates": [[SQUARE]]},
    ]}  # fmt: skip
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "Feature", "geometry": collection}))
    assert len(read_outline(tmp_path / "a.geojson", "a", "EPSG:25832", is_line=False)) == 5


@pytest.mark.parametrize(
    ("corners", "crs", "said"),
    [
        (SQUARE, None, "seem to be longitude and latitude in degrees"),
        (SQUARE, "EPSG:25832", "seem to be longitude and latitude in degrees"),
        ([[5934111.0, 561958.0], [5934114.0, 562219.0], [5934219.0, 562217.0]], "EPSG:25832", "within it if exchanged"),
    ],
)
def test_corners_in_another_system_are_refused(corners, crs, said):
    with pytest.raises(InputError, match=said):
        refuse_other_system(np.array(corners), crs, "corners")


@pytest.mark.parametrize("crs", [None, "EPSG:25832"])
def test_corners_of_the_project_are_taken(crs):
    refuse_other_system(np.array([[561958.0, 5934111.0], [562219.0, 5934114.0], [562217.0, 5934219.0]]), crs, "corners")
    refuse_other_system(np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 20.0]]), None, "corners")


def test_files_with_several_areas_or_none_are_refused(tmp_path):
    kml(tmp_path / "two.kml", f"<MultiGeometry>{POLYGON}{POLYGON}</MultiGeometry>")
    kml(tmp_path / "none.kml", HOME)
    for name, said in (("two.kml", "it has 2 areas"), ("none.kml", "it has no area; draw one")):
        with pytest.raises(InputError, match=said):
            read_outline(tmp_path / name, name, "EPSG:25832", is_line=False)


def test_latitude_before_longitude_is_refused(tmp_path):
    geojson(tmp_path / "a.geojson", [[y, x] for x, y in SQUARE])
    with pytest.raises(InputError, match="longitude first"):
        read_outline(tmp_path / "a.geojson", "a.geojson", "EPSG:25832", is_line=False)


def test_an_area_round_the_pole_is_one_in_a_polar_system(tmp_path):
    geojson(tmp_path / "a.geojson", [[longitude, 89.99] for longitude in (0.0, 90.0, 180.0, -90.0)])
    found = read_outline(tmp_path / "a.geojson", "a.geojson", "EPSG:5041", is_line=False)
    # the pole is at 2 000 000, 2 000 000, where the scale is 0.994
    radius = np.linalg.norm(found - 2e6, axis=1)
    assert np.allclose(radius, 0.994 * 111.694e3 * 0.01, rtol=1e-4)
    assert len(checked_outline(found, "a", is_line=False)) == 4


def test_a_line_with_two_equal_points_is_refused():
    with pytest.raises(InputError, match="corner 3 is the same"):
        checked_outline(np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 0.0], [90.0, 9.0]]), "orip.toml", is_line=True)


def test_a_raster_of_heights_is_read_and_its_holes_are_named(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    heights = np.add.outer(np.arange(50.0)[::-1], 2.0 * np.arange(60.0))
    heights[10, 10] = -9999.0
    with rasterio.open(
        tmp_path / "dem.tif", "w", driver="GTiff", width=60, height=50, count=1, dtype="float64", nodata=-9999.0,
        transform=rasterio.Affine(1.0, 0.0, 1000.0, 0.0, -1.0, 2050.0),
    ) as target:  # fmt: skip
        target.write(heights, 1)
    terrain = terrain_of_raster(tmp_path / "dem.tif", "dem.tif", None)
    places = np.array([[1030.5, 2020.5], [1040.25, 2005.75]])
    assert np.allclose(terrain(places), 2.0 * (places[:, 0] - 1000.5) + places[:, 1] - 2000.5)
    for wrong in ([[1010.5, 2039.5]], [[900.0, 2020.0]]):
        with pytest.raises(InputError, match="no height"):
            terrain(np.array(wrong))


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:25832+7837"])
def test_a_raster_in_another_system_is_met_where_it_is(tmp_path, crs):
    rasterio = pytest.importorskip("rasterio")
    from pyproj import Transformer

    longitude, latitude = 9.99 + 1e-4 * (np.arange(300) + 0.5), 53.03 - 1e-4 * (np.arange(400) + 0.5)
    with rasterio.open(
        tmp_path / "dem.tif", "w", driver="GTiff", width=300, height=400, count=1, dtype="float64", crs="EPSG:4326",
        transform=rasterio.Affine(1e-4, 0.0, 9.99, 0.0, -1e-4, 53.03),
    ) as target:  # fmt: skip
        target.write(1000.0 * (longitude[None] - 10.0) + 500.0 * (latitude[:, None] - 53.0), 1)
    places = np.array(Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True).transform(*np.array(SQUARE).T)).T
    expected = [1000.0 * (x - 10.0) + 500.0 * (y - 53.0) for x, y in SQUARE]
    # heights are linear in longitude and latitude, which places in metres give to 1e-9 degrees
    assert np.allclose(terrain_of_raster(tmp_path / "dem.tif", "dem.tif", crs)(places), expected, atol=1e-4)
