"""`orip archive simulate`: a folder of simulated projects to try an archive on."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from msgspec import Struct

from orip.archive.simulation import simulated_project
from orip.errors import UsageError
from orip.files.text.atomic import reporting_failure
from orip.files.text.new_folder import write_new_folder
from orip.progress import stage


class SimulatedArchive(Struct, frozen=True):
    """What was written: the folder, the number of projects, and how many of them have a fault, by its kind."""

    folder: Path
    projects: int
    faults: Counter[str]


def simulate_archive(folder: Path, projects: int, seed: int, faults: float) -> SimulatedArchive:
    """Write simulated projects into a new or empty folder.

    Raises
    ------
    UsageError
        If the folder has something in it.
    OripError
        If the disk refuses.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        message = f"'{folder}' has something in it already; name a new or empty folder"
        raise UsageError(message)
    planted: Counter[str] = Counter()
    with (
        stage("simulate", projects) as advance,
        reporting_failure(folder, "remove the cause, then name a new or empty folder"),
    ):
        for number in range(projects):
            project = simulated_project(number, seed, faults)
            write_new_folder(folder / project.folder, project.texts)
            if project.fault:
                planted[project.fault] += 1
            advance(number + 1)
    return SimulatedArchive(folder, projects, planted)
