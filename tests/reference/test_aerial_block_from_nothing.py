"""The published aerial block without its stations: the chain finds where the adjustment starts."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from cli.command_line import orip
from reference.aerial_project import camera_text, control, marks
from reference.comparison import assert_key_figures, assert_orientations
from reference.published_data import ORIENTATION, data_set, read_report
from reference.published_projects import Project


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    source = data_set("dbat-sxb-aerial")
    photos = read_report(source / "result" / "report.txt").photos
    nothing = {name: [0.0] * len(ORIENTATION) for name in photos}
    project = Project(
        camera_text(), nothing, marks(source / "measurements"), control(source / "reference" / "sxb-control.txt"),
        bundle='measurement_precision = "1px"',
    )  # fmt: skip
    folder = project.write(tmp_path_factory.mktemp("aerial") / "project")
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    (folder / "orip.toml").write_text(
        re.sub(rf"^({'|'.join(ORIENTATION)}) = .*\n", "", text, flags=re.MULTILINE), encoding="utf-8"
    )
    return folder


def test_the_adjustment_is_the_published_one(folder: Path) -> None:
    said = orip(folder, "run")
    assert said.code == 0, said.err
    assert "preliminary values were missing: 5 of 5 photos oriented" in said.err
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    report = read_report(data_set("dbat-sxb-aerial") / "result" / "report.txt")
    assert result["sigma0"] == pytest.approx(1.1786, abs=5e-5)
    assert_key_figures(result, report, digits=5)
    assert_orientations(result, report.photos)
