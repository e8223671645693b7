"""What all tests share: settings of hypothesis, and the README's first project in text, initialised and adjusted."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli.command_line import orip
from hypothesis import HealthCheck, settings
from workflow.small_projects import first_project

# how long an example takes depends on the machine and on what else it does, and is no fault
ON_ANY_MACHINE = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("few examples", ON_ANY_MACHINE, max_examples=30)
settings.register_profile("many examples", ON_ANY_MACHINE, max_examples=200)  # of 'make test-all'
settings.load_profile("few examples")

_ROOM = 4 << 30


def _folder_in_memory() -> Path | None:
    """Return where Linux keeps files in memory, if programs may be started there and there is room for all tests."""
    folder = Path("/dev/shm")
    if not folder.is_dir():
        return None
    found = os.statvfs(folder)
    is_fit = found.f_bavail * found.f_frsize >= _ROOM and not found.f_flag & os.ST_NOEXEC
    return folder if is_fit else None


# thousands of commits wait for a disk otherwise, and no test takes the power away
if memory := _folder_in_memory():
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(memory))

# a shell starts what it runs in the background with SIGINT ignored, and programs that a test starts would ignore it too
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True, scope="session")
def _private_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep tokens of servers in a folder of the tests, as programs find it that they start."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("XDG_RUNTIME_DIR", "LOCALAPPDATA"):
            patch.setenv(name, str(tmp_path_factory.mktemp("private")))
        yield


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder with the text files of the project and nothing else."""
    return first_project(tmp_path / "first")


@pytest.fixture
def initialised(project: Path) -> Path:
    """The folder of `project` after ``orip init``."""
    assert orip(project, "init").code == 0
    return project


@pytest.fixture(scope="session")
def adjusted_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that is only copied."""
    folder = first_project(tmp_path_factory.mktemp("adjusted") / "first")
    assert orip(folder, "run").code == 0
    return folder


@pytest.fixture
def adjusted(project: Path, adjusted_once: Path) -> Path:
    """The folder of `project` after ``orip run``."""
    return Path(shutil.copytree(adjusted_once, project, dirs_exist_ok=True))
