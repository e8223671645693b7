"""The container and the conda package have what pyproject.toml says."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from workflow.small_projects import REPOSITORY

PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def recipe() -> dict[str, Any]:
    yaml = pytest.importorskip("yaml", reason="PyYAML comes with dask")
    return yaml.safe_load((REPOSITORY / "packaging/conda/recipe.yaml").read_text(encoding="utf-8"))


def test_the_conda_package_needs_what_the_wheel_needs() -> None:
    needed = [requirement.replace(" ", "") for requirement in recipe()["requirements"]["run"]]
    assert needed == [f"python{PROJECT['requires-python']}", *PROJECT["dependencies"]]


def test_the_conda_package_is_of_this_version_and_has_its_command() -> None:
    assert recipe()["context"]["version"] == PROJECT["version"]
    (entry,) = recipe()["build"]["python"]["entry_points"]
    assert entry == f"orip = {PROJECT['scripts']['orip']}"


@pytest.mark.skipif(os.name != "posix", reason="CC names the compiler of POSIX alone")
def test_extensions_that_are_asked_for_and_not_built_are_an_error(tmp_path: Path) -> None:
    pytest.importorskip("setuptools", reason="setup.py needs it")
    words = ["build_ext", f"--build-lib={tmp_path}", f"--build-temp={tmp_path}"]
    compiler = {"CC": str(tmp_path / "no_compiler"), "CXX": str(tmp_path / "no_compiler")}
    done = subprocess.run(
        [sys.executable, "setup.py", *words], cwd=REPOSITORY, env={**os.environ, **compiler}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "error: the compiled part of orip was not built: orip.bundle.compiled._observation_loop, " in done.stderr
    assert "it needs a C compiler and the headers of Python" in done.stderr


def test_what_the_container_copies_is_let_through_and_there() -> None:
    let_through = {line[1:] for line in (REPOSITORY / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    copied = set()
    for line in (REPOSITORY / "Dockerfile").read_text().splitlines():
        if line.startswith("COPY ") and "--from" not in line:
            copied |= set(line.split()[1:-1])
    assert copied == let_through
    assert all((REPOSITORY / name).exists() for name in copied)
    assert {"orip", "pyproject.toml", "setup.py", PROJECT["readme"], *PROJECT["license-files"]} <= copied
