"""A process that has loaded orip once, and adjusts each project in a copy of itself (a fork) with limits.

It reads tasks from stdin and writes replies to stdout, both pickled, one at a time, and ends with its stdin: when the
worker that has started it is killed, so are this process and the project that it works on. It has a single thread, as
a process has to have that is copied: linear algebra is told so by the environment before it is loaded.
"""

from __future__ import annotations

import gc
import os
import pickle
import select
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from orip.archive.simulation import simulated_project
from orip.files.text.new_folder import write_new_folder
from orip.workflow.archive.task import ProjectTask, TaskReply, TaskSettings, carry_out, keep_over_limit
from orip.workflow.archive.worker import DIED, ENDED

_PIECE = 1 << 16
_MEGABYTE = 1 << 20


def main() -> None:
    """Serve until stdin ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program that handed out the tasks
    tasks, replies = _tasks(), sys.stdout.buffer
    first = next(tasks, None)
    if first is None:
        return
    _load_all(first.settings)
    gc.collect()
    gc.disable()  # a copy ends with its project, and looking for circles would copy the pages of all that is loaded
    for task in chain([first], tasks):
        pickle.dump(_adjusted_apart(task), replies)
        replies.flush()


def _tasks() -> Iterator[ProjectTask]:
    """Yield the tasks that come from stdin, until it ends."""
    while True:
        try:
            task: bytes = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        yield pickle.loads(task)


def _load_all(settings: TaskSettings) -> None:
    """Adjust a small project here, so that every module that a project needs is loaded before the copies are made.

    The less is loaded, the less a copy costs: method and reports are those of the first task.
    """
    import pyproj  # noqa: F401  # of projects with a crs

    with tempfile.TemporaryDirectory(prefix="orip-") as top:
        folder, results = Path(top, "project"), Path(top, "results")
        write_new_folder(folder, simulated_project(0, 0, 0.0).texts)
        plain = TaskSettings(settings.method, report=settings.report)
        carry_out(ProjectTask("loading", str(folder), str(results), plain))


def _adjusted_apart(task: ProjectTask) -> tuple[str, bytes]:
    """Carry out a task in a copy of this process; return how it ended, and the pickled reply or the reason."""
    reading, writing = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(reading)
        _as_copy(task, writing)
    os.close(writing)
    began = time.monotonic()
    reply = _reply(reading, process, task.settings.limits.seconds)
    os.close(reading)
    _, status = os.waitpid(process, 0)
    if reply is None:
        message = f"takes longer than {task.settings.limits.seconds:g} s; see --time"
        return ENDED, pickle.dumps(keep_over_limit(task, message, time.monotonic() - began))
    if not reply:
        return DIED, f"the process of the project {_how(status)}".encode()
    found = pickle.loads(reply)
    return (DIED, found.message.encode()) if found.state == "machine" else (ENDED, reply)


def _as_copy(task: ProjectTask, writing: int) -> None:
    """Adjust the project within its limits, reply, and end."""
    code = 1
    try:
        nowhere = os.open(os.devnull, os.O_RDWR)
        for standard in (0, 1, 2):
            os.dup2(nowhere, standard)
        reply = _within_limits(task)
        with os.fdopen(writing, "wb") as stream:
            pickle.dump(reply, stream)
        code = 0
    finally:
        os._exit(code)


def _within_limits(task: ProjectTask) -> TaskReply:
    """Carry out a task with the memory that it may have; what is written if that is too little may take more."""
    import resource

    megabytes, began = task.settings.limits.megabytes, time.monotonic()
    # data, not address space: libraries that are only mapped do not count
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_DATA, (megabytes * _MEGABYTE, hard))
    try:
        return carry_out(task)
    except MemoryError:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
    return keep_over_limit(task, f"needs more than {megabytes} MB of memory; see --memory", time.monotonic() - began)


def _reply(reading: int, process: int, seconds: float) -> bytes | None:
    """Return what a copy writes until it ends, nothing if it died; None if it was ended after so many seconds."""
    deadline = time.monotonic() + seconds
    pieces: list[bytes] = []
    while True:
        ready, _, _ = select.select([reading, sys.stdin.fileno()], [], [], max(0.0, deadline - time.monotonic()))
        if not ready or sys.stdin.fileno() in ready:  # requests come one at a time: this is the end of stdin
            os.kill(process, signal.SIGKILL)
            if ready:
                os._exit(1)
            return None
        piece = os.read(reading, _PIECE)
        if not piece:
            return b"".join(pieces)
        pieces.append(piece)


def _how(status: int) -> str:
    code = os.waitstatus_to_exitcode(status)
    return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended without a reply (exit code {code})"


if __name__ == "__main__":
    main()
