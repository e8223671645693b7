"""A whole project on the disk: what `orip init`, `measure` and `solve` take from texts to stores and listings.

    python whole_solve.py 500
    python whole_solve.py 2000 --keep /var/tmp/block
    python whole_solve.py 20000 --most-memory 16      photos with 250 points each, 5 million in all: takes ten minutes
    python whole_solve.py 20000 --points 100 --workers 4 --worker-memory 2000        `solve --dask local`

The aerial block as orip.toml, .MEA and .PNT: photo coordinates in millimetres, weighted control, no values for points.
Prints one line of JSON: seconds (CPU and on the clock) and peak memory of each command, one thread each; and how many
MB of files they leave. With workers, CPU seconds are those of all processes, and the peak is that of the largest one.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from aerial_blocks import POINTS_A_PHOTO, aerial_block

from orip.files.project.toml_text import toml_table
from orip.records.block import Block
from orip.records.photo import PHOTO_PARAMETERS

COMMANDS = ("init", "measure", "solve")
_LARGE = 5000
"""Photos from which each has fewer points, so that what is counted are photos."""

_POINTS_OF_LARGE = 250
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def write_project(block: Block, folder: Path) -> None:
    """Write the texts of a project whose one bundle is the block."""
    (folder / "orip.toml").write_text("\n".join(_tables(block)), encoding="utf-8")
    (folder / "BENCH.MEA").write_text("\n".join(_measured(block)) + "\n", encoding="utf-8")
    control = [
        " ".join([point.name, *(f"{value:.4f}" for value in (*point.coordinates, *point.errors))])
        for point in block.control_points
    ]
    (folder / "BENCH.PNT").write_text("\n".join(control) + "\n", encoding="utf-8")


def _tables(block: Block) -> Iterator[str]:
    """Yield the tables of orip.toml."""
    (camera,) = block.cameras
    definition = block.definition
    bundle = {
        "name": definition.name,
        "measurement_precision": definition.measurement_precision.value,
        "max_iterations": definition.max_iterations,
        "start_down_weight": definition.start_down_weight,
    }
    yield toml_table("[project]", {"name": "BENCH", "user": "benchmark", "ground_unit": "m"})
    yield toml_table("[[camera]]", {"name": camera.name, "c": camera.parameters[0], "unknown": list(camera.unknown)})
    yield toml_table("[[bundle]]", bundle)
    for photo in block.photos:
        values = dict(zip(PHOTO_PARAMETERS, photo.orientation, strict=True))
        yield toml_table("[[photo]]", {"name": photo.name, "camera": camera.name, **values})


def _measured(block: Block) -> Iterator[str]:
    """Yield the lines of the measurement log, photo after photo."""
    points = block.photo_points
    order = np.argsort(points.photo, kind="stable")
    ends = np.cumsum(np.bincount(points.photo, minlength=len(block.photos)))
    for photo, rows in zip(block.photos, np.split(order, ends[:-1]), strict=True):
        yield f"POINTS {block.definition.name} {photo.name}"
        for point, (x, y) in zip(points.point[rows].tolist(), points.xy[rows].tolist(), strict=True):
            yield f"{block.point_names[point]} {x:.5f} {y:.5f}"


def command_figures(folder: Path, command: str, options: list[str]) -> dict[str, float]:
    """Return CPU seconds, seconds on the clock and peak memory (MB) of a command in a project."""
    start = time.perf_counter()
    with (folder / f"{command}.log").open("wb") as log:
        words = [sys.executable, "-m", "orip", "-C", str(folder), command, *options]
        output = [(os.POSIX_SPAWN_DUP2, log.fileno(), place) for place in (1, 2)]
        child = os.posix_spawn(sys.executable, words, _environment(), file_actions=output)
        _, status, used = os.wait4(child, 0)
    if os.waitstatus_to_exitcode(status):
        raise SystemExit(f"orip {command} failed:\n" + (folder / f"{command}.log").read_text())
    return {
        f"{command}_cpu": used.ru_utime + used.ru_stime,
        f"{command}_wall": time.perf_counter() - start,
        f"{command}_peak": used.ru_maxrss / 1024.0,
    }


def _environment() -> dict[str, str]:
    """Return an environment with one thread, in which compiled modules are kept, as where orip is installed."""
    return {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"} | _ONE_THREAD


def size_of_outputs(folder: Path) -> float:
    """Return the size (MB) of what commands have written in a folder: all but the given texts."""
    given = {"orip.toml", "BENCH.MEA", "BENCH.PNT"}
    return sum(path.stat().st_size for path in folder.iterdir() if path.name not in given) / 1e6


def main() -> None:
    """Write the project, run the commands and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", type=int)
    parser.add_argument("--keep", type=Path, help="a folder for the project, which stays")
    parser.add_argument("--write", type=Path, help="write the project to a folder, and nothing else")
    parser.add_argument("--points", type=int, help="points in a photo")
    parser.add_argument("--workers", type=int, help="of Dask, which adjust the block")
    parser.add_argument("--worker-memory", type=int, default=2000, help="MB of each worker")
    parser.add_argument("--most-memory", type=float, help="GB that a command may use")
    given = parser.parse_args()
    if given.most_memory:
        limit = round(given.most_memory * 2**30)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    points = given.points or (_POINTS_OF_LARGE if given.photos > _LARGE else POINTS_A_PHOTO)
    divided = ["--dask", "local", "--workers", str(given.workers), "--worker-memory", str(given.worker_memory)]
    if given.write:
        given.write.mkdir(parents=True, exist_ok=True)
        write_project(aerial_block(given.photos, points), given.write)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        # a process starts with the peak memory of the one that started it: the block is not made in this one
        writing = [sys.executable, __file__, str(given.photos), "--points", str(points), "--write", str(folder)]
        subprocess.run(writing, check=True, env={**os.environ, **_ONE_THREAD})
        found = {}
        for command in COMMANDS:
            found |= command_figures(folder, command, divided if given.workers and command == "solve" else [])
        found["outputs"] = size_of_outputs(folder)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
