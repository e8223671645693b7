"""What a worker of Dask does: it hands each project to the fork server beside it."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading

from orip.archive.cluster.connection import UnfitWorkerError
from orip.version import __version__

_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")

_of_thread = threading.local()


ENDED, DIED = "ended", "died"
"""What a fork server says of a task, before the reply or the reason."""


class MachineFailureError(Exception):
    """A project ended by something that is not in it; the same may go well the next time."""


def run_project(version: str, task: bytes, *_waited_for: object) -> bytes:
    """Adjust a project in a process of its own.

    Task and reply pass through the worker as they are, which so need not load what they consist of.

    Parameters
    ----------
    version : str
        Of the orip that hands out the tasks.
    task : bytes
        A pickled `orip.archive.task.ProjectTask`.
    _waited_for : objects
        Replies to the tasks that had to be carried out before.

    Returns
    -------
    bytes
        A pickled `orip.archive.task.TaskReply`.

    Raises
    ------
    MachineFailureError
        If the process died, or the system refused something.
    UnfitWorkerError
        If this worker came later than the check of all workers, and has another orip.
    """
    if version != __version__:
        message = f"a worker has orip {__version__}, and this is {version}; install the same version on both"
        raise UnfitWorkerError(message)
    server = _server()
    try:
        how, reply = server.ask(task)
    except (EOFError, OSError, pickle.UnpicklingError) as error:
        server.close()
        message = f"the process that adjusts projects ended: {error or 'without a word'}"
        raise MachineFailureError(message) from None
    if how == DIED:
        raise MachineFailureError(reply.decode())
    return reply


class _Server:
    """The fork server of a thread; it ends with this process."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "orip.archive.fork_server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_ONE_THREAD},
            start_new_session=True,
        )

    def close(self) -> None:
        """End it, with the project that it works on."""
        self._process.kill()
        self._process.communicate()

    @property
    def is_running(self) -> bool:
        return self._process.poll() is None

    def ask(self, task: bytes) -> tuple[str, bytes]:
        requests, replies = self._process.stdin, self._process.stdout
        assert requests is not None
        assert replies is not None
        pickle.dump(task, requests)
        requests.flush()
        answer: tuple[str, bytes] = pickle.load(replies)
        return answer


def _server() -> _Server:
    server: _Server | None = getattr(_of_thread, "server", None)
    if server is None or not server.is_running:
        if server is not None:
            server.close()
        server = _of_thread.server = _Server()
    return server


# `run` finds the projects and hands them to the cluster; a worker asks the fork server beside it (`worker`,
# `fork_server`), whose copies adjust one project after the other (`project_process`) and write what is kept of each
# (`task`).
