"""How fast orip answers: CPU time of `orip --help`, and wall time of the Zurich City Hall project.

    python benchmarks/startup.py

Prints the smallest of five, in seconds: what the machine does besides can only make it longer.
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TIMES = 5
ZURICH = Path(__file__).parents[1] / "orip" / "sample_projects" / "zurich_city_hall"


def orip(*arguments: str) -> None:
    """Run a command of orip; its output is of no interest."""
    subprocess.run([sys.executable, "-m", "orip.cli.main", *arguments], check=True, capture_output=True)


def help_cpu() -> float:
    """Return the CPU seconds, user and system, of `orip --help`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    orip("--help")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def zurich_wall() -> float:
    """Return the wall seconds of the whole project in a fresh folder."""
    with tempfile.TemporaryDirectory() as folder:
        project = shutil.copytree(ZURICH, Path(folder) / "zurich", ignore=shutil.ignore_patterns("*.OUT", "*.EXT"))
        start = time.perf_counter()
        orip("-C", str(project), "run")
        return time.perf_counter() - start


def main() -> None:
    """Measure and print."""
    print(f"orip --help          {min(help_cpu() for _ in range(TIMES)):.3f} s CPU")
    print(f"Zurich City Hall run {min(zurich_wall() for _ in range(TIMES)):.3f} s wall")


if __name__ == "__main__":
    main()
