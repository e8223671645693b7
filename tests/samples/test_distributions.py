"""The sample projects are in what is handed out: in a source distribution, and in the wheel that is built from it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from workflow.small_projects import REPOSITORY, contents

from orip.workflow.sample_projects import SAMPLES

BUILT = ("setup.py", "pyproject.toml", "README.md", "LICENSE", "orip", "sample_projects")


def build(kind: str, source: Path, target: Path) -> Path:
    """Build a distribution without a compiler, which the program does without, too."""
    target.mkdir()
    program = f"import sys; from setuptools import build_meta; print(build_meta.build_{kind}(sys.argv[1]))"
    words = [sys.executable, "-c", program, str(target)]
    done = subprocess.run(
        words, cwd=source, env={**os.environ, "CC": "false"}, capture_output=True, text=True, check=True
    )
    return target / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a wheel from a source distribution of a copy of the repository, and unpack it."""
    folder = tmp_path_factory.mktemp("distributions")
    clone = folder / "clone"
    clone.mkdir()
    unwanted = shutil.ignore_patterns("__pycache__", "*.so")
    for name in BUILT:
        source = REPOSITORY / name
        if source.is_dir():
            shutil.copytree(source, clone / name, ignore=unwanted)
        else:
            shutil.copy(source, clone / name)
    archive = build("sdist", clone, folder / "sdist")
    shutil.unpack_archive(archive, folder, filter="data")
    with zipfile.ZipFile(build("wheel", folder / archive.name.removesuffix(".tar.gz"), folder / "wheel")) as wheel:
        wheel.extractall(folder / "installed")
    return folder / "installed"


_WRITE = """
import sys
from orip.cli.main import main
for name in sys.argv[1:]:
    sys.argv = ["orip", "init", "--sample", name, name]
    try:
        main()
    except SystemExit as end:
        assert not end.code, end.code
"""


def test_an_installed_wheel_writes_the_samples_of_the_repository(tmp_path: Path, installed: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    words = [sys.executable, "-c", _WRITE, *SAMPLES]
    subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    for name in SAMPLES:
        written = contents(tmp_path / name)
        del written[".gitignore"]
        packed = installed / "orip" / "sample_projects" / name
        assert set(written) == {path.name for path in packed.iterdir()} != set()
        for file, content in written.items():
            assert content == (REPOSITORY / "sample_projects" / name / file).read_bytes(), (name, file)
