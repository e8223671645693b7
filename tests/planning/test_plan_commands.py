"""The commands of `orip plan`, from orip.toml to files for pilots."""

from __future__ import annotations

import csv
import io
import json
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from cli.command_line import orip
from planning.planned_projects import document, project, stations, text_of, written


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    made = project(tmp_path_factory.mktemp("plan") / "p")
    assert orip(made, "plan", "make").code == 0
    return made


def test_the_plan_is_a_text_that_can_be_edited(tmp_path):
    made = project(tmp_path / "p")
    assert orip(made, "plan", "make", "--dry-run").code == 0
    assert not (made / "PLANNED.PLAN").exists()
    found = document(made, "plan", "make")
    planned = stations(made)
    assert len(planned) == found["photos"]
    assert found["height"] == pytest.approx(0.02 / (13.2 / 5472) * 8.8)
    assert {one.position[2] for one in planned} == {round(30.0 + found["height"], 4)}
    lines = (made / "PLANNED.PLAN").read_text(encoding="utf-8").splitlines(keepends=True)
    (made / "PLANNED.PLAN").write_text("".join(lines[:-1]), encoding="utf-8")
    refused = orip(made, "plan", "make")
    assert refused.code != 0
    assert "--force" in refused.err
    assert orip(made, "plan", "make", "--force").code == 0
    assert len(stations(made)) == found["photos"]


def test_forecast_compare_and_place(folder):
    found = document(folder, "plan", "forecast")
    assert max(found["point_sd_median"][:2]) < found["point_sd_median"][2] < 0.1
    assert found["point_sd_largest"][2] > found["point_sd_median"][2]
    assert "C" in found["camera_sd"]
    variants = document(folder, "plan", "compare", "--variant", "unknown=none", "--variant", "rtk=none control=5")[
        "variants"
    ]
    assert [one["variant"] for one in variants] == ["as planned", "unknown=none", "rtk=none control=5"]
    assert variants[1]["camera_sd"] == {}
    assert variants[1]["point_sd_median"][2] < variants[0]["point_sd_median"][2]
    placed = document(folder, "plan", "place", "4")
    assert len(placed["points"]) == 4
    printed = orip(folder, "plan", "place", "4").out
    (folder / "PLANNED.PNT").write_text(printed, encoding="utf-8")
    with_control = document(folder, "plan", "forecast")
    assert with_control["point_sd_median"][2] < found["point_sd_median"][2]
    (folder / "PLANNED.PNT").unlink()


def test_the_page_shows_the_plan_and_loads_nothing(folder):
    name = document(folder, "plan", "show")["file"]
    text = (folder / name).read_text(encoding="utf-8")
    page = ET.fromstring(text.partition("<body>")[2].partition("</body>")[0])
    drawings = [one for one in page.iter() if one.tag == "svg" and "drawing" in one.get("class", "")]
    assert len(drawings) == 7
    assert all([one for one in drawn.iter() if one.tag == "circle"] for drawn in drawings[2:6])
    photos = [one for one in drawings[0].iter() if one.get("class") == "plan-photo"]
    assert len(photos) == len(stations(folder))
    assert len([one for one in drawings[0].iter() if one.get("class") == "plan-border"]) == 1
    assert [one for one in drawings[1].iter() if one.get("class") == "overlap"]
    assert len([one for one in page.iter() if one.get("class") == "swatch"]) == 9
    assert "default-src 'none'" in text
    assert "<script" not in text
    assert "http://" not in text.replace("http://www.w3.org", "")


def test_the_export_says_what_heights_are_above(folder):
    found = document(folder, "plan", "export", "litchi", "said.csv", "--force")
    assert found["heights"] == "above the ground of the plan"


@pytest.mark.parametrize("name", ["PLANNED.PLAN", "planned.plan", "orip.toml"])
def test_no_output_replaces_the_plan_or_the_project(folder, name):
    before = (folder / "PLANNED.PLAN").read_bytes(), (folder / "orip.toml").read_bytes()
    refused = orip(folder, "plan", "export", "csv", name, "--force")
    assert refused.code != 0
    assert before == ((folder / "PLANNED.PLAN").read_bytes(), (folder / "orip.toml").read_bytes())


def truth(folder: Path):
    from pyproj import Transformer

    places = np.array([one.position for one in stations(folder)])
    longitude, latitude = Transformer.from_crs("EPSG:25832", "EPSG:4326", always_xy=True).transform(*places[:, :2].T)
    return places, longitude, latitude


def test_geojson_and_kml_and_gpx_have_the_places(folder):
    places, longitude, latitude = truth(folder)
    features = json.loads(written(folder, "geojson", "f.geojson"))["features"]
    points = np.array([one["geometry"]["coordinates"] for one in features[:-1]])
    assert np.allclose(points[:, 0], longitude, atol=1e-8)
    assert np.allclose(points[:, 1], latitude, atol=1e-8)
    assert np.allclose(points[:, 2], places[:, 2], atol=1e-3)
    for data in (
        written(folder, "kml", "f.kml"),
        zipfile.ZipFile(io.BytesIO(written(folder, "kmz", "f.kmz"))).read("doc.kml"),
    ):
        rows = text_of(ET.fromstring(data), "coordinates")[:-1]
        found = np.array([[float(part) for part in row.split(",")] for row in rows])
        assert np.allclose(found[:, 0], longitude, atol=1e-8)
        assert np.allclose(found[:, 2], places[:, 2] - 30.0, atol=1e-3)
        assert set(text_of(ET.fromstring(data), "altitudeMode")) == {"relativeToGround"}
    gpx = ET.fromstring(written(folder, "gpx", "f.gpx"))
    route = [one for one in gpx.iter() if one.tag.endswith("rtept")]
    assert np.allclose([float(one.get("lat", "0")) for one in route], latitude, atol=1e-8)
    assert "ellipsoid" in text_of(gpx, "desc")[0]


def test_files_for_pilots_have_the_places_and_take_a_photo_at_each(folder):
    places, longitude, latitude = truth(folder)
    count, above = len(places), places[:, 2] - 30.0
    plan = json.loads(written(folder, "qgc", "f.plan"))
    assert plan["fileType"] == "Plan"
    items = plan["mission"]["items"]
    points = np.array([one["params"] for one in items if one["command"] == 16], dtype=float)
    assert np.allclose(points[:, 5], longitude, atol=1e-8)
    assert np.allclose(points[:, 4], latitude, atol=1e-8)
    assert np.allclose(points[:, 6], above, atol=1e-3)
    assert sum(one["command"] == 203 for one in items) == count
    archive = zipfile.ZipFile(io.BytesIO(written(folder, "dji", "dji.kmz")))
    assert set(archive.namelist()) == {"wpmz/template.kml", "wpmz/waylines.wpml"}
    lines = ET.fromstring(archive.read("wpmz/waylines.wpml"))
    assert text_of(lines, "executeHeightMode") == ["WGS84"]
    assert np.allclose([float(one) for one in text_of(lines, "executeHeight")], places[:, 2], atol=1e-3)
    assert text_of(lines, "actionActuatorFunc").count("takePhoto") == count
    assert set(text_of(lines, "gimbalPitchRotateAngle")) == {"-90.00"}
    rows = list(csv.DictReader(io.StringIO(written(folder, "litchi", "l.csv").decode())))
    assert np.allclose([float(row["latitude"]) for row in rows], latitude, atol=1e-8)
    assert np.allclose([float(row["altitude(m)"]) for row in rows], above, atol=1e-3)
    # strips run east and west: to the east and back, as far as grid north is true north
    headings = {round(float(row["heading(deg)"]) / 90.0) % 4 for row in rows}
    assert headings == {1, 3}
    table = list(csv.DictReader(io.StringIO(written(folder, "csv", "t.csv").decode())))
    assert np.allclose([float(row["X"]) for row in table], places[:, 0])


def test_without_a_crs_formats_of_longitudes_are_refused(tmp_path):
    made = project(tmp_path / "p")
    text = (made / "orip.toml").read_text().replace(', crs = "EPSG:25832"', "")
    (made / "orip.toml").write_text(text)
    assert orip(made, "plan", "make").code == 0
    refused = orip(made, "plan", "export", "kml", "f.kml")
    assert refused.code != 0
    assert "crs" in refused.err
    assert "coordinates" in json.loads(written(made, "geojson", "f.geojson"))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"forward": "99.9"}, "forward"),
        ({"side": "-1.0"}, "side"),
        ({"pixel": ""}, "one of pixel"),
        ({"height": "80.0"}, "one of pixel"),
        ({"interval": "600.0"}, "not fast enough"),
        ({"corners": "[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]"}, "cross"),
        ({"corners": ""}, "area"),
        ({"area": '"none.geojson"', "corners": ""}, "no such file"),
        ({"camera": '"OTHER"'}, "OTHER"),
        ({"terrain": '"control"'}, "three points"),
    ],
)
def test_settings_that_cannot_be_get_one_clear_message(tmp_path, changed, said):
    found = orip(project(tmp_path / "p", **changed), "plan", "make")
    assert found.code != 0
    assert said in found.err
    assert "Traceback" not in found.err


def test_a_pixel_of_centimetres_is_a_warning(tmp_path):
    said = orip(project(tmp_path / "p", pixel="2.0"), "plan", "make", "--dry-run").err
    assert "warning: [plan] in orip.toml: pixel = 2 is 2 m on the ground" in said
    assert "write pixel = 0.02" in said
    assert "warning" not in orip(project(tmp_path / "q", pixel="0.02"), "plan", "make", "--dry-run").err


def test_no_overlap_at_all_is_a_plan(tmp_path):
    made = project(tmp_path / "p", forward="0.0", side="0.0")
    assert document(made, "plan", "make")["base"] == pytest.approx(0.02 * 3648, rel=1e-9)


def test_rings_are_planned_and_forecast(tmp_path):
    made = project(
        tmp_path / "p", kind='"rings"', size="[1.0, 1.0, 0.6]", elevations="[10.0, 50.0]", stations="6", pixel="",
        position_error="",
    )  # fmt: skip
    text = (made / "orip.toml").read_text().replace(', crs = "EPSG:25832"', "") + 'datum = "free"\n'
    (made / "orip.toml").write_text(text)
    assert document(made, "plan", "make")["photos"] == 24
    found = document(made, "plan", "forecast")
    assert found["camera_sd"]["C"] is not None
