"""Rendered photos, and a project of them for each test."""

from __future__ import annotations

from pathlib import Path

import pytest
from screen.rendered_project import Rendered, make_project


@pytest.fixture(scope="session")
def rendered() -> Rendered:
    return Rendered()


@pytest.fixture
def project(tmp_path: Path, rendered: Rendered) -> Path:
    return make_project(tmp_path, rendered)
