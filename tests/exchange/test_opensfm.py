"""OpenSfM and OpenDroneMap: reconstruction, tracks of all versions, ground control, places of photos."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import PINHOLE, block
from exchange.imported import read_well, reprojected, sample, written

from orip.exchange.conversion.poses import orip_poses
from orip.exchange.opensfm.control_marks import crs_of_heading, read_control_list
from orip.exchange.opensfm.reconstruction import READING
from orip.exchange.opensfm.source import read_opensfm
from orip.exchange.sources.collected import PhotoNames
from orip.exchange.sources.text import Faults
from orip.records.exchanged import ExchangedProject
from orip.workflow.project.bundle_state import read_bundle

HEADS = {0: [], 1: ["OPENSFM_TRACKS_VERSION_v1"], 2: ["OPENSFM_TRACKS_VERSION_v2"]}


def reconstruction_of(project: ExchangedProject) -> list[dict[str, object]]:
    camera = project.cameras[0]
    longer = max(camera.columns, camera.rows)
    brown = {
        "projection_type": "brown", "width": camera.columns, "height": camera.rows,
        "focal_x": camera.parameters["fx"] / longer, "focal_y": camera.parameters["fy"] / longer,
        "c_x": (camera.parameters["cx"] - camera.columns / 2) / longer,
        "c_y": (camera.parameters["cy"] - camera.rows / 2) / longer,
    }  # fmt: skip
    shots = {
        photo.name: {
            "rotation": list(photo.rotation), "translation": list(photo.position), "camera": "cam",
            "gps_position": [1.0, 2.0, 3.0], "gps_dop": 4.0,
        }
        for photo in project.photos
    }  # fmt: skip
    points = {
        name: {"coordinates": list(xyz), "color": [1.0, 2.0, 3.0]}
        for name, xyz in zip(project.points.names, project.points.coordinates.tolist(), strict=True)
    }
    smaller = {"cameras": {}, "shots": {}, "points": {}}
    largest = {"cameras": {"cam": brown}, "shots": shots, "points": points}
    return [smaller, largest]


def tracks_of(project: ExchangedProject, version: int) -> str:
    rows = list(HEADS[version])
    for feature, (photo, point, (x, y)) in enumerate(
        zip(project.rays.photo, project.rays.point, project.rays.image.tolist(), strict=True)
    ):
        place = [repr((x - 2000.0) / 4000.0), repr((y - 1500.0) / 4000.0)]
        fields = [project.photos[photo].name, project.points.names[point], str(feature), *place]
        colour = ["1", "2", "3"]
        rows.append("\t".join(fields + {0: colour, 1: ["0.001", *colour], 2: ["0.001", *colour, "-1", "-1"]}[version]))
    return "\n".join([*rows, rows[-1].replace(rows[-1].split("\t")[1], "90000", 1)]) + "\n"


def project_folder(folder: Path, version: int = 2) -> Path:
    project = block(READING)
    written(folder / "reconstruction.json", json.dumps(reconstruction_of(project)))
    written(folder / "tracks.csv", tracks_of(project, version))
    return folder


@pytest.mark.parametrize("version", [0, 1, 2])
def test_a_block_is_read_as_it_was_written(tmp_path: Path, version: int) -> None:
    given = block(READING)
    project = read_well(read_opensfm, project_folder(tmp_path, version))
    assert [photo.name for photo in project.photos] == [photo.name for photo in given.photos]
    assert np.allclose(project.rays.image, given.rays.image, rtol=0.0, atol=1e-9)
    assert project.cameras[0].parameters["cx"] == pytest.approx(PINHOLE.parameters["cx"], abs=1e-9)
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6
    assert project.stations[0].position_error == (4.0, 4.0, 4.0)
    assert any("1 feature " in note for note in project.notes)
    assert any("Of 2 reconstructions" in note for note in project.notes)


def test_marks_of_equal_coordinates_are_those_of_one_point() -> None:
    faults = Faults("gcp_list.txt")
    control = read_control_list(sample("odm", "copr", "gcp_list.txt"), faults)
    assert not faults.complaints
    assert control.crs.startswith("+proj=utm +zone=11")
    assert len(control.marks) == 27
    assert control.marks[0].label == "gcp02"


def test_lists_without_rows_are_said(tmp_path: Path) -> None:
    folder = project_folder(tmp_path)
    for name in ("gcp_list.txt", "geo.txt"):
        written(folder / name, "WGS84 UTM 33N\n")
    notes = read_well(read_opensfm, folder).notes
    assert "gcp_list.txt has a heading alone: no control was read." in notes
    assert "geo.txt has a heading alone: no position was read." in notes


def test_control_of_a_list_and_places_of_photos(tmp_path: Path) -> None:
    folder = project_folder(tmp_path)
    written(
        folder / "gcp_list.txt",
        "WGS84 UTM 33N\n10 20 30 99.5 199.5 0.jpg A\n10 20 30 5 6 1.jpg A\n11 20 NaN 7 8 0.jpg A\n"
        "11 21 3 7 8 absent.jpg\n",
    )
    written(folder / "geo.txt", "EPSG:25833\n0.jpg 1 2 3\n1.jpg 1 2 3 nan nan nan 0.02 0.05\nother.jpg 1 2 3\n")
    project = read_well(read_opensfm, folder)
    assert project.control_crs == "EPSG:32633"
    assert {(point.name, point.coordinates) for point in project.control} == {
        ("GCP1", (10.0, 20.0, 30.0)),
        ("GCP2", (11.0, 20.0, None)),
        ("GCP3", (11.0, 21.0, 3.0)),
    }
    own = ~project.points.is_track[project.rays.point]
    # the list counts from the centre of the first pixel
    assert project.rays.image[own].tolist() == [[100.0, 200.0], [5.5, 6.5], [7.5, 8.5]]
    assert project.station_reference.crs == "EPSG:25833"
    assert [station.position_error for station in project.stations] == [(10.0, 10.0, 10.0), (0.02, 0.02, 0.05)]


def test_opendronemap_keeps_the_adjusted_reconstruction_apart(tmp_path: Path) -> None:
    project_folder(tmp_path / "opensfm")
    text = (tmp_path / "opensfm" / "reconstruction.json").read_text()
    written(tmp_path / "opensfm" / "reconstruction.json", "[]")
    written(tmp_path / "opensfm" / "reconstruction.topocentric.json", text)
    assert len(read_well(read_opensfm, tmp_path).photos) == len(block(READING).photos)


@pytest.mark.parametrize(
    ("heading", "crs"),
    [
        ("EPSG:25833", "EPSG:25833"),
        ("WGS84 UTM 16S", "EPSG:32716"),
        ("WGS84", "EPSG:4326"),
        ("+proj=utm +zone=11 +ellps=WGS84\t", "+proj=utm +zone=11 +ellps=WGS84"),
        ("WGS84 UTM 61N", None),
        ("x y z", None),
    ],
)
def test_the_first_line_of_a_list_names_the_system(heading: str, crs: str | None) -> None:
    assert crs_of_heading(heading) == crs


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ('"focal_x": 0.75', '"focal_x": NaN', 1, "not a finite number"),
        ('"camera": "cam"', '"camera": "dog"', 1, "there is no camera 'dog'"),
        ('"rotation": [', '"rotation": [1, ', 1, "3 finite numbers should be here"),
        ('[{"cameras"', '[{"cameras\n"', 1, "this is not JSON"),
    ],
)
def test_faults_of_a_reconstruction_name_their_place(tmp_path: Path, old: str, new: str, line: int, said: str) -> None:
    path = project_folder(tmp_path) / "reconstruction.json"
    assert old in path.read_text()
    written(path, path.read_text().replace(old, new, 1))
    parsed = read_opensfm(tmp_path, "berlin")
    assert parsed.value is None
    assert said in parsed.complaints[0].message
    assert (parsed.complaints[0].path, parsed.complaints[0].line) == ("berlin/reconstruction.json", line)


def test_all_faulty_lines_of_tracks_are_told(tmp_path: Path) -> None:
    path = project_folder(tmp_path) / "tracks.csv"
    lines = path.read_text().splitlines()
    lines[3] = lines[3].replace("\t", " ")
    lines[5] = lines[5].replace("0.001", "0.001\t7")
    lines[7] = "\t".join([*lines[7].split("\t")[:3], "1e99", *lines[7].split("\t")[4:]])
    written(path, "\n".join(lines))
    parsed = read_opensfm(tmp_path, str(tmp_path))
    assert [complaint.line for complaint in parsed.complaints] == [4, 6, 8]


def test_whole_numbers_of_any_size_are_told(tmp_path: Path) -> None:
    path = project_folder(tmp_path) / "reconstruction.json"
    document = json.loads(path.read_text())
    document[1]["points"]["3"]["coordinates"] = [1, 10**400, 3]
    written(path, json.dumps(document))
    complaint = read_opensfm(tmp_path, "berlin").complaints[0]
    assert "points/3/coordinates: 3 finite numbers should be here" in complaint.message


def shots_of(project: ExchangedProject, centres: np.ndarray) -> dict[str, object]:
    features = [
        {
            "type": "Feature",
            "properties": {
                "filename": photo.name, "camera": "v2 c", "focal": 0.75, "width": 4000, "height": 3000,
                "translation": centre, "rotation": list(photo.rotation),
            },
            "geometry": {"type": "Point", "coordinates": [13.4, 52.5, 100.0]},
        }
        for photo, centre in zip(project.photos, centres.tolist(), strict=True)
    ]  # fmt: skip
    return {"type": "FeatureCollection", "features": features}


def test_shots_of_a_report_are_on_the_map(tmp_path: Path) -> None:
    given = block(READING)
    rotations, centres = orip_poses(given.photos, READING)
    path = written(tmp_path / "odm_report" / "shots.geojson", json.dumps(shots_of(given, centres)))
    written(tmp_path / "odm_georeferencing" / "coords.txt", "WGS84 UTM 33N\n391000 5819000\n1 2 3\n")
    project = read_well(read_opensfm, path)
    found = orip_poses(project.photos, project.readings[0])
    assert found[0] == pytest.approx(rotations, abs=1e-12)
    assert np.array_equal(found[1], centres)
    assert project.crs == "EPSG:32633"
    assert project.cameras[0].parameters == {"fx": 3000.0, "fy": 3000.0, "cx": 2000.0, "cy": 1500.0}
    (tmp_path / "odm_georeferencing" / "coords.txt").unlink()
    assert any("write crs into orip.toml" in note for note in read_well(read_opensfm, path).notes)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"focal": 0.75', '"focal": -1', "have to be above 0"),
        ('"rotation": [', '"rotation": ["a", ', "3 finite numbers"),
        ('"features"', '"feature"', "there is no 'features'"),
        ('"filename": "0.jpg"', '"filename": 7', "a text should be here"),
    ],
)
def test_faults_of_shots_name_their_place(tmp_path: Path, old: str, new: str, said: str) -> None:
    given = block(READING)
    text = json.dumps(shots_of(given, orip_poses(given.photos, READING)[1]))
    assert old in text
    parsed = read_opensfm(written(tmp_path / "shots.geojson", text.replace(old, new, 1)), "shots.geojson")
    assert parsed.value is None
    assert said in parsed.complaints[0].message


def test_features_of_smaller_images_are_less_precise(tmp_path: Path) -> None:
    folder = project_folder(tmp_path)
    assert read_well(read_opensfm, folder).precision is None
    written(folder / "config.yaml", "processes: 8   # threads\nfeature_process_size: 1000  # default 2048\n")
    project = read_well(read_opensfm, folder)
    assert project.precision == max(project.cameras[0].columns, project.cameras[0].rows) / 1000.0
    assert any("a-priori error is one pixel there, 4.0 px" in note for note in project.notes)
    written(folder / "config.yaml", "feature_process_size: 8192\n")
    assert read_well(read_opensfm, folder).precision == 1.0


@pytest.mark.parametrize("has_settings", [True, pytest.param(False, marks=pytest.mark.long)])
def test_the_sample_is_adjusted_at_its_control_with_the_step_of_its_heights(tmp_path: Path, has_settings: bool) -> None:
    """Its control is of another reconstruction, whose photos stood 2 m high; in this one they have EXIF altitudes.

    A least squares fit of scale, rotation and shift made apart from orip gives a step of 32.0 m and a scale of 1.65.
    """
    folder = sample("opensfm", "berlin")
    for name in ("reconstruction_example.json", "tracks_example.csv", "ground_control_points.json", "config.yaml"):
        if has_settings or name != "config.yaml":
            shutil.copy(folder / name, tmp_path / name.replace("_example", ""))
    done = orip(tmp_path, "import", "opensfm", ".", "new")
    assert done.code == 0
    said = f"{done.out} {done.err}"
    assert "positions of the photos are 31.7 m higher than the control points say" in said
    precision = "3.1875px" if has_settings else "3.2px"
    assert f'measurement_precision = "{precision}"' in (tmp_path / "new" / "orip.toml").read_text(encoding="utf-8")
    assert orip(tmp_path / "new", "run", "--no-report").code == 0
    solution = read_bundle(tmp_path / "new", None, "heads", "solutions").adjusted
    assert solution.status == "converged"
    assert len(solution.iterations) <= 10
    # the noise of the tracks: published residuals are 1.3 px in the mean, and many points have two rays
    assert 0.8 < solution.sigma0 < 0.9


def test_names_of_photos_in_lists_may_differ_in_case(tmp_path: Path) -> None:
    folder = project_folder(tmp_path)
    rows = "".join(f"10 20 30 {n} 6 {n}.JPG A\n" for n in range(4))
    written(folder / "gcp_list.txt", f"WGS84 UTM 33N\n{rows}10 20 30 5 6 gone.JPG A\n10 20 30 5 7 gone.JPG A\n")
    written(folder / "geo.txt", "EPSG:25833\n0.Jpg 1 2 3\n")
    project = read_well(read_opensfm, folder)
    own = ~project.points.is_track[project.rays.point]
    assert project.rays.photo[own].tolist() == [0, 1, 2, 3]
    assert [station.photo for station in project.stations] == ["0.jpg"]
    assert "4 photos of gcp_list.txt matched without regard to upper and lower case: 0.JPG is 0.jpg." in project.notes
    assert "2 marks of gcp_list.txt left out, as no oriented photo has the names there: gone.JPG." in project.notes


def test_tracks_that_are_empty_are_told(tmp_path: Path) -> None:
    folder = project_folder(tmp_path)
    written(folder / "tracks.csv", "")
    assert "tracks.csv is empty: tie points have no measurements." in read_well(read_opensfm, folder).notes


def test_a_name_that_two_photos_have_but_for_case_is_not_guessed() -> None:
    names = PhotoNames(["a.jpg", "A.JPG", "b.jpg"])
    assert [names.place(name) for name in ("A.JPG", "a.JPG", "B.jpg", "ß.jpg")] == [1, None, 2, None]
    assert names.notes("geo.txt", "place") == [
        "1 photo of geo.txt matched without regard to upper and lower case: B.jpg is b.jpg.",
        (
            "2 places of geo.txt left out, as no photo or, in other upper and lower case, several have the names "
            "there: a.JPG, ß.jpg."
        ),
    ]


@pytest.mark.parametrize(
    ("photos", "name", "place"),
    [
        (("A.JPG", "B.JPG"), "images/b.jpeg", 1),
        (("A.JPG", "B.JPG"), "B", 1),
        (("one/A.JPG", "two/A.JPG"), r"C:\flight\two\A.JPG", 1),
        (("one/A.JPG", "two/A.JPG"), "A.JPG", None),
        (("one/A.JPG",), "two/A.JPG", None),
        (("A.TIF",), "A.JPG", None),
        (("A.1", "A.2"), "a.2", 1),
    ],
)
def test_a_folder_or_an_ending_that_one_name_lacks_makes_no_difference(
    photos: tuple[str, ...], name: str, place: int | None
) -> None:
    names = PhotoNames(photos)
    assert names.place(name) == place
    (note,) = names.notes("gcp_list.txt", "mark")
    assert ("matched without regard to" in note) == (place is not None)
