"""Photos on film in formats that measure in millimetres."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from exchange.imported import read_well, reprojected

from orip.exchange.formats import format_named
from orip.exchange.project.exported import EXPORTED_FROM
from orip.records.observation_kinds import PHOTO_POINT
from orip.workflow.project.bundle_state import read_bundle


@pytest.fixture(scope="module")
def cliff(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("film")
    assert orip(folder, "init", "--sample", "small_frame_block", "cliff").code == 0
    assert orip(folder / "cliff", "run", "--no-report").code == 0
    return folder / "cliff"


@pytest.mark.parametrize("name", ["bingo", "patb"])
def test_film_has_the_residuals_of_the_adjustment(cliff: Path, tmp_path: Path, name: str) -> None:
    said = orip(cliff, "export", name, str(tmp_path / name), "--exact-distortion")
    assert said.code == 0, said.err
    read = format_named(name).read
    assert read is not None
    found, is_declared = reprojected(read_well(read, tmp_path / name))
    assert is_declared
    solution = read_bundle(cliff, None, *EXPORTED_FROM).adjusted
    residuals = solution.residuals
    rows = [n for n, kind in enumerate(residuals.kind) if kind == PHOTO_POINT.name]
    lengths = np.hypot(*residuals.residual[rows].reshape(-1, 2).T)
    assert len(found.lengths) == len(lengths)
    found_mm = 0.01 * found.lengths  # of the pixels that stand for millimetres
    # the distortion that measurements are corrected for stretches a residual by a few per cent
    assert np.median(found_mm) == pytest.approx(np.median(lengths), rel=0.05)
    if name == "bingo":  # PAT-B has no adjusted points: they are intersected, and blunders move them
        assert np.sort(found_mm) == pytest.approx(np.sort(lengths), rel=0.05, abs=2e-4)


def test_other_formats_refuse_film_by_name(cliff: Path, tmp_path: Path) -> None:
    said = orip(cliff, "export", "colmap", str(tmp_path / "a"))
    assert said.code != 0
    assert "export film as bingo or patb" in said.err
