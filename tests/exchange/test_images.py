"""Folders of image files: cameras and photos of EXIF, positions and gimbals of EXIF and XMP."""

from __future__ import annotations

import math
import shutil
import struct
import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from exchange.imported import read_well, sample, written

from orip.exchange.images import is_images, read_images_project
from orip.files.control.text import parse_elements
from orip.files.text.lines import read_lines
from orip.geometry.rotation import rotation_from_navigation

pytest.importorskip("exifread")

DRONE = (
    '<x:xmpmeta drone-dji:GpsLatitude="53.5" drone-dji:GpsLongitude="9.9" drone-dji:AbsoluteAltitude="+120.25" '
    'drone-dji:GimbalYawDegree="-30" drone-dji:GimbalPitchDegree="-80" drone-dji:GimbalRollDegree="+0.00" '
    'drone-dji:RtkFlag="50" drone-dji:RtkStdLon="0.01" drone-dji:RtkStdLat="0.012" drone-dji:RtkStdHgt="0.03" />'
    "</x:xmpmeta>"
)
FOCAL_MM, FOCAL_35, X_RESOLUTION, UNIT, WIDTH = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002
MODEL, ORIENTATION = 0x0110, 0x0112


def _directory(tags: dict[int, object], start: int) -> bytes:
    """Return an IFD, little-endian, at an offset: whole numbers, fractions (two numbers) and texts."""
    rows, data = b"", b""
    after = start + 2 + 12 * len(tags) + 4
    for tag, value in sorted(tags.items()):
        kind, count, content = (
            (5, 1, struct.pack("<2I", *value)) if isinstance(value, tuple)
            else (2, len(value) + 1, value.encode() + b"\0") if isinstance(value, str)
            else (4, 1, struct.pack("<I", value))
        )  # fmt: skip
        if len(content) > 4:
            rows += struct.pack("<2H2I", tag, kind, count, after + len(data))
            data += content
        else:
            rows += struct.pack("<2HI", tag, kind, count) + content.ljust(4, b"\0")
    return struct.pack("<H", len(tags)) + rows + bytes(4) + data


def image(path: Path, size: tuple[int, int], tags: dict[int, object], xmp: str = "") -> Path:
    """Write a JPEG of a size, without a picture, with tags of EXIF and a packet of XMP."""
    main = {tag: value for tag, value in tags.items() if tag in (MODEL, ORIENTATION)}
    own = {tag: value for tag, value in tags.items() if tag not in main}
    length = len(_directory({**main, 0x8769: 0}, 8))
    tiff = b"II*\0\x08\0\0\0" + _directory({**main, 0x8769: 8 + length}, 8) + _directory(own, 8 + length)
    segments = [b"Exif\0\0" + tiff] if tags else []
    segments += [b"http://ns.adobe.com/xap/1.0/\0" + xmp.encode()] if xmp else []
    parts = [b"\xff\xd8", *(b"\xff\xe1" + struct.pack(">H", 2 + len(one)) + one for one in segments)]
    frame = b"\x08" + struct.pack(">2H", size[1], size[0]) + b"\x01\x01\x11\0"
    parts += [b"\xff\xc0" + struct.pack(">H", 2 + len(frame)) + frame, b"\xff\xd9"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"".join(parts))
    return path


FULL = {MODEL: "Phantom", FOCAL_MM: (88, 10), X_RESOLUTION: (4000, 1), UNIT: 3, WIDTH: 5472}


def test_cameras_are_told_apart_by_model_size_and_focal_length(tmp_path: Path) -> None:
    image(tmp_path / "a1.jpg", (5472, 3648), FULL)
    image(tmp_path / "a2.jpg", (5472, 3648), FULL)
    image(tmp_path / "portrait.jpg", (3648, 5472), {**FULL, WIDTH: 3648, ORIENTATION: 1})
    image(tmp_path / "zoom.jpg", (5472, 3648), {**FULL, FOCAL_MM: (240, 10)})
    image(tmp_path / "phone.jpg", (4000, 3000), {MODEL: "P 1", FOCAL_35: 26})
    assert is_images(tmp_path)
    project = read_well(read_images_project, tmp_path)
    assert [photo.name for photo in project.photos] == ["a1.jpg", "a2.jpg", "phone.jpg", "portrait.jpg", "zoom.jpg"]
    assert [photo.camera for photo in project.photos] == [0, 0, 1, 2, 3]
    first, phone, portrait, zoom = project.cameras
    # 4000 pixels per cm: 2.5 micrometres
    assert (first.name, first.columns, first.rows) == ("Phantom", 5472, 3648)
    assert first.parameters["fx"] == pytest.approx(8.8 / 0.0025)
    assert first.sensor_mm == pytest.approx((13.68, 9.12))
    assert (portrait.columns, portrait.rows) == (3648, 5472)
    assert portrait.parameters["fx"] == pytest.approx(8.8 / 0.0025)
    assert zoom.parameters["fx"] == pytest.approx(24.0 / 0.0025)
    # the diagonal of 35 mm film is 43.27 mm
    assert phone.parameters["fx"] == pytest.approx(26.0 * 5000.0 / math.hypot(36.0, 24.0))
    assert phone.sensor_mm is None
    assert any("No image has a position" in note for note in project.notes)
    assert project.crs is None


def test_an_image_that_was_made_smaller_has_larger_pixels(tmp_path: Path) -> None:
    image(tmp_path / "a.jpg", (2736, 1824), FULL)
    (camera,) = read_well(read_images_project, tmp_path).cameras
    assert camera.parameters["fx"] == pytest.approx(8.8 / 0.005)
    assert camera.sensor_mm == pytest.approx((13.68, 9.12))


def test_what_is_missing_is_said_in_a_line(tmp_path: Path) -> None:
    for n in range(5):
        image(tmp_path / f"bare{n}.jpg", (600, 400), {})
    image(tmp_path / "turned.jpg", (600, 400), {**FULL, WIDTH: 600, ORIENTATION: 6})
    project = read_well(read_images_project, tmp_path)
    focal, turned, _ = project.notes
    assert focal.startswith("5 images without a focal length in EXIF (bare0.jpg, bare1.jpg, bare2.jpg and 2 more)")
    assert turned.startswith("1 image has an orientation tag (turned.jpg)")
    assert project.cameras[0].parameters["fx"] == 600.0


def test_positions_and_gimbal_become_stations_in_a_zone_of_utm(tmp_path: Path) -> None:
    image(tmp_path / "d1.jpg", (5472, 3648), FULL, DRONE)
    image(
        tmp_path / "d2.jpg", (5472, 3648), FULL, DRONE.replace("9.9", "9.9001").replace('RtkFlag="50"', 'RtkFlag="16"')
    )
    project = read_well(read_images_project, tmp_path)
    assert project.crs == "EPSG:32632"
    fixed, single = project.stations
    assert fixed.position == pytest.approx((9.9, 53.5, 120.25))
    assert fixed.position_error == (0.01, 0.012, 0.03)
    assert single.position_error == (5.0, 5.0, 10.0)
    gimbal = np.radians([[0.0, -80.0, -30.0]])
    assert rotation_from_navigation(np.array([fixed.angles]), "body") == pytest.approx(
        rotation_from_navigation(gimbal, "gimbal"), abs=1e-12
    )


def test_a_folder_of_images_becomes_a_project(tmp_path: Path) -> None:
    image(tmp_path / "flight" / "d1.jpg", (5472, 3648), FULL, DRONE)
    said = orip(tmp_path, "import", "images", "flight", "new")
    assert said.code == 0, said.err
    text = (tmp_path / "new" / "flight.STA").read_text(encoding="utf-8")
    head, angles, row = text.splitlines()
    assert (head, angles) == ("CRS EPSG:4979", "ANGLES ROLL PITCH HEADING")
    assert row.split()[:4] == ["d1", "9.9000000000", "53.5000000000", "120.2500"]
    assert orip(tmp_path / "new", "status").code == 0


def test_what_is_to_be_measured_comes_before_an_adjustment(tmp_path: Path) -> None:
    image(tmp_path / "flight" / "d1.jpg", (5472, 3648), FULL, DRONE)
    said = orip(tmp_path, "import", "images", "flight", "new")
    assert "next     write measurements into a .MEA file ('POINTS MAIN PHOTO'" in said.err
    assert orip(tmp_path / "new", "run").code == 3
    following = "write 'POINTS MAIN PHOTO' blocks into a .MEA file, then: orip run"
    assert orip(tmp_path / "new", "status", "--json").document["next"] == following


def test_damaged_files_are_named(tmp_path: Path) -> None:
    image(tmp_path / "a.jpg", (600, 400), FULL)
    written(tmp_path / "b.jpg", "no image")
    parsed = read_images_project(tmp_path, "x")
    assert parsed.value is None
    (complaint,) = parsed.complaints
    assert str(complaint).startswith("b.jpg")
    (tmp_path / "empty").mkdir()
    assert "no image file" in read_images_project(tmp_path / "empty", "x").complaints[0].message


def test_the_sample_of_a_camera_is_read(tmp_path: Path) -> None:
    shutil.copy(sample("exif", "lund_01.jpg"), tmp_path)
    project = read_well(read_images_project, tmp_path)
    assert (project.cameras[0].columns, project.cameras[0].rows) == (1024, 768)
    assert project.crs == "EPSG:32633"
    # Lund in Sweden
    assert project.stations[0].position[:2] == pytest.approx((13.19, 55.70), abs=0.01)


def test_an_imported_camera_is_adjusted_with_what_exif_is_good_for(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    image(tmp_path / "photos" / "a.jpg", (5472, 3648), FULL)
    image(tmp_path / "photos" / "bare.jpg", (600, 400), {})
    assert orip(tmp_path, "import", "images", "photos", "quarry").code == 0
    cameras = tomllib.loads((tmp_path / "quarry" / "orip.toml").read_text(encoding="utf-8"))["camera"]
    assert [camera["unknown"] for camera in cameras] == [["C", "DX", "DY", "A3", "A5"]] * 2
    parsed = parse_elements(read_lines(tmp_path / "quarry" / "photos.ELE", "photos.ELE"), "photos.ELE")
    assert not parsed.complaints
    errors = {(one.name, one.kind): (one.value, one.error) for one in parsed.value}
    # three parts in a hundred of the focal length; thirty where no tag says it
    assert errors["Phantom", "C"] == (pytest.approx(8.8), pytest.approx(0.26))
    assert errors["camera", "C"] == (pytest.approx(36.0), pytest.approx(11.0))
    # 1.5 parts in a hundred of the width of 13.68 mm
    assert errors["Phantom", "DX"] == (0.0, pytest.approx(0.21))
    # k1 = 0.2 moves an image at the tangent 1 by 0.2 C, and so does A3 at the radius C
    assert errors["Phantom", "A3"][1] * 8.8**3 == pytest.approx(0.2 * 8.8, rel=0.05)
    assert errors["Phantom", "A5"][1] * 8.8**5 == pytest.approx(0.2 * 8.8, rel=0.05)
    assert "exact" not in (tmp_path / "quarry" / "README.md").read_text(encoding="utf-8")


def test_held_cameras_have_no_errors(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    image(tmp_path / "photos" / "a.jpg", (5472, 3648), FULL)
    assert orip(tmp_path, "import", "images", "photos", "quarry", "--hold-cameras").code == 0
    assert not (tmp_path / "quarry" / "photos.ELE").exists()
