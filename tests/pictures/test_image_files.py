"""Reading image files: the pixels as they are stored, by regions and made smaller, and files that cannot be used."""

from __future__ import annotations

import io
import resource
import struct
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from orip.errors import InputError
from orip.images.image_files import read_colours, read_grey, read_header

Image = pytest.importorskip("PIL.Image")
cv2 = pytest.importorskip("cv2")

ROWS, COLUMNS = 150, 203
FORMATS = {
    "strips.tif": {"compression": None},
    "lzw.tif": {"compression": "tiff_lzw"},
    "deflate.tif": {"compression": "tiff_adobe_deflate", "tiffinfo": {317: 2}},
    "jpeg.tif": {"compression": "jpeg"},
    "plain.png": {},
    "plain.jpg": {"quality": 95},
}


def _grey(bits: int = 8) -> np.ndarray:
    rows, columns = np.mgrid[:ROWS, :COLUMNS]
    wave = 0.5 + 0.25 * np.sin(columns / 9.0) + 0.25 * np.cos(rows / 7.0 + columns / 40.0)
    return np.rint(wave * (2**bits - 1)).astype(np.uint16 if bits == 16 else np.uint8)


@pytest.fixture(params=FORMATS)
def written(request, tmp_path) -> Path:
    path = tmp_path / request.param
    Image.fromarray(_grey()).save(path, **FORMATS[request.param])
    return path


def _error(path: Path, read=read_grey) -> str:
    with pytest.raises(InputError) as caught:
        read(path, shown=path.name)
    (complaint,) = caught.value.complaints
    assert complaint.path == path.name
    return complaint.message


def test_pixels_are_those_that_were_written(written):
    header = read_header(written)
    assert (header.columns, header.rows, header.bits, header.channels) == (COLUMNS, ROWS, 8, 1)
    lost = 4 if "jp" in written.name else 0
    np.testing.assert_allclose(read_grey(written).astype(int), _grey(), atol=lost)


def test_a_region_has_the_pixels_of_the_whole(written):
    whole = read_grey(written)
    np.testing.assert_array_equal(read_grey(written, ((37, 99), (11, 140))), whole[37:99, 11:140])
    np.testing.assert_array_equal(read_grey(written, ((-5, 400), (190, 400))), whole[:, 190:])


@pytest.mark.parametrize("reduction", [2, 4, 8])
def test_what_is_made_smaller_has_the_means_at_their_places(written, reduction):
    small = read_grey(written, None, reduction)
    whole = _grey().astype(float)
    assert small.shape == (-(-ROWS // reduction), -(-COLUMNS // reduction))
    inside = (ROWS // reduction, COLUMNS // reduction)
    means = whole[: inside[0] * reduction, : inside[1] * reduction]
    means = means.reshape(inside[0], reduction, inside[1], reduction).mean(axis=(1, 3))
    # half a pixel beside would show as 3 grey values and more; JPEG leaves out coefficients
    difference = small[: inside[0], : inside[1]] - means
    assert np.sqrt(np.mean(difference**2)) < 1.6
    part = read_grey(written, ((5 * reduction, 10 * reduction), (2 * reduction, 12 * reduction)), reduction)
    np.testing.assert_array_equal(part, small[5:10, 2:12])


@pytest.mark.parametrize("ending", ["png", "tif"])
@pytest.mark.parametrize("is_colour", [False, True])
def test_sixteen_bits_are_kept(tmp_path, ending, is_colour):
    path = tmp_path / f"deep.{ending}"
    grey = _grey(16)
    colours = np.stack([grey, grey[::-1], np.full_like(grey, 1000)], axis=2) if is_colour else grey
    assert cv2.imwrite(str(path), colours)
    header = read_header(path)
    assert (header.columns, header.rows, header.bits, header.channels) == (COLUMNS, ROWS, 16, 3 if is_colour else 1)
    found = read_grey(path)
    # OpenCV writes blue, green, red
    expected = 0.114 * grey + 0.587 * grey[::-1] + 0.299 * 1000.0 if is_colour else grey
    assert found.dtype == np.uint16
    np.testing.assert_allclose(found, expected, atol=1.0)
    np.testing.assert_array_equal(read_grey(path, ((20, 90), (50, 60))), found[20:90, 50:60])


def test_white_as_zero_is_turned(tmp_path):
    for bits in (8, 16):
        path = tmp_path / f"white{bits}.tif"
        Image.fromarray(2**bits - 1 - _grey(bits)).save(path)
        data = bytearray(path.read_bytes())
        entry = data.find(struct.pack("<HHI", 262, 3, 1))
        assert entry > 0
        data[entry + 8 : entry + 10] = b"\0\0"
        path.write_bytes(data)
        np.testing.assert_array_equal(read_grey(path), _grey(bits))


@pytest.mark.parametrize(("kind", "depth"), [("deflate", "uint8"), ("lzw", "uint16"), (None, "uint16")])
def test_tiles_written_by_gdal(tmp_path, kind, depth):
    rasterio = pytest.importorskip("rasterio")
    path, grey = tmp_path / "tiled.tif", _grey(16 if depth == "uint16" else 8)
    profile = {"driver": "GTiff", "width": COLUMNS, "height": ROWS, "count": 1, "dtype": depth}
    tiles = {"tiled": True, "blockxsize": 64, "blockysize": 48, **({"compress": kind, "predictor": 2} if kind else {})}
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning), rasterio.open(path, "w", **profile, **tiles) as file:
        file.write(grey, 1)
    np.testing.assert_array_equal(read_grey(path), grey)
    np.testing.assert_array_equal(read_grey(path, ((60, 100), (120, 203))), grey[60:100, 120:203])


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_nothing_is_turned_by_the_orientation(tmp_path, orientation):
    exif = Image.Exif()
    exif[274] = orientation
    for ending in ("jpg", "png", "tif"):
        path = tmp_path / f"turned.{ending}"
        Image.fromarray(_grey()).save(path, exif=exif)
        assert read_header(path).orientation == orientation
        np.testing.assert_allclose(read_grey(path).astype(int), _grey(), atol=12)


def test_colours_are_weighted_as_in_jpeg(tmp_path):
    colours = np.random.default_rng(1).integers(0, 255, (ROWS, COLUMNS, 3)).astype(np.uint8)
    for ending in ("png", "tif"):
        Image.fromarray(colours).save(tmp_path / f"colour.{ending}")
        found = read_grey(tmp_path / f"colour.{ending}")
        np.testing.assert_allclose(found, colours @ np.array([0.299, 0.587, 0.114]), atol=1.0)
    np.testing.assert_array_equal(read_colours(tmp_path / "colour.png"), colours)


def _png_head(columns: int, rows: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")


def _bytes(kind: str) -> bytes:
    file = io.BytesIO()
    Image.fromarray(_grey()).save(file, kind)
    return file.getvalue()


def _animated(path: Path) -> None:
    frames = [Image.fromarray(_grey()), Image.fromarray(255 - _grey())]
    frames[0].save(path, save_all=True, append_images=frames[1:])


def _is_a_folder(path: Path) -> None:
    path.mkdir()


UNUSABLE = {
    "cut.jpg": (lambda path: path.write_bytes(_bytes("JPEG")[:-500]), "cut off"),
    "cut.png": (lambda path: path.write_bytes(_bytes("PNG")[:-200]), "cut off"),
    "cut.tif": (lambda path: path.write_bytes(_bytes("TIFF")[:9000]), "cut off"),
    "one.png": (lambda path: path.write_bytes(_png_head(1, 1)), "1 x 1 pixels"),
    "huge.png": (lambda path: path.write_bytes(_png_head(100_000, 100_000)), "200 megapixels"),
    "printer.jpg": (lambda path: Image.fromarray(_grey()).convert("CMYK").save(path), "CMYK"),
    "printer.tif": (lambda path: Image.fromarray(_grey()).convert("CMYK").save(path), "CMYK"),
    "moving.png": (_animated, "animated"),
    "moving.gif": (_animated, "no JPEG, PNG or TIFF"),
    "pages.tif": (_animated, "several pages"),
    "floats.tif": (lambda path: Image.fromarray(_grey().astype(np.float32)).save(path), "whole numbers"),
    "folder.jpg": (_is_a_folder, "this is a folder"),
    "empty.jpg": (lambda path: path.write_bytes(b""), "empty"),
    "text.jpg": (lambda path: path.write_bytes(b"no image at all, but long enough"), "no JPEG, PNG or TIFF"),
    "head.jpg": (lambda path: path.write_bytes(b"\xff\xd8\xff\xe1\xff\xffExif\0\0II*\0\xff\xff\xff\xff"), "cut off"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNUSABLE)
def test_one_sentence_on_a_file_that_cannot_be_used(tmp_path, name):
    path = tmp_path / name
    make, said = UNUSABLE[name]
    make(path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for read in (read_header, read_grey):
        assert said in _error(path, read)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


def test_pixels_that_are_damaged(tmp_path):
    path = tmp_path / "damaged.png"
    Image.fromarray(_grey()).save(path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 20] = bytes(20)
    path.write_bytes(data)
    assert read_header(path).columns == COLUMNS
    assert "cannot be decoded" in _error(path)


@pytest.mark.parametrize("name", FORMATS)
def test_damage_of_any_kind_is_said(tmp_path, name):
    path = tmp_path / name
    Image.fromarray(_grey()).save(path, **FORMATS[name])
    data = path.read_bytes()
    generator = np.random.default_rng(5)
    for _ in range(60):
        damaged = bytearray(data[: generator.integers(4, len(data))] if generator.random() < 0.3 else data)
        for place in generator.integers(0, min(len(damaged), 400), 4):
            damaged[place] = generator.integers(256)
        path.write_bytes(damaged)
        # an array, or the one error that is meant for it: anything else fails the test
        with suppress(InputError):
            assert read_grey(path).ndim == 2


def test_a_region_of_a_large_tiff_takes_the_memory_of_the_region(tmp_path):
    path = tmp_path / "large.tif"
    rows, columns = 12_000, 10_000
    head = {256: columns, 257: rows, 258: 8, 259: 1, 262: 1, 273: 0, 277: 1, 278: 100, 279: 0}
    strips = rows // 100
    start = 8 + 2 + 12 * len(head) + 4
    with path.open("wb") as file:
        head[273], head[279] = start, start + 4 * strips
        file.write(b"II*\0" + struct.pack("<IH", 8, len(head)))
        for tag, value in head.items():
            file.write(struct.pack("<HHII", tag, 4, strips if tag in (273, 279) else 1, value))
        file.write(bytes(4))
        pixels = start + 8 * strips
        file.write(struct.pack(f"<{strips}I", *(pixels + n * 100 * columns for n in range(strips))))
        file.write(struct.pack(f"<{strips}I", *[100 * columns] * strips))
        file.seek(pixels + 5_050 * columns)
        file.write(b"\x80" * columns)
        file.truncate(pixels + rows * columns)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    part = read_grey(path, ((5_000, 5_100), (400, 500)))
    assert (part[50] == 128).all()
    assert part.sum() == 128 * 100
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 40_000  # kB; the image has 120 MB


def test_a_region_that_is_none(tmp_path):
    path = tmp_path / "plain.png"
    Image.fromarray(_grey()).save(path)
    for region, reduction in [(((5, 5), (0, 9)), 1), (((1, 9), (0, 8)), 2), (((500, 600), (0, 9)), 1), (None, 3)]:
        with pytest.raises(ValueError, match=r"region|multiples|smaller"):
            read_grey(path, region, reduction)
