"""Tests in other surroundings and another order: no home folder, a far time zone, plain locale, one thread or many."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from workflow.small_projects import REPOSITORY


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    "surroundings",
    [
        {"LC_ALL": "C", "TZ": "Pacific/Kiritimati", "OMP_NUM_THREADS": "1", "ORIP_TEST_ORDER": "1"},
        {"LC_ALL": "C.UTF-8", "TZ": "America/Adak", "OMP_NUM_THREADS": "8", "ORIP_TEST_ORDER": "2"},
    ],
    ids=["one thread", "many threads"],
)
def test_what_can_depend_on_its_surroundings_passes_in_others(surroundings: dict[str, str], tmp_path: Path) -> None:
    paths = os.pathsep.join(str(REPOSITORY / folder) for folder in ("tests", "."))
    environment = {**os.environ, "HOME": str(tmp_path / "nowhere"), "PYTHONPATH": paths, **surroundings}
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-p", "environment.shuffled_order"]
    run = subprocess.run(
        [*command, "-p", "no:cacheprovider"],
        cwd=REPOSITORY,
        env=environment,
        check=False,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout[-5000:]
