"""`[[terrain]]` from the command line: heights out of a GeoTIFF, and what is wrong with one."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from support.strips_project import StripsProject, strips_project

rasterio = pytest.importorskip("rasterio")

PIXELS, SIZE = 40, 5.0


@pytest.fixture(scope="module")
def made() -> StripsProject:
    return strips_project(0.002)


@pytest.fixture(scope="module")
def lying(made: StripsProject) -> tuple[str, np.ndarray]:
    """Return a tie point, and its true coordinates: the terrain is level at its height."""
    name = next(name for name in made.common("P1", "P2") if name not in made.control)
    return name, np.array(made.points[name])


@pytest.fixture(scope="module")
def adjusted(made: StripsProject, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = made.write(tmp_path_factory.mktemp("terrain") / "strips")
    said = orip(folder, "run", "--quiet")
    assert said.code == 0, said.err
    return folder


@pytest.fixture
def folder(adjusted: Path, tmp_path: Path) -> Path:
    return shutil.copytree(adjusted, tmp_path / "strips")


def with_terrain(folder: Path, **keys: str) -> None:
    lines = {"name": '"DTM"', "file": '"dtm.tif"', "error": "0.01", **keys}
    text = "\n".join(["", "[[terrain]]", *(f"{key} = {value}" for key, value in lines.items() if value), ""])
    with (folder / "orip.toml").open("a") as file:
        file.write(text)


def write_raster(path: Path, heights: np.ndarray, *, crs: str | None = None, placed: bool = True) -> None:
    transform = rasterio.Affine(SIZE, 0.0, -60.0, 0.0, -SIZE, 120.0) if placed else rasterio.Affine.identity()
    with rasterio.open(
        path, "w", driver="GTiff", width=heights.shape[1], height=heights.shape[0], count=1, dtype="float64",
        nodata=-9999.0, crs=crs, transform=transform,
    ) as target:  # fmt: skip
        target.write(heights, 1)


def result(folder: Path) -> dict:
    return json.loads((folder / "result.json").read_text())


def test_a_height_is_observed_tested_and_listed(folder: Path, lying) -> None:
    name, place = lying
    before = result(folder)["points"][name]
    write_raster(folder / "dtm.tif", np.full((PIXELS, PIXELS), place[2]))
    with_terrain(folder, points=f'["{name}"]')
    assert "out of date" in orip(folder, "status").out
    said = orip(folder, "solve")
    assert said.code == 0, said.err
    after = result(folder)["points"][name]
    assert after["Z"]["sd"] < 0.9 * before["Z"]["sd"]
    assert abs(after["Z"]["value"] - place[2]) < 4.0 * after["Z"]["sd"]
    (group,) = [group for group in result(folder)["groups"] if group["kind"] == "terrain"]
    assert (group["of"], group["number"]) == ("DTM", 1)
    assert any(line.startswith("terrain,DTM," + name) for line in (folder / "residuals.csv").read_text().splitlines())
    assert "up to date" in next(line for line in orip(folder, "status").out.splitlines() if "orip solve" in line)
    write_raster(folder / "dtm.tif", np.full((PIXELS, PIXELS), place[2] + 0.001))
    assert "changed since: dtm.tif" in orip(folder, "status").out


def test_integers_with_a_scale_are_heights(folder: Path, lying) -> None:
    name, place = lying
    with rasterio.open(
        folder / "dtm.tif", "w", driver="GTiff", width=PIXELS, height=PIXELS, count=1, dtype="int32",
        transform=rasterio.Affine(SIZE, 0.0, -60.0, 0.0, -SIZE, 120.0),
    ) as target:  # fmt: skip
        target.write(np.full((PIXELS, PIXELS), round(place[2] * 1000.0) - 50_000), 1)
        target.scales, target.offsets = (0.001,), (50.0,)
    with_terrain(folder, points=f'["{name}"]')
    assert orip(folder, "solve").code == 0
    assert result(folder)["points"][name]["Z"]["value"] == pytest.approx(place[2], abs=0.02)


def test_points_without_a_height_are_named(folder: Path, lying) -> None:
    name, place = lying
    heights = np.full((PIXELS, PIXELS), place[2])
    heights[:, 4:] = -9999.0
    write_raster(folder / "dtm.tif", heights)
    with_terrain(folder, points=f'["{name}"]')
    said = orip(folder, "solve")
    assert said.code == 0
    assert f"none of the points that should lie on it have a height: dtm.tif has none at {name}" in said.err


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize(
    ("prepare", "message"),
    [
        (lambda _: None, "dtm.tif: there is no such file"),
        (lambda path: path.write_text("no raster"), "dtm.tif: this is no raster that can be read"),
        (lambda path: path.mkdir(), "dtm.tif"),
        (lambda path: write_raster(path, np.ones((9, 9)), placed=False), "does not say where it lies"),
        (lambda path: write_raster(path, np.ones((3, 9))), "has 9 by 3 pixels"),
        (lambda path: write_raster(path, np.full((9, 9), -9999.0)), "0 of them with a height"),
    ],
)
def test_a_file_that_is_no_terrain_is_refused(folder: Path, prepare, message) -> None:
    prepare(folder / "dtm.tif")
    with_terrain(folder)
    before = (folder / "result.json").read_bytes()
    said = orip(folder, "solve")
    assert said.code == 3
    assert message in said.err
    assert "Traceback" not in said.err
    assert (folder / "result.json").read_bytes() == before


def test_keys_are_checked(folder: Path) -> None:
    with_terrain(folder, error="-1.0", plan="3")
    with_terrain(folder, file="")
    said = orip(folder, "solve")
    assert said.code == 3
    for message in ("error of terrain 'DTM' is -1", "has the unknown key 'plan'", "file"):
        assert message in said.err


def test_raster_and_project_have_one_system(folder: Path) -> None:
    text = (folder / "orip.toml").read_text()
    (folder / "orip.toml").write_text(text.replace('name = "STRIPS"', 'name = "STRIPS", crs = "EPSG:25832"', 1))
    write_raster(folder / "dtm.tif", np.ones((9, 9)), crs="EPSG:25833")
    with_terrain(folder)
    said = orip(folder, "solve")
    assert said.code == 3
    assert "UTM zone 33N, those of the project in ETRS89 / UTM zone 32N" in said.err
