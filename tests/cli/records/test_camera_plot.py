"""`orip camera plot`: the distortion curve in characters and as numbers."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from workflow.small_projects import REPOSITORY, first_project, replace_in

RADII = np.linspace(1.0, 16.0, 16)
A1, A3, A5, A7 = 2e-4, -3e-6, 1e-8, -2e-11


def project(folder: Path, form: str) -> Path:
    first_project(folder)
    replace_in(folder / "orip.toml", "c = 35.0", f"{form}\nc = 35.0")
    assert orip(folder, "init").code == 0
    return folder


@pytest.fixture
def curve(tmp_path: Path) -> Path:
    """A camera given by a curve of 16 points, one of them off by 3 µm."""
    distortion = A1 * RADII + A3 * RADII**3 + A5 * RADII**5 + A7 * RADII**7
    distortion[7] += 0.003
    points = ", ".join(
        f"[{radius!r}, {value!r}]" for radius, value in zip(RADII.tolist(), distortion.tolist(), strict=True)
    )
    return project(tmp_path / "curve", f"distortion_curve = [{points}]")


def test_numbers_are_those_of_the_polynomial_and_the_residuals_of_a_least_squares_fit(curve: Path) -> None:
    document = orip(curve, "camera", "plot", "c35", "--json").document
    assert (document["camera"], document["form"]) == ("C35", "curve")
    # the same curve in the ISP form: no distortion at R0
    r0 = document["isp"]["R0"]
    assert r0 > 0.0
    assert sum(
        value * r0**power for value, power in zip(document["polynomial"].values(), (1, 3, 5, 7, 9), strict=True)
    ) == (pytest.approx(0.0, abs=1e-12))
    given = np.array([[row["radius"], row["given"], row["residual"]] for row in document["curve"]])
    # numpy's fit of the same points, with radii in units of 16 mm
    design = (RADII[:, None] / 16.0) ** [1, 3, 5, 7]
    fitted = design @ np.linalg.lstsq(design, given[:, 1], rcond=None)[0]
    assert np.allclose(given[:, 2], fitted - given[:, 1], atol=1e-12)
    assert np.argmax(np.abs(given[:, 2])) == 7
    radius, distortion = np.array(document["radius"]), np.array(document["distortion"])
    a = document["polynomial"]
    by_hand = radius * (a["A1"] + radius**2 * (a["A3"] + radius**2 * (a["A5"] + radius**2 * a["A7"])))
    assert np.allclose(distortion, by_hand, atol=1e-15)
    # to the corner of the 36 x 24 mm sensor
    assert radius[-1] == pytest.approx(np.hypot(18.0, 12.0))


def test_plot_shows_curve_points_and_residuals(curve: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    said = orip(curve, "camera", "plot", "C35")
    assert said.code == 0
    lines = said.out.splitlines()
    assert lines[0] == "D (µm), camera C35"
    assert max(map(len, lines)) <= 100
    drawing = "\n".join(lines[1:16])
    assert drawing.count("•") + drawing.count("◇") > 70
    assert 10 <= drawing.count("◇") <= 16  # two points may fall on one place
    assert "R (mm)" in lines[17]
    assert "RMS of the residuals 0.000" in lines[-1]
    assert said.out == orip(curve, "camera", "plot", "C35").out
    assert "\x1b" not in orip(curve, "--color", "always", "camera", "plot", "C35").out


def test_plot_in_plain_characters_fits_a_narrow_terminal(curve: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    out = orip(curve, "camera", "plot", "C35", "--ascii").out
    assert out.isascii()
    assert max(map(len, out.splitlines()[:18])) <= 60
    assert "*" in out
    assert "o" in out.split("\n", 1)[1]


def test_isp_form_is_shown_beside_its_polynomial(tmp_path: Path) -> None:
    folder = project(tmp_path / "isp", "distortion_isp = { R0 = 10.0, A1 = 1.0e-5, A2 = -2.0e-8, A3 = 3.0e-11 }")
    document = orip(folder, "camera", "plot", "C35", "--radius", "10", "--json").document
    assert document["form"] == "isp"
    assert document["isp"] == {"R0": 10.0, "A1": 1e-5, "A2": -2e-8, "A3": 3e-11}
    assert document["polynomial"]["A1"] == pytest.approx(-(1e-5 * 1e2 - 2e-8 * 1e4 + 3e-11 * 1e6), rel=1e-15)
    # the radius R0 has no distortion
    assert document["distortion"][-1] == pytest.approx(0.0, abs=1e-17)
    out = orip(folder, "camera", "plot", "C35").out
    assert "ISP form:" in out
    assert "R0 = 10" in out


def test_camera_without_distortion_is_a_line(tmp_path: Path) -> None:
    folder = project(tmp_path / "none", "frame = [36.0, 24.0]")
    assert orip(folder, "camera", "plot", "C35", "--json").document["form"] == "polynomial"
    out = orip(folder, "camera", "plot", "C35", "--ascii").out
    assert out.splitlines()[8].startswith(" 0 |***")


def test_what_cannot_be_plotted(curve: Path, tmp_path: Path) -> None:
    said = orip(curve, "camera", "plot", "C36")
    assert said.code == 2
    assert "there is no camera C36; did you mean C35?" in said.err
    assert orip(curve, "camera", "plot", "C35", "--radius", "0").code == 2
    assert orip(curve, "camera", "plot", "C35", "--radius", "nan").code == 2
    bare = first_project(tmp_path / "bare")
    said = orip(bare, "camera", "plot", "C35")
    assert said.code == 3
    assert "run 'orip init' first" in said.err
    text = (bare / "orip.toml").read_text()
    (bare / "orip.toml").write_text("".join(line for line in text.splitlines(True) if not line.startswith("sensor")))
    replace_in(bare / "orip.toml", '"0.5px"', "0.003")
    assert orip(bare, "init").code == 0
    said = orip(bare, "camera", "plot", "C35")
    assert said.code == 2
    assert "give the radius in mm with --radius" in said.err


def test_after_an_adjustment_the_adjusted_curve_is_plotted(tmp_path: Path) -> None:
    folder = shutil.copytree(REPOSITORY / "sample_projects" / "small_frame_block", tmp_path / "cliff")
    assert orip(folder, "run", "--no-report").code == 0
    before = orip(folder, "camera", "plot", "reflex35", "--stored", "--json").document
    after = orip(folder, "camera", "plot", "reflex35", "--json").document
    assert (before["bundle"], after["bundle"]) == (None, "MAIN")
    (camera,) = json.loads((folder / "result.json").read_text())["cameras"].values()
    assert after["polynomial"]["A3"] == camera["A3"]["value"] != before["polynomial"]["A3"]
    assert "adjusted in bundle MAIN" in orip(folder, "camera", "plot", "reflex35").out
