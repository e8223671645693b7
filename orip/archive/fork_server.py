"""A process that has loaded orip once, and has projects adjusted in copies of itself (forks) with limits.

It reads tasks from stdin and writes replies to stdout, both pickled, one at a time, and ends with its stdin: when the
worker that has started it is killed, so are this process and the project that it works on. It has a single thread, as
a process has to have that is copied: linear algebra is told so by the environment before it is loaded.

What adjusts projects is a copy (a fork) of this process. It is kept while projects end well in it and
leave it as it was; whatever else a project may leave behind ends with its process. To make a copy, and to copy and
clear the pages that it writes to, takes a third of the time of a small project.
"""

from __future__ import annotations

import gc
import locale
import logging
import os
import pickle
import random
import signal
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import chain
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path

import numpy as np

from orip.archive.simulation import simulated_project
from orip.archive.task import Limits, ProjectTask, TaskReply, TaskSettings, carry_out, keep_over_limit, peak_megabytes
from orip.archive.worker import DIED, ENDED
from orip.files.text.atomic import write_new_folder

MOST_PROJECTS = 50
"""Projects after which a process is replaced, whatever it is like."""

LARGEST_SHARE = 0.25
"""Of the memory that a project may use: a process in which one has taken more is replaced, as some may stay with it."""

_MEGABYTE = 1 << 20


class ProjectProcess:
    """A process for projects, as seen from the one that hands them to it.

    Attributes
    ----------
    stays : bool
        It takes another project; a process that does not has ended.
    """

    def __init__(self) -> None:
        context = get_context("fork")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._connection), daemon=True)
        self._process.start()
        theirs.close()
        self.stays = True

    def adjust(self, task: ProjectTask, lifeline: int) -> TaskReply:
        """Return how a project ended.

        Parameters
        ----------
        lifeline : int
            A file descriptor. When it ends, the project is ended, and so is the process that waits for it.

        Raises
        ------
        TimeoutError
            If the project took longer than it may, and was ended.
        MemoryError
            If it needs more than it may have.
        ChildProcessError
            If the process died; it says how.
        """
        self.stays = False
        try:
            self._connection.send(task)
            ready = wait([self._connection, lifeline], task.settings.limits.seconds)
            if self._connection not in ready:
                self._process.kill()
                if ready:
                    os._exit(1)
                raise TimeoutError
            reply: TaskReply | None
            reply, self.stays = self._connection.recv()
        except (EOFError, ConnectionError):
            self._process.join()
            raise ChildProcessError(_how(self._process.exitcode)) from None
        finally:
            if not self.stays:
                self._process.join()
                self._connection.close()
        if reply is None:
            raise MemoryError
        return reply


def _how(code: int | None) -> str:
    return f"was ended by {signal.Signals(-code).name}" if code and code < 0 else f"ended without a reply ({code=})"


def _serve(connection: Connection, of_parent: Connection) -> None:
    """Adjust the projects that come, until one has left traces, or none comes any more."""
    of_parent.close()
    import resource

    _leave_standard_streams()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    begin = _surroundings()
    for left in reversed(range(MOST_PROJECTS)):
        try:
            task: ProjectTask = connection.recv()
        except EOFError:
            return
        reply = _within_limits(task)
        gc.collect()
        stays = bool(left) and _ended_well(reply, task.settings.limits) and _surroundings() == begin
        connection.send((reply, stays))
        if not stays:
            return


def _leave_standard_streams() -> None:
    nowhere = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        os.dup2(nowhere, standard)
    os.close(nowhere)


@contextmanager
def _memory_limit(megabytes: int) -> Iterator[None]:
    """Let this process have so much memory within the block. What is told afterwards may take more."""
    import resource

    # data, not address space: libraries that are only mapped do not count
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (megabytes * _MEGABYTE, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _within_limits(task: ProjectTask) -> TaskReply | None:
    """Carry out a task with the memory that it may have; None if that is too little."""
    try:
        with _memory_limit(task.settings.limits.megabytes):
            return carry_out(task)
    except MemoryError:
        return None


def _ended_well(reply: TaskReply | None, limits: Limits) -> bool:
    if reply is None or reply.state != "adjusted":
        return False
    return (peak_megabytes() or 0.0) < LARGEST_SHARE * limits.megabytes


def _surroundings() -> tuple[object, ...]:
    """Return what a project could change for those after it in the same process."""
    umask = os.umask(0o077)
    os.umask(umask)
    numbers = np.random.get_state(legacy=False)["state"]  # noqa: NPY002  # orip has none; a library may
    return (
        Path.cwd(), umask, dict(os.environ), sorted(Path("/dev/fd").iterdir()), tempfile.tempdir,
        threading.active_count(), [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)],
        locale.setlocale(locale.LC_ALL), random.getstate(), numbers["key"].tobytes(), numbers["pos"], np.geterr(),
        list(warnings.filters), logging.root.level, logging.root.manager.disable, list(logging.root.handlers),
        gc.isenabled(), sys.getrecursionlimit(),
    )  # fmt: skip


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
