"""`orip restitute` from measurements to drawings, which other programs read back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from restitution.strip_features import PLACES, restituted_project


@pytest.fixture(scope="module")
def restituted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = restituted_project(tmp_path_factory.mktemp("strips") / "project")
    done = orip(folder, "restitute", "compute", "STEREO.STE", "--snap", "0.1")
    assert done.code == 0, done.err
    return folder


def document(folder: Path, *words: str) -> dict:
    done = orip(folder, "restitute", *words, "--json")
    assert done.code == 0, done.err
    return done.document


def test_places_are_found_and_a_vertex_snaps(restituted):
    found = document(restituted, "compute", "STEREO.STE", "--snap", "0.1")
    assert found["snapped"] == 1
    assert [f"{one['kind']} {one['code']} {one['name']}" for one in found["features"]] == list(PLACES)
    assert found["warnings"] == []
    shown = {one["code"]: one for one in document(restituted, "show")["features"]}
    assert shown["HOUSE"]["area"] == pytest.approx(48.0, abs=0.01)
    assert shown["HOUSE"]["length"] == pytest.approx(28.0, abs=0.01)
    assert 0.0 < shown["TREE"]["largest_sd"][2] < 0.2


def test_the_same_measurements_again_give_the_same_file(restituted):
    before = (restituted / "STRIPS.GEO").read_bytes()
    assert orip(restituted, "restitute", "compute", "STEREO.STE", "--snap", "0.1").code == 0
    assert (restituted / "STRIPS.GEO").read_bytes() == before


def test_gdal_reads_geopackage_and_geojson(restituted):
    pyogrio = pytest.importorskip("pyogrio")
    for form, name in (("geopackage", "map.gpkg"), ("geojson", "map.geojson")):
        assert document(restituted, "export", form, name)["features"] == len(PLACES)
    kinds = dict(pyogrio.list_layers(restituted / "map.gpkg").tolist())
    assert kinds == {"points": "Point Z", "lines": "LineString Z", "areas": "Polygon Z"}
    _, _, _, (codes, names, sd) = pyogrio.raw.read(restituted / "map.gpkg", "lines", columns=["code", "name", "sZ"])
    assert codes.tolist() == ["ROAD", "PATH"]
    assert names.tolist() == ["1", "1"]
    assert (sd > 0.0).all()
    info = pyogrio.read_info(restituted / "map.geojson")
    assert info["features"] == len(PLACES)
    found = json.loads((restituted / "map.geojson").read_text(encoding="utf-8"))
    tree = next(one for one in found["features"] if one["properties"]["code"] == "TREE")
    assert np.allclose(tree["geometry"]["coordinates"], PLACES["POINT TREE A"][0][2], atol=0.01)


def test_ezdxf_reads_the_drawing(restituted):
    ezdxf = pytest.importorskip("ezdxf")
    assert orip(restituted, "restitute", "export", "dxf", "map.dxf").code == 0
    space = ezdxf.readfile(restituted / "map.dxf").modelspace()
    (house,) = space.query('POLYLINE[layer=="HOUSE"]')
    assert house.is_closed
    assert house.is_3d_polyline
    assert np.allclose(
        [tuple(place) for place in house.points()], [xyz for *_, xyz in PLACES["AREA HOUSE 7"]], atol=0.01
    )
    (tree,) = space.query('TEXT[layer=="TREE"]')
    assert tree.dxf.text == "A"
    assert len(space.query("POLYLINE")) == 3


def test_what_cannot_be_computed_is_said_all_at_once_and_nothing_is_written(restituted):
    before = (restituted / "STRIPS.GEO").read_bytes()
    text = "POINT T 1\n  P1 1 2 P9 3 4\nPOINT T 2\n  P8 1 2 P2 3 4\n"
    (restituted / "WRONG.STE").write_text(text, encoding="utf-8")
    done = orip(restituted, "restitute", "compute", "WRONG.STE")
    assert done.code == 3
    assert "WRONG.STE:2" in done.err
    assert "WRONG.STE:4" in done.err
    assert "photo P9 is not in the adjustment" in done.err
    (restituted / "WRONG.STE").write_text("POINT T 1\n  P1 5 0 P2 -15 0\n  P1 -15 0 P2 5 0\n", encoding="utf-8")
    done = orip(restituted, "restitute", "compute", "WRONG.STE")
    assert "its two rays do not meet" in done.err
    assert (restituted / "STRIPS.GEO").read_bytes() == before


def test_rays_that_pass_by_each_other_are_warned_of(restituted):
    (restituted / "OFF.STE").write_text("POINT OFF 1\n  P1 10 0 P2 -5 1\n", encoding="utf-8")
    done = orip(restituted, "restitute", "compute", "OFF.STE")
    assert done.code == 0
    assert "point OFF 1" in done.err
    assert "standard deviations; measure again" in " ".join(done.err.split())


def test_an_unknown_format_and_nothing_to_draw_are_refused(restituted):
    assert "write one of geojson, geopackage, dxf" in orip(restituted, "restitute", "export", "shp", "a.shp").err
    assert "there are no such features" in orip(restituted, "restitute", "export", "dxf", "a.dxf", "--code", "X").err
