"""How fast orip answers: CPU time of `orip --help` and `orip status`, and times of the Zurich City Hall project.

    python benchmarks/startup.py

Prints the smallest of five, in seconds: what the machine does besides can only make it longer.
"""

from __future__ import annotations

import atexit
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

TIMES = 5
ZURICH = Path(__file__).parents[1] / "sample_projects" / "zurich_city_hall"


def orip(*arguments: str) -> None:
    """Run a command of orip; its output is of no interest."""
    # compiled modules are kept, as where orip is installed
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    subprocess.run([sys.executable, "-m", "orip", *arguments], check=True, capture_output=True, env=environment)


def children_cpu() -> float:
    """Return the CPU seconds, user and system, of all commands that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def cpu_of(*arguments: str) -> float:
    """Return the CPU seconds of a command."""
    before = children_cpu()
    orip(*arguments)
    return children_cpu() - before


def help_cpu() -> float:
    """Return the CPU seconds of `orip --help`."""
    return cpu_of("--help")


def status_cpu() -> float:
    """Return the CPU seconds of `orip status` of the Zurich City Hall project after it was run."""
    return cpu_of("-C", str(_finished()), "status")


@cache
def _finished() -> Path:
    """Return the folder of the project with all its stores and results, which is there until the end."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    project = shutil.copytree(ZURICH, Path(folder.name) / "zurich")
    orip("-C", str(project), "run")
    return project


def zurich() -> tuple[float, float]:
    """Return the seconds on the clock and the CPU seconds of the whole project in a fresh folder."""
    with tempfile.TemporaryDirectory() as folder:
        project = shutil.copytree(ZURICH, Path(folder) / "zurich", ignore=shutil.ignore_patterns("*.OUT", "*.EXT"))
        start, before = time.perf_counter(), children_cpu()
        orip("-C", str(project), "run")
        return time.perf_counter() - start, children_cpu() - before


def main() -> None:
    """Measure and print."""
    print(f"orip --help          {min(help_cpu() for _ in range(TIMES)):.3f} s CPU")
    print(f"orip status          {min(status_cpu() for _ in range(TIMES)):.3f} s CPU")
    wall, cpu = (min(times) for times in zip(*(zurich() for _ in range(TIMES)), strict=True))
    print(f"Zurich City Hall run {wall:.3f} s wall, {cpu:.3f} s CPU")


if __name__ == "__main__":
    main()
