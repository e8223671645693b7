"""How quickly an archive is adjusted, beside one process alone, and how much memory that takes.

    OPENBLAS_NUM_THREADS=1 python benchmarks/archive.py 1000
    OPENBLAS_NUM_THREADS=1 python benchmarks/archive.py 5000
    OPENBLAS_NUM_THREADS=1 python benchmarks/archive.py 5000 --tcp --kill-every 60

The archive is simulated, without mistakes; Linux only. Required: no failure, at least 85 % of cores times the speed of
one process that adjusts projects one after the other, and memory that does not grow. That process is measured before
and after the archive, and so are as many of them at once as there are cores: what these share bounds any program. With
``--tcp`` scheduler and workers are started separately, and every so many seconds one of the workers is killed and
another one started. What other work on the machine spoils is the time on the clock; CPU seconds say what the
distribution costs.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from msgspec import Struct, field

from orip.archive.cluster.connection import cores
from orip.archive.simulation import simulate_archive, simulated_project
from orip.archive.task import ProjectTask, TaskSettings, carry_out
from orip.files.text.atomic import write_new_folder

ALONE = 50
"""Projects by which the speed of one process is measured."""
REQUIRED = 0.85
_FORK_SERVER = b"orip.archive.fork_server"
_TICK = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100
_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096


class Watched(Struct):
    """CPU seconds and memory of all processes of a run.

    Attributes
    ----------
    cpu : dict by process
        What it is for, and its seconds at the last look; those of a fork server with those of its copies.
    memory : list of (float, float)
        Seconds since the beginning, and MB that the processes take (copies share most of theirs).
    """

    top: str
    cpu: dict[int, tuple[str, float]] = field(default_factory=dict)
    memory: list[tuple[float, float]] = field(default_factory=list)
    began: float = field(default_factory=time.monotonic)

    def look(self) -> list[int]:
        """Look at the processes; return those of workers."""
        workers, megabytes, copies = [], 0.0, []
        for process in (int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()):
            try:
                environment = Path(f"/proc/{process}/environ").read_bytes()
                words = Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
                fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
                size = int(Path(f"/proc/{process}/statm").read_text().split()[1])
            except (OSError, IndexError, ValueError):
                continue
            if f"ORIP_BENCHMARK={self.top}".encode() not in environment:
                continue
            megabytes += size * _PAGE / 1e6
            own, ended = sum(map(int, fields[11:13])) / _TICK, sum(map(int, fields[13:15])) / _TICK
            if _FORK_SERVER not in words:
                self.cpu[process] = ("client and scheduler" if b"archive" in words else "workers", own)
            elif _is_fork_server(int(fields[1])):
                copies.append((int(fields[1]), own))
            else:
                self.cpu[process] = ("projects", own + ended)
            if b"distributed.cli.dask_worker" in words:
                workers.append(process)
        for server, seconds in copies:
            self.cpu[server] = ("projects", self.cpu.get(server, ("", 0.0))[1] + seconds)
        self.memory.append((time.monotonic() - self.began, megabytes))
        return workers

    def cpu_of(self, purpose: str) -> float:
        """Return the CPU seconds of all processes for a purpose."""
        return sum(seconds for found, seconds in self.cpu.values() if found == purpose)

    def mean_memory(self, begin: float, end: float) -> float:
        """Return the mean memory between two parts of the run, MB."""
        last = self.memory[-1][0]
        found = [megabytes for at, megabytes in self.memory if begin * last <= at <= end * last]
        return sum(found) / max(len(found), 1)


def _is_fork_server(process: int) -> bool:
    try:
        return _FORK_SERVER in Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return False


class Speed(Struct, frozen=True):
    """Projects a second of some processes together, and CPU seconds of each project."""

    rate: float
    cpu: float


def speed_alone(top: Path, processes: int) -> Speed:
    """Return the speed of some processes at once, which load everything before they begin."""
    started = [
        subprocess.Popen(
            [sys.executable, __file__, "--alone", str(top / f"alone{number}")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for number in range(processes)
    ]  # fmt: skip
    for process in started:
        assert process.stdout is not None
        assert process.stdout.readline() == "loaded\n"
    for process in started:
        assert process.stdin is not None
        process.stdin.write("begin\n")
        process.stdin.flush()
    found = [[float(word) for word in process.communicate()[0].split()] for process in started]
    return Speed(sum(rate for rate, _ in found), sum(cpu for _, cpu in found) / processes)


def run_alone(top: Path) -> None:
    """Adjust projects one after the other when stdin says so, and print how many a second and CPU seconds of each."""
    gc.set_threshold(100_000, 20, 20)  # as the command `orip` does
    tasks = []
    for number in range(ALONE + 1):
        folder = top / str(number)
        write_new_folder(folder, simulated_project(number, 1, 0.0).texts | own_cameras(number))
        tasks.append(ProjectTask(str(number), str(folder), str(top / "results"), TaskSettings(report=False)))
    carry_out(tasks[0])
    print("loaded", flush=True)
    sys.stdin.readline()
    began, used = time.monotonic(), time.process_time()
    for task in tasks[1:]:
        assert carry_out(task).state == "adjusted"
    print(ALONE / (time.monotonic() - began), (time.process_time() - used) / ALONE)
    shutil.rmtree(top)


def own_cameras(number: int) -> dict[str, str]:
    """Return orip.toml of a simulated project without the cameras of another one."""
    text = simulated_project(number, 1, 0.0).texts["orip.toml"]
    return {"orip.toml": "\n".join(line for line in text.split("\n") if not line.startswith("camera_file"))}


@contextmanager
def separate_cluster(environment: dict[str, str], workers: int, stack: ExitStack) -> Iterator[str]:
    """Start a scheduler and workers; each worker that ends is started again by `keep`."""
    address = "tcp://127.0.0.1:8798"
    words = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "8798", "--no-dashboard"]
    _started(words, environment, stack)
    for _ in range(workers):
        start_worker(address, environment, stack)
    yield address


def start_worker(address: str, environment: dict[str, str], stack: ExitStack) -> None:
    """Start a worker."""
    words = ["distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    _started(words, environment, stack)


def _started(words: list[str], environment: dict[str, str], stack: ExitStack) -> None:
    quiet = subprocess.DEVNULL
    process = subprocess.Popen([sys.executable, "-m", *words], env=environment, stdout=quiet, stderr=quiet)
    stack.callback(process.wait)
    stack.callback(process.kill)


class Run(Struct, frozen=True):
    """A run of the archive: its document, seconds of the whole command, how many workers were killed, what was seen."""

    document: dict[str, Any]
    whole: float
    kills: int
    watched: Watched


def run_archive(top: Path, given: argparse.Namespace) -> Run:
    """Run `orip archive run` on the projects of a folder, and kill workers meanwhile."""
    environment = {**os.environ, "ORIP_BENCHMARK": str(top)}
    words = ["orip", "archive", "run", str(top / "surveys"), "--no-report", "--json", "--out", str(top / "results")]
    address = ""
    with ExitStack() as stack:
        if given.tcp:
            address = stack.enter_context(separate_cluster(environment, given.workers or cores(), stack))
            words += ["--dask", address]
        elif given.workers:
            words += ["--workers", str(given.workers)]
        watched = Watched(str(top))
        client = subprocess.Popen(
            [sys.executable, "-m", *words],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        kills, next_kill = 0, time.monotonic() + given.kill_every
        while client.poll() is None:
            workers = watched.look()
            if given.kill_every and time.monotonic() > next_kill and workers:
                os.kill(workers[kills % len(workers)], signal.SIGKILL)
                kills, next_kill = kills + 1, next_kill + given.kill_every
                start_worker(address, environment, stack)
            time.sleep(1.0)
        assert client.stdout is not None
        return Run(json.loads(client.stdout.read()), time.monotonic() - watched.began, kills, watched)


def main() -> None:
    """Measure, and say whether what is required is reached."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("projects", type=int, nargs="?")
    parser.add_argument("--workers", type=int, help="default: as `orip archive run`; with --tcp the cores")
    parser.add_argument("--tcp", action="store_true")
    parser.add_argument("--kill-every", type=float, default=0.0)
    parser.add_argument("--alone", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.alone:
        run_alone(given.alone)
        return
    with tempfile.TemporaryDirectory(prefix="orip-archive-") as name:
        top = Path(name)
        simulate_archive(top / "surveys", given.projects, 1, 0.0)
        before = _speeds(top)
        run = run_archive(top, given)
        after = _speeds(top)
    alone, at_once = ((one.rate + other.rate) / 2.0 for one, other in zip(before, after, strict=True))
    document, watched = run.document, run.watched
    rate = document["projects"] / document["seconds"]
    print(
        f"archive: {document['states']} of {document['projects']} in {document['seconds']} s, {run.whole:.0f} s with "
        f"the start of the cluster and the tables; {run.kills} workers killed"
    )
    print(
        f"throughput {rate:.2f} a second, {rate / (alone * cores()):.0%} of {cores()} x one process alone, "
        f"{rate / at_once:.0%} of {cores()} processes at once"
    )
    purposes = ("projects", "workers", "client and scheduler")
    used = {purpose: watched.cpu_of(purpose) / document["projects"] for purpose in purposes}
    shown = ", ".join(f"{seconds:.3f} {purpose}" for purpose, seconds in used.items())
    alone_cpu = (before[0].cpu + after[0].cpu) / 2.0
    print(f"CPU seconds a project {sum(used.values()):.3f}: {shown}; in one process {alone_cpu:.3f}")
    early, late = watched.mean_memory(0.25, 0.5), watched.mean_memory(0.75, 1.0)
    print(f"memory {early:.0f} MB in the second quarter, {late:.0f} MB in the last")
    failures = document["projects"] - document["states"].get("adjusted", 0)
    sys.exit(1 if failures or rate < REQUIRED * alone * cores() else 0)


def _speeds(top: Path) -> tuple[Speed, Speed]:
    """Return the speed of one process alone, and of as many as there are cores at once, all together."""
    alone, at_once = speed_alone(top, 1), speed_alone(top, cores())
    print(
        f"one process alone: {alone.rate:.2f} projects a second; {cores()} at once: {at_once.rate:.2f}, "
        f"{at_once.rate / (alone.rate * cores()):.0%} of {cores()} x one",
        flush=True,
    )
    return alone, at_once


if __name__ == "__main__":
    main()
