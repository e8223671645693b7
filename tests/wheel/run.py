"""A wheel in a fresh environment without a compiler, and the tests that it has to pass there.

    python tests/wheel/run.py dist/orip-0.1.0-cp311-abi3-linux_x86_64.whl      what `make wheel` does in the end

The tests are those of `tests.txt`, by one rule: all that call the compiled loops directly, the published results of the
samples, the ordinary commands and the Python API. They run outside of the repository, in a folder that holds the tests
and not the package, so that nothing but the wheel can be imported. cibuildwheel runs the same list on other systems.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]


def settings() -> dict[str, list[str]]:
    """Return what cibuildwheel is told in pyproject.toml."""
    build = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    found: dict[str, list[str]] = build["tool"]["cibuildwheel"]
    return found


def copied_tests(folder: Path) -> None:
    """Copy into a folder what the tests read: the tests themselves, and the files of the repository beside them."""
    for name in settings()["test-sources"]:
        source = REPOSITORY / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / name)


def main(wheel: Path) -> int:
    """Install the wheel, run the tests, and return the exit code."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        venv.create(folder / "environment", with_pip=True)
        python = folder / "environment" / ("Scripts" if os.name == "nt" else "bin") / "python"
        # what has to be compiled here would fail
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {"CC": "false"}
        install = [str(python), "-m", "pip", "install", "-q", "--only-binary", ":all:", "--disable-pip-version-check"]
        subprocess.run([*install, str(wheel), *settings()["test-requires"]], env=environment, check=True)
        (folder / "tests of the wheel").mkdir()
        copied_tests(folder / "tests of the wheel")
        tests = [str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", "@tests/wheel/tests.txt"]
        return subprocess.run(tests, cwd=folder / "tests of the wheel", env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
