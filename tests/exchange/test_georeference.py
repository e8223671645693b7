"""Where imports of OpenSfM, OpenDroneMap and Pix4D are on the ground: headings, own frames, offsets, angles."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pyproj
import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import block
from exchange.imported import read_well, written
from exchange.test_metric import pix4d_files
from exchange.test_opensfm import reconstruction_of, tracks_of

from orip.errors import InputError
from orip.exchange import pix4d
from orip.exchange.conversion.poses import exchanged_poses, orip_poses
from orip.exchange.opensfm.control_marks import crs_of_heading
from orip.exchange.opensfm.reconstruction import READING
from orip.exchange.opensfm.source import read_opensfm
from orip.exchange.project.block import ExchangeSettings, imported_block
from orip.files.project.reader import parse_project
from orip.geometry.rotation import rotation_from_angles
from orip.records.exchanged import ExchangedProject
from orip.structs import replace
from orip.workflow.project.bundle_state import read_bundle

ORIGIN = (610_000.0, 5_849_000.0, 70.0)
"""Of a block in zone 33; grid and ellipsoid differ by some millimetres over its 60 m."""

SCALE = 0.037
TURN = rotation_from_angles(np.array([0.4, -0.9, 2.0]))


@pytest.mark.parametrize(
    ("heading", "crs"),
    [
        ("EPSG:32633", "EPSG:32633"),
        ("epsg: 4326", "EPSG:4326"),
        ("+init=epsg:32633", "EPSG:32633"),
        ("EPSG:25832+7837", "EPSG:25832+7837"),
        ("WGS84 UTM 33N", "EPSG:32633"),
        ("WGS84 UTM zone 60G", "EPSG:32760"),
        ("WGS 84 / UTM zone 16N", "EPSG:32616"),
        ("WGS84 UTM 17 south", "EPSG:32717"),
        ("WGS84 UPS north", "EPSG:5041"),
        ("WGS84 UPS South pole", "EPSG:5042"),
        ("WGS84", "EPSG:4326"),
        ("WGS84 UTM 61N", None),
        ("610001.7 5849071.2 74.0 64.9 2677.8 a.jpg", None),
    ],
)
def test_headings_of_lists_name_a_system(heading: str, crs: str | None) -> None:
    assert crs_of_heading(heading) == crs


def test_a_zone_of_proj_with_a_letter_has_its_hemisphere() -> None:
    """PROJ reads no further than the digits: a place in New Zealand was taken to be in Alaska."""
    south = crs_of_heading("+proj=utm +zone=60G +datum=WGS84 +units=m +no_defs")
    assert south is not None
    there = pyproj.Transformer.from_crs(south, "EPSG:4326", always_xy=True).transform(500_000.0, 5_100_000.0)
    assert there[1] == pytest.approx(-44.25, abs=0.2)
    north = crs_of_heading("+proj=utm +zone=33U +datum=WGS84")
    assert north == "+proj=utm +zone=33 +datum=WGS84"


def in_own_frame(project: ExchangedProject) -> ExchangedProject:
    """Return a block turned, shifted and scaled, as a reconstruction without any observed position is."""
    rotations, centres = orip_poses(project.photos, READING)
    numbers, positions = exchanged_poses(TURN @ rotations, SCALE * centres @ TURN.T + [3.0, 1.0, -2.0], READING)
    photos = tuple(
        replace(photo, rotation=tuple(numbers[n].tolist()), position=tuple(positions[n].tolist()))
        for n, photo in enumerate(project.photos)
    )
    coordinates = SCALE * project.points.coordinates @ TURN.T + [3.0, 1.0, -2.0]
    return replace(project, photos=photos, points=replace(project.points, coordinates=coordinates))


def control_list(project: ExchangedProject, heading: str, wrong: int | None = None) -> str:
    """Return a list of six points that lie level around `ORIGIN`; one is 20 m off if that is wanted."""
    lines = [heading]
    to_geographic = pyproj.Transformer.from_crs("EPSG:32633", "EPSG:4326", always_xy=True)
    for ray, (photo, point) in enumerate(zip(project.rays.photo, project.rays.point, strict=True)):
        if point >= 6:
            continue
        x, y, z = project.points.coordinates[point] + ORIGIN
        x += 20.0 if point == wrong else 0.0
        if "UTM" not in heading:
            x, y = to_geographic.transform(x, y)
        if "latitude first" in heading:
            x, y = y, x
        column, row = project.rays.image[ray] - 0.5
        lines.append(f"{x:.9f} {y:.9f} {z:.4f} {column:.4f} {row:.4f} {photo}.jpg GCP{point}")
    return "\n".join(lines).replace(" latitude first", "") + "\n"


def folder_of(folder: Path, given: ExchangedProject, reference: tuple[float, float] | None, control: str) -> Path:
    document = reconstruction_of(given)
    for shot in document[1]["shots"].values():  # type: ignore[attr-defined]
        del shot["gps_position"], shot["gps_dop"]
    if reference is not None:
        document[1]["reference_lla"] = {"longitude": reference[0], "latitude": reference[1], "altitude": 70.0}
    written(folder / "reconstruction.json", json.dumps(document))
    written(folder / "tracks.csv", tracks_of(given, 2))
    written(folder / "gcp_list.txt", control)
    return folder


def test_marks_with_row_before_column_are_named(tmp_path: Path) -> None:
    heading, *rows = control_list(block(READING), "WGS84 UTM 33N").splitlines()
    fields = [row.split() for row in rows]
    exchanged = [" ".join([*row[:3], row[4], row[3], *row[5:]]) for row in fields]
    for control, said in ((rows, False), (exchanged, True)):
        folder = tmp_path / str(said)
        folder.mkdir()
        folder_of(folder, block(READING), None, "\n".join([heading, *control]) + "\n")
        done = orip(folder, "import", "opensfm", ".", "new").err
        assert (" measurements are 50 px off and more, in photo " in done) == said
        assert ("first: points GCP" in done and "the order of column and row" in done) == said


@pytest.mark.parametrize("reference", [None, (0.0, 0.0)])
def test_a_block_without_gnss_is_placed_by_its_control(tmp_path: Path, reference: tuple[float, float] | None) -> None:
    """It took five times as long, and was said to have exchanged columns and not to converge."""
    given = block(READING)
    folder = folder_of(tmp_path, in_own_frame(given), reference, control_list(given, "WGS84 UTM 33N"))
    done = orip(folder, "import", "opensfm", ".", "new")
    assert done.code == 0, done.err
    definition = parse_project((folder / "new" / "orip.toml").read_text(encoding="utf-8")).value.definition  # type: ignore[union-attr]
    assert definition.crs == "EPSG:32633"
    _, centres = orip_poses(given.photos, READING)
    placed = np.array([photo.orientation[:3] for photo in definition.photos], dtype=np.float64)
    assert placed == pytest.approx(centres + ORIGIN, abs=0.05)
    run = orip(folder / "new", "run", "--no-report")
    assert run.code == 0
    assert "exchange" not in run.err
    assert "did not converge" not in run.err
    solution = read_bundle(folder / "new", None, "heads", "solutions").adjusted
    assert solution.status == "converged"
    # the block is made as if the grid were true: scale 0.9997 and height are what control of 0.02 m has to bend
    assert np.abs(solution.photos.values[:, :3] - centres - ORIGIN).max() < 0.1


def test_a_wrong_control_point_does_not_place_a_block(tmp_path: Path) -> None:
    given = block(READING)
    folder = folder_of(tmp_path, in_own_frame(given), None, control_list(given, "WGS84 UTM 33N", wrong=2))
    imported = imported_block(read_well(read_opensfm, folder), "source", ExchangeSettings())
    assert any("Control point GCP2 does not fit the others" in note for note in imported.notes)
    _, centres = orip_poses(given.photos, READING)
    assert imported.found.centres == pytest.approx(centres + ORIGIN, abs=0.05)


def test_two_control_points_do_not_place_a_block(tmp_path: Path) -> None:
    given = block(READING)
    lines = control_list(given, "WGS84 UTM 33N").splitlines()
    few = [lines[0], *(line for line in lines[1:] if line.endswith(("GCP0", "GCP1")))]
    folder = folder_of(tmp_path, in_own_frame(given), None, "\n".join(few) + "\n")
    imported = imported_block(read_well(read_opensfm, folder), "source", ExchangeSettings())
    assert imported.datum is None
    assert imported.project.crs is None
    assert any("no three control points tell" in note for note in imported.notes)


def test_a_block_without_gnss_is_placed_by_longitudes_and_latitudes(tmp_path: Path) -> None:
    given = block(READING)
    folder = folder_of(tmp_path, in_own_frame(given), None, control_list(given, "WGS84"))
    imported = imported_block(read_well(read_opensfm, folder), "source", ExchangeSettings())
    assert imported.project.crs is None
    assert any("east, north and up, in metres, at longitude 16.6" in note for note in imported.notes)
    assert imported.datum is not None
    assert imported.datum.similarity.scale * SCALE == pytest.approx(1.0, abs=1e-3)


PLACE = pyproj.Transformer.from_crs("EPSG:32633", "EPSG:4326", always_xy=True).transform(*ORIGIN[:2])


def test_control_on_the_other_hemisphere_is_no_georeference(tmp_path: Path) -> None:
    """The block was moved by 9000 km and turned by 90 degrees, with exit 0."""
    given = block(READING)
    text = control_list(given, "WGS84 UTM 33N").replace("33N", "33S")
    folder = folder_of(tmp_path, given, PLACE, text)
    done = orip(folder, "import", "opensfm", ".", "new")
    assert done.code == 3
    assert "the header of gcp_list.txt and reference_lla name places" in done.err
    assert "hemisphere" in done.err
    assert done.err.count("error") == 1
    assert not (folder / "new").exists()


def test_latitudes_before_longitudes_are_seen(tmp_path: Path) -> None:
    given = block(READING)
    right = folder_of(tmp_path / "right", given, PLACE, control_list(given, "WGS84"))
    wrong = folder_of(tmp_path / "wrong", given, PLACE, control_list(given, "WGS84 latitude first"))
    found = [imported_block(read_well(read_opensfm, folder), "source", ExchangeSettings()) for folder in (right, wrong)]
    assert found[0].project.control == found[1].project.control
    assert any("latitude before their longitude" in note for note in found[1].notes)


def test_angles_of_geo_txt_are_attitudes(tmp_path: Path) -> None:
    """They were read over. A photo that looks down with its top to the east has yaw 90, and 0 in pitch and roll."""
    folder = folder_of(tmp_path, block(READING), PLACE, control_list(block(READING), "WGS84 UTM 33N"))
    written(folder / "geo.txt", "EPSG:32633\n0.jpg 610000 5849000 170 90 0 0 0.02 0.05\n1.jpg 610001 5849000 170\n")
    project = read_well(read_opensfm, folder)
    assert project.station_reference.navigation
    assert project.stations[0].angles == (0.0, 0.0, math.pi / 2.0)
    assert not project.stations[1].has_angles
    assert any("attitudes" in note for note in project.notes)
    written(folder / "geo.txt", "EPSG:32633\n0.jpg 610000 5849000 170 0 0 0\n1.jpg 610001 5849000 170 0 0 0\n")
    assert not any(station.has_angles for station in read_well(read_opensfm, folder).stations)


def test_a_report_of_old_has_a_camera_for_each_size_and_focal_length(tmp_path: Path) -> None:
    """Each of its photos was a complaint that there is no 'camera'."""
    shots = [
        {"filename": f"{n}.jpg", "focal": focal, "width": 4000, "height": 3000, "translation": [6e5, 5.8e6, 100.0 + n],
         "rotation": [3.1, 0.0, 0.1]}
        for n, focal in enumerate((0.85, 0.85, 0.7))
    ]  # fmt: skip
    features = [{"type": "Feature", "properties": shot} for shot in shots]
    source = written(tmp_path / "shots.geojson", json.dumps({"type": "FeatureCollection", "features": features}))
    project = read_well(read_opensfm, source)
    assert [photo.camera for photo in project.photos] == [0, 0, 1]
    assert [camera.parameters["fx"] for camera in project.cameras] == [3400.0, 2800.0]


def test_complaints_of_a_kind_are_one_line_with_a_count(tmp_path: Path) -> None:
    shots = [{"filename": f"{n}.jpg", "width": 4000, "height": 3000} for n in range(40)]
    document = {
        "features": [{"properties": shot | {"translation": [0, 0, 0], "rotation": [3, 0, 0]}} for shot in shots]
    }
    written(tmp_path / "shots.geojson", json.dumps(document))
    done = orip(tmp_path, "import", "shots.geojson", "new")
    assert done.code == 3
    assert "(39 more like this)" in done.err
    assert done.err.count("there is no 'focal'") == 1


def test_parameters_of_pix4d_without_its_name_and_offset(tmp_path: Path) -> None:
    """Without the project's name in front they were not found; without the offset X0 was -23.6, and nothing said so."""
    given = block(pix4d.READING)
    folder = pix4d_files(tmp_path / "params", given)
    expected = [photo.position for photo in read_well(pix4d.read_pix4d, folder).photos]
    names = [path for path in folder.rglob("*") if path.is_file()]
    offset = next(path for path in names if path.name.endswith("_offset.xyz"))
    for path in names:
        bare = path.name.split("_", 1)[1]
        path.rename(path.with_name(bare))
    assert [photo.position for photo in read_well(pix4d.read_pix4d, folder).photos] == expected
    table = "".join(
        f"{photo.name},{','.join(f'{value:.6f}' for value in position)}\n"
        for photo, position in zip(given.photos, expected, strict=True)
    )
    offset.with_name("offset.xyz").unlink()
    local = read_well(pix4d.read_pix4d, folder)
    assert any("coordinates are local" in note for note in local.notes)
    written(offset.with_name("calibrated_images_position.txt"), table)
    found = read_well(pix4d.read_pix4d, folder)
    assert np.array([photo.position for photo in found.photos]) == pytest.approx(np.array(expected), abs=1e-3)
    assert any("is that of the positions" in note for note in found.notes)


def test_positions_of_photos_in_another_hemisphere_are_refused(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, block(READING), PLACE, "EPSG:32633\n")
    (folder / "gcp_list.txt").unlink()
    written(folder / "geo.txt", "WGS84 UTM 33S\n0.jpg 610000 5849000 170\n1.jpg 610001 5849000 170\n")
    project = read_well(read_opensfm, folder)
    with pytest.raises(InputError, match="observed positions of the photos and reference_lla name places"):
        imported_block(project, "source", ExchangeSettings())
