"""The README's first project, as most tests of commands begin with it: in text, initialised or adjusted."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import first_project


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder with the text files of the project and nothing else."""
    return first_project(tmp_path / "first")


@pytest.fixture
def initialised(project: Path) -> Path:
    """The folder of `project` after ``orip init``."""
    assert orip(project, "init").code == 0
    return project


@pytest.fixture
def adjusted(project: Path) -> Path:
    """The folder of `project` after ``orip run``."""
    assert orip(project, "run").code == 0
    return project
