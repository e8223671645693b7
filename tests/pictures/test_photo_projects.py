"""`orip photos`: cameras, positions and what is left out of a folder of photographs."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip

from orip.files.control.text import parse_elements
from orip.files.text.lines import read_lines

Image = pytest.importorskip("PIL.Image")
IFDRational = pytest.importorskip("PIL.TiffImagePlugin").IFDRational
pytest.importorskip("exifread")

COLUMNS, ROWS = 480, 320


def _photo(path: Path, seed: int, *, model: str = "TEST CAM", blur: int = 1, hour: int = 10) -> None:
    grey = np.random.default_rng(seed).integers(0, 255, (ROWS // blur, COLUMNS // blur)).astype(np.uint8)
    picture = Image.fromarray(grey).resize((COLUMNS, ROWS), Image.Resampling.BICUBIC)
    exif = Image.Exif()
    exif[0x0110], exif[0x0112] = model, 6
    own = exif.get_ifd(0x8769)
    own[0x9003] = f"2026:05:01 {hour}:00:{seed:02}"
    own[0x920A], own[0xA20E], own[0xA210] = (
        IFDRational(24, 1),
        IFDRational(200, 1),
        3,
    )  # mm; pixels a cm: 24 mm over 480 columns
    picture.save(path, quality=95, exif=exif)


@pytest.fixture
def folder(tmp_path) -> Path:
    images = tmp_path / "flight"
    images.mkdir()
    for number in range(1, 6):
        _photo(images / f"A{number}.jpg", number)
    return images


def _made(folder: Path, *options: str):
    done = orip(folder.parent, "photos", folder.name, "made", *options)
    assert done.code == 0, done.err
    return done.err, tomllib.loads((folder.parent / "made" / "orip.toml").read_text())


def test_the_project_has_the_camera_of_exif_and_passes_init(folder):
    said, project = _made(folder)
    (camera,) = project["camera"]
    assert camera["c"] == pytest.approx(24.0)
    assert camera["sensor"] == {"columns": COLUMNS, "rows": ROWS, "width": 24.0, "height": 16.0}
    assert [photo["image"] for photo in project["photo"]] == [f"../flight/A{n}.jpg" for n in range(1, 6)]
    assert "from focal plane" in said
    assert orip(folder.parent / "made", "init").code == 0
    assert "warning" not in orip(folder.parent / "made", "status").err


def test_the_camera_is_adjusted_with_what_exif_is_good_for(folder):
    Image.fromarray(np.random.default_rng(9).integers(0, 255, (400, 600)).astype(np.uint8)).save(folder / "bare.jpg")
    _made(folder)
    parsed = parse_elements(read_lines(folder.parent / "made" / "made.ELE", "made.ELE"), "made.ELE")
    assert not parsed.complaints
    errors = {(one.name, one.kind): (one.value, one.error) for one in parsed.value}
    # three parts in a hundred of the focal length; thirty where no tag says it
    assert errors["TEST_CAM", "C"] == (pytest.approx(24.0), pytest.approx(0.72))
    assert errors["CAMERA", "C"] == (pytest.approx(36.0), pytest.approx(11.0))
    # 1.5 parts in a hundred of the width of 24 mm
    assert errors["TEST_CAM", "DX"] == (0.0, pytest.approx(0.36))
    # k1 = 0.2 moves an image at the tangent 1 by 0.2 C, and so does A3 at the radius C
    assert errors["TEST_CAM", "A3"][1] * 24.0**3 == pytest.approx(0.2 * 24.0, rel=0.05)
    assert errors["TEST_CAM", "A5"][1] * 24.0**5 == pytest.approx(0.2 * 24.0, rel=0.05)


def test_what_is_to_be_measured_comes_before_an_adjustment(folder):
    _made(folder)
    assert orip(folder.parent / "made", "run").code == 3
    following = "write 'POINTS MAIN PHOTO' blocks into a .MEA file, then: orip run"
    assert orip(folder.parent / "made", "status", "--json").document["next"] == following


def test_the_width_that_is_given_counts(folder):
    said, project = _made(folder, "--sensor-width", "36")
    assert project["camera"][0]["sensor"]["width"] == 36.0
    assert "from --sensor-width" in said


def test_what_is_no_photo_of_the_block_is_named_and_left_out(folder):
    shutil.copy(folder / "A1.jpg", folder / "copy.jpg")
    _photo(folder / "soft.jpg", 9, blur=16)
    (folder / "empty.jpg").touch()
    (folder / "dir.jpg").mkdir()
    Image.new("L", (1920, 1080)).save(folder / "screen.png")
    Image.new("L", (1300, 400)).save(folder / "pano.jpg")
    said, project = _made(folder)
    for name, why in {
        "copy.jpg": "same picture as A1.jpg", "soft.jpg": "blurred",
        "empty.jpg": "empty", "dir.jpg": "a folder", "screen.png": "screenshot",
        "pano.jpg": "1300 x 400 pixels: a panorama",
    }.items():  # fmt: skip
        (line,) = [line for line in said.splitlines() if line.startswith(f"left out {name}:")]
        assert why in line
    assert [photo["name"] for photo in project["photo"]] == [f"A{n}" for n in range(1, 6)]


def test_images_of_other_kinds_and_in_folders_are_named(folder):
    for name in ("A1.CR2", "P1.HEIC", ".P2.HEIC"):
        (folder / name).write_bytes(b"no JPEG")
    said, project = _made(folder)
    (line,) = [line for line in said.splitlines() if line.startswith("left out")]
    assert line.startswith("left out P1.HEIC: not one of the images that orip reads (.jpg, "), "A1.CR2 has its JPEG"
    assert len(project["photo"]) == 5
    (folder.parent / "P3.dng").write_bytes(b"no JPEG")
    done = orip(folder.parent, "photos", ".", "other")
    assert done.code == 3
    assert "there is no image in this folder; " in done.err
    assert "; export .dng as one of them; name one of the folders in it: flight\n" in done.err


@pytest.mark.parametrize("keeps_exif", [True, False])
def test_a_picture_that_was_compressed_again_is_left_out(folder, keeps_exif):
    with Image.open(folder / "A2.jpg") as picture:
        picture.load()
        exif = picture.getexif()
    picture.save(folder / "A9.jpg", quality=40, **({"exif": exif} if keeps_exif else {}))
    said, project = _made(folder)
    assert "left out A9.jpg: it is the same picture as A2.jpg" in said
    assert len(project["photo"]) == 5


def test_two_flights_are_named_and_not_mixed(folder):
    for number in (6, 7):
        _photo(folder / f"A{number}.jpg", number, hour=15)
    said, _ = _made(folder)
    assert "2 flights or sessions by their times" in said


def test_another_camera_has_a_record_of_its_own(folder):
    _photo(folder / "B1.jpg", 8, model="OTHER CAM")
    _, project = _made(folder)
    assert {photo["name"]: photo["camera"] for photo in project["photo"]}["B1"] == "OTHER_CAM"
    assert len(project["camera"]) == 2


def test_control_of_a_table(folder):
    (folder.parent / "gcp.csv").write_text("name;X;Y;Z\nK1;10.0;20.0;3.0\nK2;11.5;22.0;3.5\n")
    _made(folder, "--control", "gcp.csv", "--control-error", "0.01")
    lines = (folder.parent / "made" / "made.PNT").read_text().splitlines()[1:]
    assert lines == ["K1 10.0 20.0 3.0 0.01 0.01 0.01", "K2 11.5 22.0 3.5 0.01 0.01 0.01"]
    for text, said in (
        ("K1;10.0;20.0\n", "bad.csv:1: a line has name X Y Z"),
        ("name;X;Y;Z\n", "bad.csv: there is no control point in this file"),
        ("id,Northing,Easting,Height\nK1,20.0,10.0,3.0\n", "bad.csv:1: the heading has north before east"),
    ):
        (folder.parent / "bad.csv").write_text(text)
        done = orip(folder.parent, "photos", folder.name, "other", "--control", "bad.csv")
        assert done.code == 3
        assert said in done.err
    assert not (folder.parent / "other").exists()


def test_nothing_is_written_over_a_project(folder):
    _made(folder)
    before = (folder.parent / "made" / "orip.toml").read_bytes()
    done = orip(folder.parent, "photos", folder.name, "made")
    assert done.code == 2
    assert (folder.parent / "made" / "orip.toml").read_bytes() == before


def test_a_folder_without_images(tmp_path):
    (tmp_path / "none").mkdir()
    assert "no image" in orip(tmp_path, "photos", "none").err
    assert orip(tmp_path, "photos", "missing").code == 3


def test_a_focal_length_with_a_floating_point_is_read(folder):
    for path in folder.iterdir():
        with Image.open(path) as picture:
            picture.load()
            exif = picture.getexif()
        exif.get_ifd(0x8769)[0x920A] = 24.0  # Pillow writes a double
        picture.save(path, quality=95, exif=exif)
    said, document = _made(folder)
    assert "focal length not in EXIF" not in said
    assert document["camera"][0]["c"] == pytest.approx(24.0, abs=0.01)


def test_a_crs_that_is_not_known_is_refused_before_anything_is_written(folder):
    done = orip(folder.parent, "photos", folder.name, "made", "--crs", "EPSG:99999")
    assert done.code != 0
    assert "EPSG:99999" in done.err
    assert not (folder.parent / "made").exists()


def test_a_new_project_of_a_folder_of_photographs(folder):
    done = orip(folder.parent, "new", "made", "--photos", folder.name)
    assert done.code == 0, done.err
    assert "next     orip -C" in done.err
    assert len(tomllib.loads((folder.parent / "made" / "orip.toml").read_text())["photo"]) == 5
    refused = orip(folder.parent, "new", "other", "--photos", folder.name, "--kind", "drone")
    assert refused.code == 2
    assert "give --crs alone" in refused.err
