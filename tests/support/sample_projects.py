"""Copies of the sample projects as they come with orip, without stores and results."""

from __future__ import annotations

import shutil
from pathlib import Path

from workflow.small_projects import REPOSITORY

SAMPLES = REPOSITORY / "sample_projects"
_RESULTS = shutil.ignore_patterns("*.OUT", "*.EXT", "*.EXO", "*.PHO", "*.TEM", "*.CAM", "*.TIK", "*.json", "*.csv")


def sample(folder: Path, name: str) -> Path:
    """Copy a sample into a new folder of its name and return that."""
    return Path(shutil.copytree(SAMPLES / name, folder / name, ignore=_RESULTS))
