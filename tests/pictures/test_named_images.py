"""Photos that name their images: what is said of those that are missing or of another size."""

from __future__ import annotations

import json
import re
import struct
import zlib
from pathlib import Path

import pytest
from cli.command_line import orip

PROJECT = """\
[project]
name = "IMAGES"

[[camera]]
name = "CAM"
c = 24.0
sensor = { columns = 600, rows = 400, width = 36.0, height = 24.0 }

[[photo]]
name = "GOOD"
camera = "CAM"
image = "pictures/good.png"

[[photo]]
name = "GONE"
camera = "CAM"
image = "pictures/gone.png"

[[photo]]
name = "TURNED"
camera = "CAM"
image = "pictures/turned.png"

[[photo]]
name = "NONE"
camera = "CAM"

[[bundle]]
name = "MAIN"
"""


def png(path: Path, columns: int, rows: int) -> None:
    """Write a black PNG without any library."""
    lines = zlib.compress(bytes((columns + 1) * rows))
    head = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", head), (b"IDAT", lines), (b"IEND", b"")]
    packed = [struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(packed))


@pytest.fixture
def project(tmp_path) -> Path:
    (tmp_path / "orip.toml").write_text(PROJECT)
    (tmp_path / "pictures").mkdir()
    png(tmp_path / "pictures" / "good.png", 600, 400)
    png(tmp_path / "pictures" / "turned.png", 400, 600)
    return tmp_path


@pytest.mark.parametrize("command", [["photo", "list"], ["status"]])
def test_images_that_cannot_be_used_are_named(project, command):
    assert orip(project, "init").code == 0
    done = orip(project, *command)
    assert done.code == 0
    assert re.search(r"photo GONE: its image pictures/gone.png is missing", done.err)
    assert re.search(r"photo TURNED: .* 400 x 600 pixels, and .* 600 x 400; it was turned", done.err)
    assert "GOOD" not in done.err
    assert "NONE" not in done.err


def test_an_image_of_two_photos_is_named(project):
    assert orip(project, "init").code == 0
    assert orip(project, "photo", "edit", "NONE", "image=pictures/good.png").code == 0
    assert "photo NONE: its image pictures/good.png is that of photo GOOD" in orip(project, "status").err


def test_status_names_them_before_init(project):
    assert "gone.png" in orip(project, "status").err


def test_the_name_goes_through_stores_and_back(project):
    assert orip(project, "init").code == 0
    rows = json.loads(orip(project, "photo", "list", "--json").out)["records"]
    assert [row.get("image") for row in rows] == ["pictures/good.png", "pictures/gone.png", "pictures/turned.png", None]
    assert orip(project, "photo", "edit", "NONE", "image=other.jpg").code == 0
    exported = orip(project, "export-toml")
    assert exported.code == 0
    assert 'name = "NONE"\ncamera = "CAM"\nimage = "other.jpg"\n' in exported.out


@pytest.mark.parametrize("image", ["", " ", "a\\u0000b.jpg", "a\\nb.jpg", "x" * 300 + ".jpg"])
def test_names_that_no_file_can_have(project, image):
    path = project / "orip.toml"
    path.write_text(PROJECT.replace("pictures/gone.png", image))
    done = orip(project, "init")
    assert done.code == 3
    assert re.search(r"orip.toml:17: image .*'?GONE'?", done.err)
