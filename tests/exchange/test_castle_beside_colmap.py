"""The castle of Sceaux, a model of COLMAP: adjusted, written back, and compared with COLMAP's own adjustment."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from documentation.pages import REPOSITORY
from exchange.colmap_samples import genuine

from orip.records.results.solution import Solution
from orip.workflow.project.bundle_state import read_bundle

PIXEL_MM = 36.0 / 2832.0
HELD = ("T895", "T470", "T558")
"""Points with eight rays and more, far from one another."""


@pytest.fixture(scope="module")
def castle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("castle")
    genuine("sceaux-9-text", folder / "given")
    said = orip(folder, "adjust", "given", "new")
    assert said.code == 0, said.err
    return folder


def beside(model: Path, *points: str) -> dict[str, object]:
    """Return what COLMAP has of a model, with some points held; skip the test where pycolmap is not installed."""
    bench = REPOSITORY / ".venv-bench" / "bin" / "python"
    python = sys.executable if importlib.util.find_spec("pycolmap") else str(bench)
    if python == str(bench) and not bench.exists():
        pytest.skip("pycolmap is not installed; 'make bench' makes an environment that has it")
    numbers = [point.removeprefix("T") for point in points]
    command = [python, str(Path(__file__).with_name("pycolmap_peer.py")), str(model), *numbers]
    found: dict[str, object] = json.loads(subprocess.run(command, check=True, capture_output=True, timeout=300).stdout)
    return found


def solution_of(project: Path) -> Solution:
    return read_bundle(project, None, "heads", "solutions").adjusted


def test_no_line_changes_but_those_of_poses(castle: Path) -> None:
    out = castle / "new" / "colmap_adjusted"
    before, after = ((folder / "images.txt").read_bytes().split(b"\n") for folder in (castle / "given", out))
    changed = [n for n, (one, other) in enumerate(zip(before, after, strict=True)) if one != other]
    # the poses of the nine photos, and no line of keypoints
    assert changed == list(range(4, 4 + 2 * 9, 2))


def test_the_largest_misfits_are_named(castle: Path) -> None:
    found = solution_of(castle / "new").residuals
    largest = int(np.nanargmax(np.abs(found.w)))
    text = (castle / "new" / "BUNDLE_ERROR.OUT").read_text(encoding="utf-8")
    assert found.photo[largest] in text
    assert found.point[largest] in text


def test_colmap_opens_what_was_written_and_finds_nothing_to_improve(castle: Path) -> None:
    theirs = beside(castle / "new" / "colmap_adjusted")
    assert theirs["counts"] == [9, 6319, 25548]
    assert theirs["mean"] == pytest.approx(theirs["stated"], rel=1e-9)
    assert theirs["final_cost"] == pytest.approx(theirs["initial_cost"], rel=1e-10)
    solution = solution_of(castle / "new")
    assert 2.0 * theirs["final_cost"] == pytest.approx(solution.sigma0_all**2 * solution.redundancy, rel=1e-9)
    # a camera's parameters do not depend on the datum: a free network, or one photo and a coordinate that are held
    assert _camera_deviations(solution) == pytest.approx(np.sqrt(np.diag(theirs["cameras"][0])), rel=1e-5)


def test_precision_is_that_of_colmap_where_the_datum_is_the_same(castle: Path, tmp_path: Path) -> None:
    """Three points are held in both programs: the same observations, unknowns and constants."""
    assert orip(castle, "import", "colmap", "given", str(tmp_path / "held")).code == 0
    text = (tmp_path / "held" / "orip.toml").read_text(encoding="utf-8")
    (tmp_path / "held" / "orip.toml").write_text(text.replace('datum = "free"', 'datum = "control"'), encoding="utf-8")
    points = dict(line.split(maxsplit=1) for line in (tmp_path / "held" / "MAIN.PRE").read_text().splitlines() if line)
    (tmp_path / "held" / "given.PNT").write_text("".join(f"{name} {points[name]} 0 0 0\n" for name in HELD))
    said = orip(tmp_path / "held", "run", "--no-report")
    assert said.code == 0, said.err
    solution = solution_of(tmp_path / "held")
    theirs = beside(castle / "given", *HELD)
    assert 2.0 * theirs["final_cost"] == pytest.approx(solution.sigma0_all**2 * solution.redundancy, rel=1e-9)
    assert _camera_deviations(solution) == pytest.approx(np.sqrt(np.diag(theirs["cameras"][0])), rel=1e-5)
    place = {name: n for n, name in enumerate(solution.photos.names)}
    assert len(theirs["photos"]) == 9
    for name, (rotation, translation, covariance) in theirs["photos"].items():
        # COLMAP's rotations change by the vector part of a quaternion, half a rotation vector (Ceres' manifold)
        r, (x, y, z) = np.array(rotation), translation
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        partials = np.hstack([-2.0 * r.T @ across, -r.T])  # of the projection centre -R^T t
        theirs_sd = np.sqrt(np.diag(partials @ np.array(covariance) @ partials.T))
        ours = solution.photos.sd[place[Path(name).stem], :3] / solution.sigma0_all
        assert ours == pytest.approx(theirs_sd, rel=1e-5)


def _camera_deviations(solution: Solution) -> np.ndarray:
    """Return the standard deviations of COLMAP's f and k, which C and A3 are, for a sigma0 of 1."""
    c, _, _, _, a3 = solution.cameras.values[0, :5]
    of_c, of_a3 = solution.cameras.sd[0, [0, 4]] / solution.sigma0_all
    # k = A3 C²; C and A3 correlate
    correlation = next(
        (pair.r for pair in solution.correlations if {pair.a.split(".")[-1], pair.b.split(".")[-1]} == {"C", "A3"}),
        None,
    )
    if correlation is None:
        pytest.skip("the correlation of C and A3 is not listed")
    by_c, by_a3 = 2.0 * a3 * c * of_c, c**2 * of_a3
    of_k = np.sqrt(by_c**2 + by_a3**2 + 2.0 * correlation * by_c * by_a3)
    return np.array([of_c / PIXEL_MM, of_k])
