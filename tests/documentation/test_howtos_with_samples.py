"""What the how-tos of other programs' users say, done with genuine files of those programs."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cli.command_line import orip
from exchange.imported import sample

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]


def done(folder: Path, *words: str) -> str:
    """Run a command that has to succeed; return what it said."""
    said = orip(folder, *words)
    assert said.code == 0, said.err
    return said.err


def test_colmap(tmp_path: Path) -> None:
    shutil.copytree(sample("colmap", "sceaux-9-text"), tmp_path / "sceaux")
    assert "9 photos, 6319 points" in done(tmp_path, "adjust", "sceaux", "sceaux_adjusted")
    assert (tmp_path / "sceaux_adjusted" / "report.html").is_file()
    done(tmp_path, "import", "sceaux", "block")
    assert "CAMERA1" in done(tmp_path / "block", "run", "--no-report")
    done(tmp_path / "block", "export", "colmap", "out")
    assert "6319 points" in done(tmp_path, "import", "block/out", "again")


def test_opensfm_with_its_control_points(tmp_path: Path) -> None:
    given, folder = sample("opensfm", "berlin"), tmp_path / "berlin"
    folder.mkdir()
    for name, source in (
        ("reconstruction.json", "reconstruction_example.json"),
        ("tracks.csv", "tracks_example.csv"),
        ("ground_control_points.json", "ground_control_points.json"),
        ("config.yaml", "config.yaml"),
    ):
        shutil.copy(given / source, folder / name)
    # the control is of a reconstruction whose photos stood 2 m high, and these have the altitudes of a telephone
    said = done(tmp_path, "adjust", "berlin", "adjusted")
    assert "are 31.7 m higher than the control points say" in said
    assert "converged" in said
    assert "3 photos" in done(tmp_path / "adjusted", "export", "opensfm", "back")
    assert "3 photos" in done(tmp_path, "import", "adjusted/back", "again")


def test_metashape_without_tie_points(tmp_path: Path) -> None:
    shutil.copy(sample("metashape", "geograypher", "camera.xml"), tmp_path)
    assert "measurements are corrected by that" in done(tmp_path, "import", "camera.xml", "block")
    assert "has no photo points" in orip(tmp_path / "block", "run").err


def test_micmac(tmp_path: Path) -> None:
    shutil.copytree(sample("micmac", "MMVII-TestDir", "Input", "Saisies-MMV1"), tmp_path / "saisies")
    done(tmp_path, "adjust", "saisies/Ori-Ground_mm3d", "block")
    assert (tmp_path / "block" / "report.html").is_file()
    done(tmp_path / "block", "export", "micmac", "Ori-Orip")
    done(tmp_path, "import", "block/Ori-Orip", "again")
