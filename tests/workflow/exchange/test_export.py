"""Results of adjustments in the formats of other programs."""

from __future__ import annotations

import csv
import json
import shutil
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from exchange.colmap_samples import small_model, written

from orip.exchange.colmap.reader import read_folder, read_model
from orip.exchange.conversion.cameras import convert_camera
from orip.exchange.conversion.reprojection import fitting_reading
from orip.exchange.conversion.result_figures import error_ellipses
from orip.structs import replace
from orip.workflow.project.bundle_state import read_bundle


@pytest.fixture(scope="module")
def adjusted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small model with a large error in one measurement, imported and adjusted."""
    folder = tmp_path_factory.mktemp("export")
    model = small_model()
    first = model.images[0]
    keypoints = first.keypoints.copy()
    keypoints[5] += 40.0
    model = replace(model, images=(replace(first, keypoints=keypoints), *model.images[1:]))
    written(folder / "given", model, "bin")
    assert orip(folder, "import", "given", "project").code == 0
    (folder / "project" / "EDITS.MEA").write_text("DISREGARD POINT MAIN Bild_ä T6\n", encoding="utf-8")
    assert orip(folder / "project", "run", "--no-report").code == 0
    return folder


@pytest.fixture(scope="module")
def drone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block in a map projection, adjusted, with its results for GIS and CAD."""
    folder = tmp_path_factory.mktemp("drone")
    assert orip(folder, "init", "--sample", "drone_rtk", "drone").code == 0
    assert orip(folder / "drone", "run", "--no-report").code == 0
    for name in ("geopackage", "dxf", "csv", "geojson"):
        assert orip(folder / "drone", "export", name).code == 0
    return folder / "drone"


def test_the_result_is_written_into_a_copy_of_the_original(adjusted: Path) -> None:
    said = orip(adjusted / "project", "export", "--json")
    assert said.code == 0, said.err
    assert said.document["original"] == str(adjusted / "given")
    before, after = (
        read_folder(folder, "m").value for folder in (adjusted / "given", adjusted / "project" / "colmap_adjusted")
    )
    solution = read_bundle(adjusted / "project", None, "heads", "solutions").adjusted
    place = {name: n for n, name in enumerate(solution.points.names)}
    rows = [place[f"T{identity}"] for identity in after.points.ids.tolist()]
    assert np.array_equal(after.points.coordinates, solution.points.values[rows])
    assert np.array_equal(after.points.ids, before.points.ids)
    assert np.array_equal(after.points.colours, before.points.colours)
    assert [image.name for image in after.images] == [image.name for image in before.images]
    # what was disregarded is a keypoint without a point now
    assert before.images[0].points[5] == 6
    assert after.images[0].points[5] == -1
    assert np.array_equal(after.images[0].keypoints, before.images[0].keypoints)
    assert after.points.lengths.sum() == before.points.lengths.sum() - 1


def test_what_was_exported_fits_the_measurements_as_well_as_the_solution(adjusted: Path) -> None:
    assert orip(adjusted / "project", "export", "colmap", "again").code == 0
    project = read_model(adjusted / "project" / "again", "again").value
    assert project is not None
    camera = convert_camera(project.cameras[0], "K1")
    found, _ = fitting_reading(project, [camera], camera.pixels(project.rays.image))
    solution = read_bundle(adjusted / "project", None, "heads", "solutions").adjusted
    rows = [kind == "photo" and np.isfinite(weight) for kind, weight in
            zip(solution.residuals.kind, solution.residuals.weight_factor, strict=True)]  # fmt: skip
    in_pixels = solution.residuals.residual[rows] / (36.0 / 4000.0)
    assert found.rms == pytest.approx(np.sqrt(2.0 * np.mean(in_pixels**2)), rel=1e-9)
    assert project.stated is not None
    assert project.stated.value == pytest.approx(found.mean_of_points(project.rays.point), rel=1e-9)
    pycolmap = pytest.importorskip("pycolmap")
    opened = pycolmap.Reconstruction(str(adjusted / "project" / "again"))
    opened.update_point_3d_errors()
    assert opened.compute_mean_reprojection_error() == pytest.approx(project.stated.value, rel=1e-9)


def test_without_the_original_a_model_of_the_result_alone_is_written(adjusted: Path, tmp_path: Path) -> None:
    shutil.copytree(adjusted / "project", tmp_path / "project")
    text = (tmp_path / "project" / "exchange.toml").read_text().replace("given", "gone")
    (tmp_path / "project" / "exchange.toml").write_text(text)
    said = orip(tmp_path / "project", "export", "colmap", "new")
    assert said.code == 0, said.err
    assert "is not there; what is written has the result alone" in said.err
    project = read_model(tmp_path / "project" / "new", "new").value
    assert project is not None
    assert (len(project.photos), len(project.points.names), len(project.rays.photo)) == (6, 60, 359)
    assert project.photos[0].name == "left side/Bild ä.jpg"
    said = orip(tmp_path / "project", "export", "colmap", "copy", "--original", str(adjusted / "given"))
    assert "in a copy of" in said.err


def test_what_cannot_be_exported(adjusted: Path, tmp_path: Path) -> None:
    assert orip(adjusted, "import", "given", str(tmp_path / "fresh")).code == 0
    said = orip(tmp_path / "fresh", "export", "colmap")
    assert said.code == 3
    assert orip(tmp_path / "fresh", "run", "--no-report").code == 0
    for words, message in (
        (["pix4d"], "the format 'pix4d' is read, not written"),
        (["nothing"], "there is no format 'nothing'; known are: colmap, opensfm, metashape, blocks, micmac, bundler"),
        (["colmap", "."], "has something in it already"),
    ):
        said = orip(tmp_path / "fresh", "export", *words)
        assert (said.code, message in said.err) == (2, True), said.err
    assert "colmap " in orip(tmp_path, "export", "--list").out


def test_one_command_from_a_model_to_a_report(adjusted: Path, tmp_path: Path) -> None:
    said = orip(tmp_path, "adjust", str(adjusted / "given"), "new")
    assert said.code == 0, said.err
    made = {path.name for path in (tmp_path / "new").iterdir()}
    assert {"report.html", "result.json", "residuals.csv", "colmap_adjusted", "README.md"} <= made
    assert "up to date" in orip(tmp_path / "new", "status").out
    assert orip(tmp_path, "adjust", str(adjusted / "given"), "new").code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["new"]


def test_an_adjustment_that_fails_leaves_nothing_behind(tmp_path: Path) -> None:
    model = small_model()
    # one photo alone determines no point
    source = written(tmp_path / "given", replace(model, images=model.images[:1]), "bin")
    said = orip(tmp_path, "adjust", str(source), "new")
    assert said.code in {3, 4}
    assert [path.name for path in tmp_path.iterdir()] == ["given"]


def test_a_block_in_a_map_projection_is_exported_in_a_local_system(drone: Path) -> None:
    said = orip(drone, "export", "colmap", "out")
    assert said.code == 0, said.err
    assert "Coordinates are east, north and up at" in said.err
    project = read_model(drone / "out", "out").value
    assert project is not None
    cameras = [convert_camera(camera, f"K{n}") for n, camera in enumerate(project.cameras)]
    found, _ = fitting_reading(project, cameras, cameras[0].pixels(project.rays.image))
    solution = read_bundle(drone, None, "heads", "solutions").adjusted
    rows = [kind == "photo" for kind in solution.residuals.kind]
    sensor = cameras[0].source
    pixel = read_bundle(drone, None, "definitions").records.cameras.values()
    width = next(iter(pixel)).sensor.width / sensor.columns
    in_pixels = solution.residuals.residual[rows] / width
    # the adjustment is made in such a system; its origin is another one, and rounding is all that is left
    assert found.rms == pytest.approx(np.sqrt(2.0 * np.mean(in_pixels**2)), rel=1e-4)


def test_tables_have_all_digits(drone: Path) -> None:
    solution = read_bundle(drone, None, "heads", "solutions").adjusted
    with (drone / "csv_adjusted" / "points.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] for row in rows] == list(solution.points.names)
    assert [float(row["X"]) for row in rows] == solution.points.values[:, 0].tolist()
    assert [float(row["sZ"]) for row in rows] == pytest.approx(solution.points.sd[:, 2].tolist())


def test_the_layers_of_a_geopackage(drone: Path) -> None:
    solution = read_bundle(drone, None, "heads", "solutions").adjusted
    path = drone / "orip.gpkg"
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        layers = connection.execute("SELECT table_name, srs_id FROM gpkg_contents").fetchall()
        assert {system for _, system in layers} == {25832}
        geometry, name, deviation = connection.execute("SELECT geom, name, sX FROM points").fetchone()
        assert struct.unpack("<2sBBiBI", geometry[:13]) == (b"GP", 0, 1, 25832, 1, 1001)
        assert struct.unpack("<3d", geometry[13:]) == tuple(solution.points.values[0])
        assert (name, deviation) == (solution.points.names[0], pytest.approx(solution.points.sd[0, 0]))
        (ellipses,) = [layer for layer, _ in layers if layer.startswith("error_ellipses")]
        outline = connection.execute(f'SELECT geom FROM "{ellipses}" WHERE name = ?', [name]).fetchone()[0]
    corners = np.frombuffer(outline[21:], "<f8").reshape(-1, 2)
    factor = float(ellipses.removeprefix("error_ellipses_").removesuffix("x"))
    # the box round a standard error ellipse has the standard deviations as half its sides
    half = np.ptp(corners, axis=0) / 2.0
    assert half == pytest.approx(factor * solution.points.sd[0, :2], rel=0.01)


def test_gdal_opens_a_geopackage(drone: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    solution = read_bundle(drone, None, "heads", "solutions").adjusted
    path = drone / "orip.gpkg"
    kinds = dict(pyogrio.list_layers(path).tolist())
    (ellipses,) = [name for name in kinds if name.startswith("error_ellipses")]
    (vectors,) = [name for name in kinds if name.startswith("residual_vectors")]
    assert kinds == {
        "points": "Point Z", "photos": "Point Z", "footprints": "Polygon Z", "rays": "LineString Z",
        vectors: "LineString Z", ellipses: "Polygon",
    }  # fmt: skip
    for layer in kinds:
        assert pyogrio.read_info(path, layer=layer)["crs"] == "EPSG:25832"
    assert pyogrio.read_info(path, layer="photos")["features"] == len(solution.photos.names)
    assert pyogrio.read_info(path, layer="footprints")["features"] == len(solution.photos.names)
    _, _, geometry, columns = pyogrio.raw.read(path, layer="points", columns=["name", "sX"])
    assert columns[0].tolist() == list(solution.points.names)
    assert columns[1].tolist() == pytest.approx(solution.points.sd[:, 0].tolist())
    assert [struct.unpack("<3d", blob[5:]) for blob in geometry] == [tuple(row) for row in solution.points.values]


def test_footprints_overlap_as_the_flight_was_planned(drone: Path) -> None:
    """What a photo shows is a bit more than its points, and its projection centre is above it."""
    collection = json.loads((drone / "csv_adjusted").with_name("orip.geojson").read_text(encoding="utf-8"))
    of = {
        feature["properties"]["name"]: np.array(feature["geometry"]["coordinates"][0])
        for feature in collection["features"]
        if feature["properties"]["layer"] == "footprints"
    }
    photos = [one for one in collection["features"] if one["properties"]["layer"] == "photos"]
    assert len(of) == len(photos) > 0
    for photo in photos:
        ring = of[photo["properties"]["name"]]
        place = photo["geometry"]["coordinates"]
        assert (ring[:, :2].min(axis=0) < place[:2]).all()
        assert (ring[:, :2].max(axis=0) > place[:2]).all()
        assert place[2] > ring[0, 2]


def test_geojson_is_in_longitude_and_latitude(drone: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    solution = read_bundle(drone, None, "heads", "solutions").adjusted
    collection = json.loads((drone / "orip.geojson").read_text(encoding="utf-8"))
    assert collection["type"] == "FeatureCollection"
    assert "crs" not in collection  # RFC 7946, section 4
    points = [one for one in collection["features"] if one["properties"]["layer"] == "points"]
    there = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True)
    for n in (0, len(points) - 1):
        longitude, latitude, height = points[n]["geometry"]["coordinates"]
        x, y = there.transform(longitude, latitude)
        assert (x, y, height) == pytest.approx(tuple(solution.points.values[n]), abs=1e-4)
        assert points[n]["properties"]["name"] == solution.points.names[n]
        assert points[n]["properties"]["X"] == solution.points.values[n, 0]
        assert points[n]["properties"]["sX"] == pytest.approx(solution.points.sd[n, 0])
    kinds = {point["properties"]["kind"] for point in points}
    assert "tie" in kinds
    for feature in collection["features"]:
        if feature["geometry"]["type"] == "Polygon":
            (ring,) = feature["geometry"]["coordinates"]
            assert ring[0] == ring[-1]
            x, y = np.array(ring)[:, :2].T
            assert np.sum((x[:-1] - x[0]) * (y[1:] - y[0]) - (x[1:] - x[0]) * (y[:-1] - y[0])) > 0.0
    pyogrio = pytest.importorskip("pyogrio")
    assert pyogrio.read_info(drone / "orip.geojson")["features"] == len(collection["features"])


def test_a_format_that_is_written_new_does_not_claim_to_be_a_copy(adjusted: Path, tmp_path: Path) -> None:
    assert orip(adjusted / "project", "export", "nvm", str(tmp_path / "a.nvm"), "--exact-distortion").code == 0
    assert orip(tmp_path, "import", "nvm", "a.nvm", "new", "--frame", "4000x3000").code == 0
    assert orip(tmp_path / "new", "run", "--no-report").code == 0
    said = orip(tmp_path / "new", "export")
    assert said.code == 0, said.err
    assert "what is written has the result alone" in said.err
    assert "in a copy of" not in said.err


def test_geojson_without_a_system_says_so(adjusted: Path) -> None:
    said = orip(adjusted / "project", "export", "geojson")
    assert said.code == 0, said.err
    assert "has no crs: coordinates are its own" in said.err
    collection = json.loads((adjusted / "project" / "orip.geojson").read_text(encoding="utf-8"))
    assert "not longitude and latitude" in collection["coordinates"]
    solution = read_bundle(adjusted / "project", None, "heads", "solutions").adjusted
    assert collection["features"][0]["geometry"]["coordinates"] == pytest.approx(solution.points.values[0], abs=1e-9)


@pytest.mark.parametrize(("name", "place"), [("bundler", "bundle.out"), ("bal", ""), ("nvm", ""), ("bingo", ".")])
def test_what_is_exported_to_other_formats_is_imported_with_the_same_residuals(
    adjusted: Path, tmp_path: Path, name: str, place: str
) -> None:
    out = tmp_path / name
    said = orip(adjusted / "project", "export", name, str(out), "--exact-distortion")
    assert said.code == 0, said.err
    said = orip(tmp_path, "import", name, str(out / place if place else out), "again", "--frame", "4000x3000", "--json")
    assert said.code == 0, said.err
    solution = read_bundle(adjusted / "project", None, "heads", "solutions").adjusted
    rows = [kind == "photo" and np.isfinite(weight) for kind, weight in
            zip(solution.residuals.kind, solution.residuals.weight_factor, strict=True)]  # fmt: skip
    in_pixels = solution.residuals.residual[rows] / (36.0 / 4000.0)
    expected = np.sqrt(2.0 * np.mean(in_pixels**2))
    # BINGO's files have millimetres, whose pixels the reader assumes to be 0.01 mm
    unit = 0.01 / (36.0 / 4000.0) if name == "bingo" else 1.0
    assert said.document["reprojection_rms"] * unit == pytest.approx(expected, rel=1e-3)


def test_the_entities_of_a_drawing(drone: Path) -> None:
    solution = read_bundle(drone, None, "heads", "solutions").adjusted
    path = drone / "orip.dxf"
    lines = path.read_text(encoding="ascii").splitlines()
    pairs = list(zip(map(int, lines[::2]), lines[1::2], strict=True))
    kinds = [value for code, value in pairs if code == 0]
    assert kinds[0] == "SECTION"
    assert kinds[-1] == "EOF"
    assert kinds.count("SECTION") == kinds.count("ENDSEC") == 2
    assert kinds.count("POINT") == len(solution.points.names) + len(solution.photos.names)
    assert kinds.count("POLYLINE") == kinds.count("SEQEND")
    assert (10, repr(float(solution.points.values[0, 0]))) in pairs
    assert (1, solution.points.names[0]) in pairs


def test_ezdxf_opens_a_drawing(drone: Path) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    solution = read_bundle(drone, None, "heads", "solutions").adjusted
    drawing = ezdxf.readfile(drone / "orip.dxf")
    assert not drawing.audit().has_errors
    space = drawing.modelspace()
    assert len(space.query("POINT")) == len(solution.points.names) + len(solution.photos.names)
    assert len(space.query('POLYLINE[layer=="FOOTPRINTS"]')) == len(solution.photos.names)
    first = space.query('POINT[layer=="POINTS"]')[0]
    assert tuple(first.dxf.location) == tuple(solution.points.values[0])
    line = space.query('LINE[layer=="RAYS"]')[0]
    centres = {tuple(row) for row in solution.photos.values[:, :3].tolist()}
    assert tuple(line.dxf.start) in centres
    assert {layer.dxf.name for layer in drawing.layers} >= {"POINTS", "PHOTOS", "FOOTPRINTS", "RAYS"}


def test_error_ellipses_are_the_eigenvectors_of_covariances() -> None:
    random = np.random.default_rng(4)
    factor = random.normal(size=(20, 3, 3))
    covariance = factor @ np.swapaxes(factor, 1, 2)
    found = error_ellipses(covariance)
    values, vectors = np.linalg.eigh(covariance[:, :2, :2])
    assert np.allclose(found[:, :2] ** 2, values[:, ::-1])
    along = np.column_stack([np.cos(found[:, 2]), np.sin(found[:, 2])])
    assert np.allclose(np.abs(np.sum(along * vectors[:, :, 1], axis=1)), 1.0)


def test_control_goes_where_the_points_go(drone: Path) -> None:
    """A block in a map projection is written east, north and up of a place, and its control too."""
    assert orip(drone, "export", "metashape").code == 0
    for name in ("reference_markers.csv", "reference_cameras.csv"):
        with (drone / "metashape_adjusted" / name).open(encoding="utf-8") as stream:
            rows = [row for row in csv.DictReader(stream) if row["X/East"]]
        assert rows
        given = np.array([[float(row[key]) for key in ("X/East", "Y/North", "Z/Altitude")] for row in rows])
        found = np.array([[float(row[f"{axis}_est"]) for axis in "XYZ"] for row in rows])
        # a position of the sample has a blunder of a metre; coordinates of the map are millions of metres
        assert np.abs(given - found).max() < 2.0
        assert np.median(np.abs(given - found)) < 0.05
        assert np.abs(given).max() < 1e4


@pytest.mark.parametrize("words", ["photo rename Bild_ä OTHER", "photo delete Bild_ä --with-referents --yes"])
@pytest.mark.parametrize("form", ["csv", "dxf", "colmap", "bundler"])
def test_an_adjustment_with_a_photo_that_is_gone_is_not_exported(
    adjusted: Path, tmp_path: Path, words: str, form: str
) -> None:
    project = Path(shutil.copytree(adjusted / "project", tmp_path / "project"))
    assert orip(project, *words.split()).code == 0
    said = orip(project, "export", form, "written")
    assert said.code == 3
    assert "photo Bild_ä, which the project does not have any more" in said.err
    assert "'orip solve'" in said.err
    assert not (project / "written").exists()
