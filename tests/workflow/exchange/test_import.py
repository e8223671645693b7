"""Projects of other programs as project folders."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import PINHOLE, block
from exchange.colmap_samples import genuine, small_model, written
from reference.published_data import data_set

from orip.errors import InputError
from orip.exchange.colmap.model import ColmapCamera
from orip.exchange.conversion.cameras import lens_pixels
from orip.exchange.project.block import ExchangeSettings, imported_block
from orip.exchange.project.texts import ImportSource, imported_texts
from orip.files.control.preliminary_text import read_preliminary
from orip.files.control.stations_text import parse_stations_and_reference
from orip.files.control.text import parse_distances, parse_points
from orip.files.log.text import read_measurements
from orip.files.project.reader import parse_project
from orip.files.text.shown import Parsed
from orip.records.control import ControlDistance, ControlPoint, Station, StationReference
from orip.records.definition import ProjectDefinition
from orip.records.exchanged import ExchangedProject, PoseReading
from orip.records.measurement import PointsRecord
from orip.structs import replace

READING = PoseReading("y_up", "to_ground", "omega_phi_kappa", "degree")
SOURCE = ImportSource("test", "/somewhere", "A name that is too long for orip")


def texts(project: ExchangedProject, settings: ExchangeSettings | None = None) -> dict[str, str]:
    imported = imported_block(project, "source", settings or ExchangeSettings())
    return imported_texts(imported, SOURCE, None).texts


def definition_of(found: dict[str, str]) -> ProjectDefinition:
    parsed = parse_project(found["orip.toml"])
    assert parsed.complaints == ()
    assert parsed.value is not None
    return parsed.value.definition


def measured(folder: Path, found: dict[str, str]) -> list[PointsRecord]:
    (folder / "MAIN.MEA").write_text(found["MAIN.MEA"], encoding="utf-8")
    parsed = read_measurements(folder / "MAIN.MEA", "MAIN.MEA")
    assert parsed.complaints == ()
    return [record for record in parsed.value if isinstance(record, PointsRecord)]


def with_marks(project: ExchangedProject, *places: int) -> ExchangedProject:
    """Return a project in which some points are marks and no tracks."""
    is_track = project.points.is_track.copy()
    is_track[list(places)] = False
    return replace(project, points=replace(project.points, is_track=is_track))


def lines(text: str) -> Parsed[list[str]]:
    return Parsed(text.splitlines())


def test_the_texts_say_what_was_imported_to_the_last_digit(tmp_path: Path) -> None:
    project = block(READING, noise_px=0.5)
    found = texts(project)
    definition = definition_of(found)
    assert definition.name == "A_name_that_is_too_l"
    assert [photo.name for photo in definition.photos] == [str(n) for n in range(6)]
    assert definition.photos[3].orientation[:3] == project.photos[3].position
    assert definition.photos[3].orientation[3:] == pytest.approx(project.photos[3].rotation, abs=1e-12)
    assert (definition.bundles[0].datum, definition.bundles[0].repeated_points) == ("free", "replace")
    (tmp_path / "MAIN.PRE").write_text(found["MAIN.PRE"])
    points = read_preliminary(tmp_path / "MAIN.PRE", "MAIN.PRE").value
    assert [point.name for point in points] == [f"T{n}" for n in range(60)]
    assert np.array_equal([point.coordinates for point in points], project.points.coordinates)
    blocks = measured(tmp_path, found)
    assert [record.photo for record in blocks] == [str(n) for n in range(6)]
    assert np.array_equal(np.vstack([record.measured for record in blocks]), project.rays.image)


def test_an_import_from_another_place_has_the_same_bytes(tmp_path: Path) -> None:
    found = []
    for place in ("here", "far/away"):
        written(tmp_path / place / "castle", small_model(), "bin")
        said = orip(tmp_path / place, "import", "colmap", "castle", "project")
        assert said.code == 0, said.err
        files = sorted((tmp_path / place / "project").iterdir())
        found.append({path.name: path.read_bytes() for path in files})
        assert 'path = "../castle"' in (tmp_path / place / "project" / "exchange.toml").read_text()
    assert found[0] == found[1]
    assert not any(str(tmp_path).encode() in data for data in found[0].values())


def test_rays_with_errors_of_their_own_left_out_and_measured_twice(tmp_path: Path) -> None:
    project = block(READING)
    rays = project.rays
    deviation, active, point = rays.deviation.copy(), rays.is_active.copy(), rays.point.copy()
    deviation[0], active[1], point[3] = 0.25, False, point[2]
    found = texts(replace(project, rays=replace(rays, deviation=deviation, is_active=active, point=point)))
    first, second = [record for record in measured(tmp_path, found) if record.photo == "0"]
    assert (len(first.names), second.names) == (59, ("T2",))
    assert "  T0 " in found["MAIN.MEA"]
    assert found["MAIN.MEA"].splitlines()[2].endswith(" 0.25px 0.25px")
    assert found["MAIN.MEA"].splitlines()[3].endswith(" -")
    assert definition_of(found).bundles[0].repeated_points == "both"


def test_points_that_one_photo_shows_are_left_out_unless_they_are_control() -> None:
    project = block(READING)
    keep = (project.rays.photo == 0) | (project.rays.point > 1)
    rays = replace(
        project.rays,
        **{name: getattr(project.rays, name)[keep] for name in ("photo", "point", "image", "deviation", "is_active")},
    )
    control = ControlPoint("1", (1.0, 2.0, None), (0.01, None, None))
    found = texts(replace(with_marks(project, 1), rays=rays, control=(control,)))
    assert "  T0 " not in found["MAIN.MEA"]
    assert "  1 " in found["MAIN.MEA"]
    assert "T0 " not in found["MAIN.PRE"]
    assert "1 ray left out, as no other photo shows the point." in found["README.md"]
    (point,) = parse_points(lines(found["A_name_that_is_too_l.PNT"]), "a.PNT").value
    assert (point.name, point.coordinates, point.errors) == ("1", (1.0, 2.0, None), (0.01, 0.02, None))
    assert definition_of(found).bundles[0].datum == "control"


def test_distances_and_stations_have_the_names_that_orip_gives() -> None:
    project = with_marks(block(READING), 0, 4)
    project = replace(project, points=replace(project.points, names=("3 a", *project.points.names[1:])))
    distance = ControlDistance("bar", "3 a", "4", "XYZ", 12.5, 0.01)
    station = Station("2.jpg", (1.0, 2.0, 3.0), (0.02, 0.02, 0.03))
    found = texts(replace(project, distances=(distance,), stations=(station, replace(station, photo="other.jpg"))))
    (one,) = parse_distances(lines(found["A_name_that_is_too_l.LEN"]), "a.LEN").value
    assert (one.start, one.end, one.distance) == ("3_a", "4", 12.5)
    stations, _ = parse_stations_and_reference(lines(found["A_name_that_is_too_l.STA"]), "a.STA").value
    assert [(one.photo, one.position) for one in stations] == [("2", (1.0, 2.0, 3.0))]
    assert definition_of(found).bundles[0].datum == "control"


def test_geographic_stations_need_a_crs() -> None:
    station = Station("2.jpg", (9.9, 53.5, 3.0), (0.02, 0.02, 0.03))
    project = replace(block(READING), stations=(station,), station_reference=StationReference("EPSG:4979"))
    found = texts(project)
    assert not any(name.endswith(".STA") for name in found)
    assert "1 position of photos in EPSG:4979 left out: the project has no crs." in found["README.md"]
    assert definition_of(found).bundles[0].datum == "free"


def test_a_camera_that_orip_does_not_hold_is_corrected_when_asked_for(tmp_path: Path) -> None:
    project = block(READING)
    pinhole = project.rays.image
    strong = replace(PINHOLE, lens="division", parameters={**PINHOLE.parameters, "k1": -0.45}, model="DIVISION")
    project = replace(project, cameras=(strong,))
    with pytest.raises(InputError, match=r"camera '1' \(DIVISION\).*--exact-distortion"):
        texts(project)
    # pixels of the same directions through the other lens: what was exact stays exact
    x = (pinhole - [2010.0, 1490.0]) / 3000.0
    seen = lens_pixels(strong, (36.0, 27.0), x * [1.0, -1.0])
    project = replace(project, rays=replace(project.rays, image=seen))
    imported = imported_block(project, "source", ExchangeSettings(corrects_distortion=True))
    assert imported.found.rms < 1e-6
    found = imported_texts(imported, SOURCE, None).texts
    assert "not the pixels that were measured" in found["MAIN.MEA"].splitlines()[1]
    assert measured(tmp_path, found)


def test_what_does_not_fit_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    model = small_model()
    turned = replace(model, images=tuple(replace(image, pose=(1.0, *[0.0] * 6)) for image in model.images))
    source = written(tmp_path / "given", turned, "bin")
    said = orip(tmp_path, "import", str(source), "new")
    assert said.code == 3
    assert "do not fit the measurements in any reading of the rotations" in said.err
    assert not (tmp_path / "new").exists()
    damaged = replace(model, cameras=(ColmapCamera(1, "EQUIRECTANGULAR", 4000, 3000, (4000.0, 3000.0)),))
    said = orip(tmp_path, "import", "colmap", str(written(tmp_path / "sphere", damaged, "txt")), "new")
    assert said.code == 3
    assert "camera '1' (EQUIRECTANGULAR): orip has perspective and fisheye lenses" in said.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["given", "sphere"]


def test_import_and_run_from_the_command_line(tmp_path: Path) -> None:
    source = written(tmp_path / "castle" / "sparse" / "0", small_model(), "bin")
    said = orip(tmp_path, "import", "--json", "castle")
    assert said.code == 0, said.err
    assert said.document["folder"] == str(tmp_path / "castle_orip")
    assert (said.document["photos"], said.document["points"], said.document["rays"]) == (6, 60, 360)
    # 0.5 px in columns and rows, of 720 values
    assert said.document["reprojection_rms"] == pytest.approx(0.5 * 2.0**0.5, rel=0.1)
    assert "reprojection RMS" in said.err
    with (tmp_path / "castle_orip" / "names.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    assert ["photo", "Bild_ä", "left side/Bild ä.jpg"] in rows
    said = orip(tmp_path / "castle_orip", "run", "--no-report")
    assert said.code == 0, said.err
    assert "status   converged" in said.out
    again = orip(tmp_path, "import", str(source), "castle_orip")
    assert again.code == 2
    assert "has something in it already" in again.err


def test_words_of_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "sparse.zip").touch()
    assert "colmap " in orip(tmp_path, "import", "--list").out
    assert orip(tmp_path, "import", "--list", "--json").document["formats"][0]["name"] == "colmap"
    for words, message in (
        ([], "write 'orip import SOURCE'"),
        (["nothing"], "there is no"),
        (["colmap", "nothing"], "there is no"),
        (["."], "looks like none of the formats"),
        (["sparse.zip"], "sparse.zip is an archive; unpack it"),
        ([".", "--frame", "12"], "--frame 12: write columns and rows"),
        ([".", "--precision", "0"], "--precision 0.0: write pixels"),
    ):
        said = orip(tmp_path, "import", *words)
        assert (said.code, message in said.err) == (2, True), (words, said.err)


def test_the_only_file_of_a_format_in_a_folder_is_read_whatever_its_name(tmp_path: Path) -> None:
    cameras = "".join(f"{n}.jpg 3000 1 0 0 0 {n} 0 0 0 0\n" for n in range(3))
    folder = tmp_path / "from vision"
    folder.mkdir()
    (folder / "notes.txt").write_text("NVM is in the other file\n", encoding="utf-8")
    (folder / "church.nvm").write_text(f"NVM_V3\n\n3\n{cameras}\n0\n\n0\n", encoding="utf-8")
    for words in (["from vision"], ["nvm", "from vision"]):
        said = orip(tmp_path, "import", *words, f"new{len(words)}", "--frame", "3000x2000")
        assert said.code == 0, said.err
        assert "import   nvm: 3 photos" in said.err
    (folder / "tower.nvm").write_bytes((folder / "church.nvm").read_bytes())
    said = orip(tmp_path, "import", "from vision", "new")
    assert said.code == 2
    assert "several files of other programs: church.nvm (nvm), tower.nvm (nvm); name one of them" in said.err


def test_a_genuine_model_as_a_free_network(tmp_path: Path) -> None:
    genuine("sceaux-9-text", tmp_path / "sceaux")
    said = orip(tmp_path, "import", "sceaux", "new")
    assert said.code == 0, said.err
    assert "9 photos, 6319 points, 25548 rays" in said.err
    assert "reprojection RMS 0.8269 px; mean length over points 0.6194 px (the file says" in said.err
    said = orip(tmp_path / "new", "run", "--no-report", "--json")
    assert said.code == 0, said.err
    assert said.document["status"] == "converged"
    # COLMAP has minimised the same residuals, with a robust loss or none: its sigma0 is 0.8269 / sqrt(2), and the
    # redundancy is 0.63 of the observations
    assert said.document["sigma0"] == pytest.approx(0.8269 / 2.0**0.5 / 0.628**0.5, rel=0.01)


def test_a_size_that_cannot_be_right_is_questioned(tmp_path: Path) -> None:
    """Its pixels are absolute: where the middle of the image is follows from its size."""
    source = data_set("exchange") / "colmap" / "visualsfm" / "sceaux.nvm"
    said = orip(tmp_path, "import", str(source), "new", "--frame", "3072x2048")
    assert said.code == 3
    assert "check that --frame 3072x2048 is the size of the images" in said.err


def test_the_size_of_all_photos_is_asked_for_once(tmp_path: Path) -> None:
    """VisualSFM has a camera for each photo, and the size of none."""
    cameras = "".join(f"{n}.jpg 3000 1 0 0 0 {n} 0 0 0 0\n" for n in range(3))
    (tmp_path / "a.nvm").write_text(f"NVM_V3\n\n3\n{cameras}\n0\n\n0\n", encoding="utf-8")
    said = orip(tmp_path, "import", "a.nvm", "new")
    assert said.code != 0
    assert said.err.count("--frame") == 1
    assert "the photos of 3 cameras have (camera0 first)" in said.err
    assert not (tmp_path / "new").exists()
