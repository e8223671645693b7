"""A process that has loaded orip once, and has projects adjusted in copies of itself (forks) with limits.

It reads tasks from stdin and writes replies to stdout, both pickled, one at a time, and ends with its stdin: when the
worker that has started it is killed, so are this process and the project that it works on. It has a single thread, as
a process has to have that is copied: linear algebra is told so by the environment before it is loaded.
"""

from __future__ import annotations

import gc
import pickle
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain
from pathlib import Path

from orip.archive.project_process import ProjectProcess
from orip.archive.simulation import simulated_project
from orip.archive.task import ProjectTask, TaskReply, TaskSettings, carry_out, keep_over_limit
from orip.archive.worker import DIED, ENDED
from orip.files.text.atomic import write_new_folder


def main() -> None:
    """Serve until stdin ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program that handed out the tasks
    tasks, replies = _tasks(), sys.stdout.buffer
    first = next(tasks, None)
    if first is None:
        return
    load_all(first.settings)
    gc.collect()
    gc.freeze()  # looking for circles would copy the pages of all that is loaded
    gc.disable()  # copies do so between projects
    server = ProjectServer(sys.stdin.fileno())
    for task in chain([first], tasks):
        pickle.dump(server.adjusted(task), replies)
        replies.flush()


def _tasks() -> Iterator[ProjectTask]:
    """Yield the tasks that come from stdin, until it ends."""
    while True:
        try:
            task: bytes = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        yield pickle.loads(task)


def load_all(settings: TaskSettings) -> None:
    """Adjust a small project here, so that every module that a project needs is loaded before the copies are made.

    The less is loaded, the less a copy costs: method and reports are those of the first task.
    """
    import pyproj  # noqa: F401  # of projects with a crs

    with tempfile.TemporaryDirectory(prefix="orip-") as top:
        folder, results = Path(top, "project"), Path(top, "results")
        write_new_folder(folder, simulated_project(0, 0, 0.0).texts)
        plain = TaskSettings(settings.method, report=settings.report)
        carry_out(ProjectTask("loading", str(folder), str(results), plain))


class ProjectServer:
    """Adjusts projects in copies of this process.

    Parameters
    ----------
    lifeline : int
        A file descriptor. When it ends, so do this process and the project that it works on.
    """

    def __init__(self, lifeline: int) -> None:
        self._lifeline = lifeline
        self._process: ProjectProcess | None = None

    def adjusted(self, task: ProjectTask) -> tuple[str, bytes]:
        """Carry out a task; return how it ended, and the pickled reply or the reason."""
        limits, began = task.settings.limits, time.monotonic()
        try:
            reply = self._reply(task)
        except TimeoutError:
            reply = _over_limit(task, f"takes longer than {limits.seconds:g} s; see --time", began)
        except MemoryError:
            reply = _over_limit(task, f"needs more than {limits.megabytes} MB of memory; see --memory", began)
        except ChildProcessError as error:
            return DIED, f"the process of the project {error}".encode()
        return (DIED, reply.message.encode()) if reply.state == "machine" else (ENDED, pickle.dumps(reply))

    def _reply(self, task: ProjectTask) -> TaskReply:
        if self._process is not None:
            with suppress(MemoryError):  # projects before it may have left too little; a new process tells
                return self._reply_of(self._process, task)
        return self._reply_of(ProjectProcess(), task)

    def _reply_of(self, process: ProjectProcess, task: ProjectTask) -> TaskReply:
        self._process = None
        reply = process.adjust(task, self._lifeline)
        self._process = process if process.stays else None
        return reply


def _over_limit(task: ProjectTask, message: str, began: float) -> TaskReply:
    return keep_over_limit(task, message, time.monotonic() - began)


if __name__ == "__main__":
    main()
