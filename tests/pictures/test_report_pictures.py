"""Photos and details of them in the report, of rendered photos with control points and a wrong measurement."""

from __future__ import annotations

import base64
import re
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from pictures.rendered_plane import RenderedPlane, project_text, render

from orip.pictures.report_pictures import CHIP_BYTES, THUMBNAIL_BYTES
from orip.report.report_input import CHIP_PIXELS

Images = pytest.importorskip("PIL.Image")

SIDE = 240
WRONG = 6.0
TOML = project_text(SIDE, "0.1px")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project of four photos with nine control points, one of them measured wrongly in P2."""
    folder = tmp_path_factory.mktemp("plane")
    random = np.random.default_rng(3)
    plane = render(4, SIDE, random)
    side = 1.4 * SIDE
    grid = [(x * side, y * side) for y in (0.3, 0.5, 0.7) for x in (0.3, 0.5, 0.7)]
    control = "".join(f"G{n} {x:.3f} {-y:.3f} 0.0 0.05 0.05 0.05\n" for n, (x, y) in enumerate(grid))
    (folder / "plane.PNT").write_text(control, encoding="utf-8")
    (folder / "MARKS.MEA").write_text(marks(plane, np.array(grid), random), encoding="utf-8")
    text = TOML
    for number, grey in enumerate(plane.photos):
        Images.fromarray(grey).save(folder / f"P{number}.jpg", quality=95)
        text += f'\n[[photo]]\nname = "P{number}"\ncamera = "C"\nimage = "P{number}.jpg"\n'
    (folder / "orip.toml").write_text(text, encoding="utf-8")
    assert (done := orip(folder, "run", "--no-report")).code == 0, done.err
    return folder


def marks(plane: RenderedPlane, grid: np.ndarray, random: np.random.Generator) -> str:
    text = ""
    for photo in range(len(plane.photos)):
        text += f"POINTS MAIN P{photo}\n"
        for number, (x, y) in enumerate(plane.pixels(photo, grid) + 0.1 * random.standard_normal(grid.shape)):
            text += f"  G{number} {x + WRONG * (photo == 2 and number == 4):.3f} {y:.3f}\n"
    return text


def reported(project: Path, *options: str) -> str:
    done = orip(project, "report", *options)
    assert done.code == 0, done.err
    return (project / "report.html").read_text(encoding="utf-8")


def pictures(page: str) -> list[bytes]:
    return [base64.b64decode(data) for data in re.findall(r"data:image/jpeg;base64,([^\"]*)", page)]


def test_each_photo_and_each_control_point_is_shown(project: Path) -> None:
    page = reported(project)
    sizes = [Images.open(BytesIO(data)).size for data in pictures(page)]
    assert sizes.count((SIDE, SIDE)) == 4
    assert sizes.count((CHIP_PIXELS, CHIP_PIXELS)) == 4 * 9 + 10
    assert all(len(data) <= max(THUMBNAIL_BYTES, CHIP_BYTES) for data in pictures(page))
    worst = re.findall(r"<h3>The photo points with the largest.*?aria-label=\"(.*?)\"", page, re.DOTALL)
    assert worst[0].startswith("Point G4 in photo P2: v ")


def test_a_cross_is_where_the_point_was_measured(project: Path) -> None:
    page = reported(project)
    chip = re.search(
        r"Point G4 in photo P2.*?<path d=\"M(\S+) (\S+?)l.*?<circle cx=\"(\S+)\" cy=\"(\S+)\"", page, re.DOTALL
    )
    assert chip is not None
    x, y, u, v = map(float, chip.groups())
    off = float(re.search(r"Point G4 in photo P2: v (\S+) px", page)[1])  # type: ignore[index]
    # drawn twice as large as the image; the arm begins 4 beside the middle
    assert np.hypot(x - 4.0 - u, y - v) == pytest.approx(2.0 * off, abs=0.3)
    assert 0.7 * WRONG < off <= WRONG + 0.5


def test_a_report_without_pictures_is_as_before(project: Path) -> None:
    page = reported(project, "--no-pictures")
    assert not pictures(page)
    assert "largest normalised residuals" not in page


def test_an_image_that_is_missing_is_named(project: Path) -> None:
    (project / "P1.jpg").rename(project / "away.jpg")
    try:
        page = reported(project)
    finally:
        (project / "away.jpg").rename(project / "P1.jpg")
    assert "No image is shown of P1: their images are missing or cannot be used." in page
    assert len(pictures(page)) < 4 + 4 * 9 + 10


def test_without_the_package_the_report_says_what_to_install(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    page = reported(project)
    assert not pictures(page)
    assert "No image is shown of P0, P1, P2 and 1 more: images are read with Pillow" in page
