"""A project with a fisheye camera from its texts to listing, report, updated text and drive table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from support.synthetic_block import SyntheticBlock, synthetic_block

PIXEL = 0.009
HALF = 18.0
UNKNOWN = ("C", "DX", "DY", "A3", "A5")


@pytest.fixture(scope="module")
def made() -> SyntheticBlock:
    distortion = (0.0, -4e-3, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return synthetic_block("room", "project", noise_mm=0.003, precision_mm=0.003, distortion=distortion)


@pytest.fixture(scope="module")
def room(made: SyntheticBlock, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight photos around a room in pixels, without any preliminary value; the camera without its calibration."""
    folder, block = tmp_path_factory.mktemp("room"), made.block
    photos = "\n".join(f'[[photo]]\nname = "{photo.name}"\ncamera = "FISHEYE"' for photo in block.photos)
    unknown = ", ".join(f'"{name}"' for name in UNKNOWN)
    (folder / "orip.toml").write_text(
        f'[project]\nname = "ROOM"\nground_unit = "m"\n[[camera]]\nname = "FISHEYE"\nprojection = "equidistant"\n'
        f"c = 9.1\nsensor = {{ columns = 4000, rows = 4000, width = 36.0, height = 36.0 }}\nunknown = [{unknown}]\n"
        f'{photos}\n[[bundle]]\nname = "MAIN"\nmeasurement_precision = 0.003\n'
    )
    points = block.photo_points
    pixels = (points.xy * [1.0, -1.0] + HALF) / PIXEL
    lines = []
    for row, photo in enumerate(block.photos):
        mine = points.photo == row
        names = (block.point_names[point] for point in points.point[mine])
        lines.append(f"POINTS MAIN {photo.name}")
        lines += [f"  {name} {x:.4f} {y:.4f}" for name, (x, y) in zip(names, pixels[mine].tolist(), strict=True)]
    (folder / "ROOM.MEA").write_text("\n".join(lines) + "\n")
    control = (
        f"{point.name} " + " ".join(f"{value:.5f}" for value in (*point.coordinates, *point.errors))
        for point in block.control_points
    )
    (folder / "ROOM.PNT").write_text("\n".join(control) + "\n")
    said = orip(folder, "run")
    assert said.code == 0, said.err
    return folder


def test_result_is_the_truth(room: Path, made: SyntheticBlock) -> None:
    result = json.loads((room / "result.json").read_text())
    assert result["status"] == "converged"
    assert result["sigma0"] == pytest.approx(1.0, abs=0.12)
    found = result["cameras"]["FISHEYE"]
    for name, value in zip(("C", "DX", "DY", "A1", "A3", "A5"), made.cameras[0], strict=False):
        if name in UNKNOWN:
            assert abs(found[name]["value"] - value) < 5.0 * found[name]["sd"]
    rays = sum(len(np.flatnonzero(made.block.photo_points.photo == row)) for row in range(8))
    assert result["observations"] >= 2 * rays


def test_the_text_takes_what_was_adjusted_and_keeps_the_projection(room: Path) -> None:
    adjusted = json.loads((room / "result.json").read_text())["cameras"]["FISHEYE"]["C"]["value"]
    assert orip(room, "update", "cameras").code == 0
    text = orip(room, "export-toml").out
    assert 'projection = "equidistant"' in text
    camera = orip(room, "camera", "show", "fisheye", "--json").document
    assert camera["record"]["c"] == pytest.approx(adjusted, rel=1e-12)
    assert camera["record"]["projection"] == "equidistant"


def test_the_drive_table_says_the_projection(room: Path) -> None:
    assert orip(room, "drive", "table").code == 0
    lines = (room / "MAIN.DRV").read_text().splitlines()
    assert any(line.startswith("CAMERA FISHEYE EQUIDISTANT 9.0") for line in lines)
