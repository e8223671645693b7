"""What the shell offers when the user presses the tab key."""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from unittest.mock import patch

import pytest
from cli.command_line import orip
from workflow.small_projects import first_project

from orip.cli.main import app


@pytest.fixture
def first(tmp_path: Path) -> Path:
    return first_project(tmp_path / "first")


def offered(folder: Path, words: str) -> list[str]:
    """Return what bash is offered for the last word."""
    line = f"orip -C {folder} {words}"
    last = len(line.split()) - (0 if line.endswith(" ") else 1)
    asked = {"_ORIP_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(last)}
    out = io.StringIO()
    with patch.dict(os.environ, asked), patch.object(sys, "stdout", out), pytest.raises(SystemExit):
        app(prog_name="orip", args=[])
    return out.getvalue().split()


@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("run ", ["MAIN"]),
        ("solve M", ["MAIN"]),
        ("solve X", []),
        ("init --sample dr", ["drone_rtk"]),
        ("photo show ", ["left", "right"]),
        ("camera show C", ["C35"]),
        ("results photos r", ["right"]),
        ("results cameras ", ["C35"]),
        ("observations list --photo l", ["left"]),
        ("export geo", ["geopackage"]),
        ("import bi", ["bingo"]),
        ("import FIRST.P", ["FIRST.PNT"]),
        ("import csv bi", []),
        ("control points edit ", ["1", "2"]),
        ("control points kill 1 ", ["1", "2"]),
        ("control distances edit ", []),
        ("results covariance ", ["C35", "left", "right"]),
    ],
)
def test_names_of_the_project(first, words, names):
    found = offered(first, words)
    assert found[: len(names)] == names
    assert bool(found) == bool(names)


def test_points_are_offered_once_they_are_measured(first):
    assert offered(first, "observations list --point ") == []
    assert orip(first, "init").code == orip(first, "measure").code == 0
    assert "P1" in offered(first, "observations list --point ")
    assert offered(first, "results points P") == ["P1"]


def test_a_folder_without_a_project_offers_nothing(tmp_path):
    (tmp_path / "orip.toml").write_text("project = {")
    assert offered(tmp_path, "photo show ") == []
    assert offered(tmp_path / "missing", "solve ") == []
