"""Models of COLMAP: read, written, and as the program itself has them."""

from __future__ import annotations

import re
import shutil
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from exchange.colmap_samples import genuine, small_model, written

from orip.exchange.colmap.binary import cameras_from_bytes, images_from_bytes, points_from_bytes
from orip.exchange.colmap.model import CAMERA_MODELS, MODEL_NAMES, ColmapCamera, ColmapModel
from orip.exchange.colmap.reader import Form, is_model, project_of_model, read_folder, read_model
from orip.exchange.colmap.rig_files import frames_from_bytes, frames_from_text, rigs_from_bytes, rigs_from_text
from orip.exchange.colmap.text import cameras_from_text, images_from_text, points_from_text
from orip.exchange.colmap.writer import new_model, updated_model, write_model
from orip.exchange.formats import guessed_source
from orip.records.exchanged import ExchangedProject, Lens
from orip.structs import replace

SCEAUX_9 = ("sceaux-9-text", "sceaux-9-colmap4/text", "sceaux-9-colmap4/binary")


def read(folder: Path) -> ExchangedProject:
    parsed = read_model(folder, folder.name)
    assert parsed.complaints == ()
    assert parsed.value is not None
    return parsed.value


def same(one: ColmapModel, other: ColmapModel) -> bool:
    return (
        one.cameras == other.cameras
        and all(
            (a.id, a.pose, a.camera, a.name) == (b.id, b.pose, b.camera, b.name)
            and np.array_equal(a.keypoints, b.keypoints)
            and np.array_equal(a.points, b.points)
            for a, b in zip(one.images, other.images, strict=True)
        )
        and all(
            np.array_equal(getattr(one.points, name), getattr(other.points, name))
            for name in ("ids", "coordinates", "colours", "errors", "lengths", "tracks")
        )
    )


@pytest.mark.parametrize("form", ["bin", "txt"])
def test_a_model_is_read_as_it_was_written(tmp_path: Path, form: Form) -> None:
    model = small_model()
    again = read_folder(written(tmp_path, model, form), "model")
    assert again.complaints == ()
    assert same(again.value, model)


@pytest.mark.parametrize("form", ["bin", "txt"])
def test_a_project_written_back_changes_no_byte(tmp_path: Path, form: Form) -> None:
    folder = written(tmp_path, small_model(), form)
    for name, data in write_model(read(folder), folder).items():
        assert data == (folder / name).read_bytes()


def test_what_a_new_model_says_is_what_was_imported(tmp_path: Path) -> None:
    folder = written(tmp_path / "given", small_model(), "bin")
    project = read(folder)
    again = read(written(tmp_path / "new", new_model(project), "txt"))
    assert again.cameras == project.cameras
    assert again.photos == project.photos
    assert again.points.names == project.points.names
    assert np.array_equal(again.points.coordinates, project.points.coordinates)
    for name in ("photo", "point", "image"):
        assert np.array_equal(getattr(again.rays, name), getattr(project.rays, name))


def test_a_result_goes_into_a_copy_with_ids_and_keypoints_as_they_were() -> None:
    model = small_model()
    project, _ = project_of_model(model)
    shifted = project.points.coordinates + 0.25
    active = project.rays.is_active.copy()
    active[3] = False
    photos = (replace(project.photos[0], position=(1.0, 2.0, 3.0)), *project.photos[1:])
    changed = replace(
        project,
        photos=photos,
        points=replace(project.points, coordinates=shifted, residual=np.full(60, 0.75)),
        rays=replace(project.rays, is_active=active),
    )
    found = updated_model(model, changed)
    assert found.images[0].pose == (*model.images[0].pose[:4], 1.0, 2.0, 3.0)
    assert found.images[1].pose == model.images[1].pose
    assert np.array_equal(found.images[0].keypoints, model.images[0].keypoints)
    assert found.images[0].points[3] == -1
    assert found.points.lengths.sum() == model.points.lengths.sum() - 1
    assert np.array_equal(found.points.coordinates, shifted)
    assert (found.points.errors == 0.75).all()
    assert np.array_equal(found.points.colours, model.points.colours)


def test_points_that_the_project_has_not_become_keypoints_without_a_point() -> None:
    model = small_model()
    project, _ = project_of_model(model)
    names = tuple(name for name in project.points.names if name != "7")
    kept = np.array([name != "7" for name in project.points.names])
    number = np.cumsum(kept) - 1
    rays = project.rays
    of_kept = kept[rays.point]
    project = replace(
        project,
        points=replace(project.points, names=names, coordinates=project.points.coordinates[kept], is_track=kept[kept]),
        rays=replace(
            rays,
            photo=rays.photo[of_kept],
            point=number[rays.point[of_kept]],
            image=rays.image[of_kept],
            deviation=rays.deviation[of_kept],
            is_active=rays.is_active[of_kept],
        ),
    )
    found = updated_model(model, project)
    assert len(found.points.ids) == 59
    assert 7 not in found.points.ids
    assert not any((image.points == 7).any() for image in found.images)
    assert len(found.points.tracks) == len(model.points.tracks) - 6
    assert all(len(a.points) == len(b.points) for a, b in zip(found.images, model.images, strict=True))


@pytest.mark.parametrize(
    ("lens", "parameters", "model"),
    [
        ("opencv", {"fx": 5.0, "fy": 5.0, "cx": 1.0, "cy": 1.0}, "SIMPLE_PINHOLE"),
        ("opencv", {"fx": 5.0, "fy": 6.0, "cx": 1.0, "cy": 1.0}, "PINHOLE"),
        ("opencv", {"fx": 5.0, "fy": 5.0, "k1": 0.1}, "SIMPLE_RADIAL"),
        ("opencv", {"fx": 5.0, "fy": 5.0, "k1": 0.1, "p1": 0.1}, "OPENCV"),
        ("opencv", {"fx": 5.0, "fy": 5.0, "k3": 0.1}, "FULL_OPENCV"),
        ("equidistant", {"fx": 5.0, "fy": 5.0, "k1": 0.1}, "SIMPLE_RADIAL_FISHEYE"),
        ("equidistant", {"fx": 5.0, "fy": 6.0, "k4": 0.1}, "OPENCV_FISHEYE"),
    ],
)
def test_the_smallest_model_that_holds_a_camera_is_written(
    lens: Lens, parameters: dict[str, float], model: str
) -> None:
    project, _ = project_of_model(small_model())
    camera = replace(project.cameras[0], lens=lens, parameters=parameters, model="")
    assert new_model(replace(project, cameras=(camera,))).cameras[0].model == model


def test_the_numbers_of_camera_models_are_those_of_colmap() -> None:
    pycolmap = pytest.importorskip("pycolmap")
    for number, name in MODEL_NAMES.items():
        theirs = getattr(pycolmap.CameraModelId, name)
        assert int(theirs) == number
        camera = pycolmap.Camera.create_from_model_id(1, theirs, 100.0, 40, 30)
        assert len(camera.params) == len(CAMERA_MODELS[name].parameters)


@pytest.mark.parametrize("form", ["bin", "txt"])
def test_colmap_itself_reads_what_is_written(tmp_path: Path, form: Form) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    model = small_model()
    opened = pycolmap.Reconstruction(str(written(tmp_path, model, form)))
    assert (opened.num_images(), opened.num_points3D()) == (6, 60)
    image = opened.images[model.images[0].id]
    # COLMAP's reader of texts ends a name at its first blank
    assert image.name == ("left side/Bild ä.jpg" if form == "bin" else "left")
    assert image.cam_from_world().rotation.quat[3] == pytest.approx(model.images[0].pose[0], abs=1e-15)


# ---- genuine models ----


def test_models_with_rigs_and_frames_are_imported_like_those_without(tmp_path: Path) -> None:
    plain, *others = (read(genuine(name, tmp_path / str(n))) for n, name in enumerate(SCEAUX_9))
    for other in others:
        assert other.photos == plain.photos
        assert other.cameras == plain.cameras
        assert np.array_equal(other.rays.image, plain.rays.image)


def test_a_model_is_found_from_its_folder_its_project_or_one_of_its_files(tmp_path: Path) -> None:
    folder = written(tmp_path / "sparse" / "0", small_model(), "bin")
    for path in (folder, tmp_path, folder / "cameras.bin"):
        assert is_model(path)
        assert guessed_source(path)[0].name == "colmap"
        assert len(read(path).photos) == 6
    assert not is_model(tmp_path / "nothing")


# ---- positions of photos in the database ----


def database(path: Path, rows: list[tuple[object, ...]], *, is_new: bool) -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TABLE images (image_id INTEGER, name TEXT, camera_id INTEGER)")
        connection.executemany("INSERT INTO images VALUES (?, ?, 1)", [(n, f"{n - 1}.jpg") for n in range(1, 7)])
        key = "pose_prior_id, corr_data_id, corr_sensor_id, corr_sensor_type" if is_new else "image_id"
        connection.execute(f"CREATE TABLE pose_priors ({key}, position, position_covariance, coordinate_system)")
        for number, *values in rows:
            keys = [number + 100, number, 1, 0] if is_new else [number]
            marks = ", ".join("?" * (len(keys) + 3))
            connection.execute(f"INSERT INTO pose_priors VALUES ({marks})", [*keys, *values])


def blob(*values: float) -> bytes:
    return struct.pack(f"<{len(values)}d", *values)


@pytest.mark.parametrize("is_new", [False, True])
def test_priors_of_photos_become_stations(tmp_path: Path, is_new: bool) -> None:
    folder = written(tmp_path / "sparse" / "0", small_model(), "bin")
    rows = [
        (2, blob(53.5, 9.9, 120.0), blob(0.0004, 0, 0, 0, 0.0009, 0, 0, 0, 0.0025), 0),
        (3, blob(53.6, 9.8, 121.0), blob(*[np.nan] * 9), 0),
        (4, blob(np.nan, np.nan, np.nan), None, 0),
    ]
    database(tmp_path / "database.db", rows, is_new=is_new)
    project = read(folder)
    first, second = project.stations
    assert project.station_reference.crs == "EPSG:4979"
    assert (first.photo, first.position) == ("1.jpg", (9.9, 53.5, 120.0))
    assert first.position_error == pytest.approx((0.02, 0.03, 0.05))
    assert second.position_error == (-1.0, -1.0, -1.0)
    assert any("no standard deviations" in note for note in project.notes)


def test_a_database_without_priors_or_of_another_kind(tmp_path: Path) -> None:
    folder = written(tmp_path, small_model(), "bin")
    with closing(sqlite3.connect(tmp_path / "database.db")) as connection:
        connection.execute("CREATE TABLE images (image_id INTEGER, name TEXT)")
    assert read(folder).stations == ()
    (tmp_path / "database.db").write_bytes(b"no database at all, and long enough to be looked at" * 30)
    parsed = read_model(folder, "model")
    assert parsed.value is None
    assert "cannot be read" in parsed.complaints[0].message


# ---- damaged files ----


@pytest.mark.parametrize(
    ("read_bytes", "data", "message"),
    [
        (cameras_from_bytes, b"", r"it ends at byte 0, within the number of cameras that begins at byte 0"),
        (cameras_from_bytes, struct.pack("<Q", 1 << 60), r"announces 1152921504606846976 cameras, but 0 bytes follow"),
        (cameras_from_bytes, struct.pack("<QIiQQ", 1, 1, 99, 4, 3), r"camera at byte 8 has the unknown model 99"),
        (cameras_from_bytes, struct.pack("<QIiQQd", 1, 1, 0, 4, 3, 1.0), r"within the parameters of a camera"),
        (cameras_from_bytes, struct.pack("<Q", 0) + b"x", r"1 bytes follow after its end at byte 8"),
        (images_from_bytes, struct.pack("<QI7dI", 1, 1, *[1.0] * 7, 1) + b"a.jpg" + b"x" * 9, r"has no end"),
        (
            images_from_bytes,
            struct.pack("<QI7dI", 1, 1, *[1.0] * 7, 1) + b"a.jpg\0" + struct.pack("<Q", 5),
            r"announces 5 keypoints of image a.jpg, but 0 bytes follow",
        ),
        (points_from_bytes, struct.pack("<QQ3d3BdQ", 1, 1, 0, 0, 0, 0, 0, 0, 0, 9), r"announces 9 rays of a point"),
        (rigs_from_bytes, struct.pack("<QIIiI", 1, 1, 3, 0, 1), r"within a sensor of a rig"),
        (rigs_from_bytes, struct.pack("<QIIiIiIB", 1, 1, 2, 0, 1, 0, 2, 1), r"within the pose of a sensor"),
        (frames_from_bytes, struct.pack("<QII7dI", 1, 1, 1, *[1.0] * 7, 1), r"within a datum of a frame"),
    ],
)
def test_a_damaged_binary_file_is_complained_of_with_the_byte(read_bytes, data: bytes, message: str) -> None:
    parsed = read_bytes(data, "file.bin")
    (complaint,) = parsed.complaints
    assert complaint.path == "file.bin"
    assert re.search(message, complaint.message), complaint.message


@pytest.mark.parametrize(
    ("read_text", "text", "line", "message"),
    [
        (cameras_from_text, "1 FISH 4 3 1", 1, "FISH is not a camera model of COLMAP"),
        (
            cameras_from_text,
            "# head\n1 PINHOLE 4 3 1 2",
            2,
            r"PINHOLE has 4 parameters \(fx fy cx cy\), but 2 are here",
        ),
        (cameras_from_text, "1 SIMPLE_PINHOLE 4.5 3 1 2 3", 1, "whole numbers"),
        (cameras_from_text, "1 SIMPLE_PINHOLE 4 3 1 2 nan", 1, "not a number"),
        (images_from_text, "1 1 0 0 0 0 0 0 1\n", 1, "this line has 9 fields"),
        (images_from_text, "1 1 0 0 0 0 0 0 1 a.jpg\n1 2", 2, "write COLUMN ROW POINT"),
        (images_from_text, "1 1 0 0 0 0 0 0 1 a.jpg\n1 2 -1 1 x -1", 2, "x is not a number"),
        (images_from_text, "1 1 0 0 0 0 0 0 1 a.jpg\n1 2 0.5", 2, "0.5 is not a whole number"),
        (rigs_from_text, "1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 0 0", 1, "TYPE SENSOR 1 and a pose"),
        (rigs_from_text, "1 3 CAMERA 1 CAMERA 2 0", 1, "TYPE SENSOR 1 and a pose"),
        (frames_from_text, "1 1 1 0 0 0 0 0 0 1 CAMERA 1", 1, "TYPE SENSOR IMAGE repeated"),
        (frames_from_text, "1 1 1 0 0 0 0 0 x 1 CAMERA 1 1", 1, "TYPE SENSOR IMAGE repeated"),
        (points_from_text, "1 0 0 0 1 2 3 0.5 1", 1, "this line has 9 fields"),
        (points_from_text, "1 0 0 0 1 2 3 0.5\n2 0 0 z 1 2 3 0.5 1 1", 2, "z is not a number"),
        (points_from_text, "1 0 0 0 1 2 300 0.5", 1, "colours"),
    ],
)
def test_a_wrong_text_is_complained_of_with_the_line(read_text, text: str, line: int, message: str) -> None:
    parsed = read_text(text.encode(), "file.txt")
    (complaint,) = parsed.complaints
    assert (complaint.path, complaint.line) == ("file.txt", line)
    assert re.search(message, complaint.message), complaint.message


def test_contradictions_of_a_model_are_named_all_at_once(tmp_path: Path) -> None:
    model = small_model()
    damaged = replace(
        model,
        cameras=(ColmapCamera(1, "SIMPLE_PINHOLE", 0, 3, (1.0, 2.0, 3.0)),),
        images=(replace(model.images[0], camera=5), replace(model.images[1], pose=(0.0,) * 7), model.images[1]),
    )
    found = [str(complaint) for complaint in read_folder(written(tmp_path, damaged, "txt"), "m").complaints]
    assert any("camera 1 has 0 by 3 pixels" in text for text in found)
    assert any("has the camera 5, which is not among the cameras" in text for text in found)
    assert any("has no rotation" in text for text in found)
    assert any("is there twice" in text for text in found)


def test_an_empty_line_of_keypoints_and_blanks_in_a_name() -> None:
    text = "# images\n3 1 0 0 0 0 0 0 1 my folder/a b.jpg\n\n4 1 0 0 0 0 0 0 1 c.jpg\n1 2 -1\n"
    parsed = images_from_text(text.encode(), "images.txt")
    assert parsed.complaints == ()
    assert [(image.name, len(image.points)) for image in parsed.value] == [("my folder/a b.jpg", 0), ("c.jpg", 1)]


def test_rays_to_points_that_are_not_there_are_left_out_with_a_note(tmp_path: Path) -> None:
    folder = written(tmp_path, small_model(), "txt")
    path = folder / "points3D.txt"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if not line.startswith("7 ")))
    project = read(folder)
    assert len(project.rays.photo) == 6 * 59
    assert "6 rays left out, as there is no such point in points3D." in project.notes


def test_coordinates_with_six_digits_only_are_pointed_out(tmp_path: Path) -> None:
    model = small_model()
    far = np.round(model.points.coordinates * 1e5, -1)
    coarse = replace(model, points=replace(model.points, coordinates=far))
    assert any("six digits" in note for note in read(written(tmp_path / "a", coarse, "txt")).notes)
    fine = replace(model, points=replace(model.points, coordinates=far + 0.123))
    assert not any("six digits" in note for note in read(written(tmp_path / "b", fine, "txt")).notes)


def test_a_folder_without_a_model(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("")
    parsed = read_model(tmp_path, "here")
    assert parsed.value is None
    assert "there is no model of COLMAP here" in str(parsed.complaints[0])
    assert str(parsed.complaints[0]).endswith("; there is only cameras.txt")
    shutil.rmtree(tmp_path)
    assert read_model(tmp_path, "here").value is None
