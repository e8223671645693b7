"""What a worker of Dask has to have in common with the program that hands out tasks."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

from msgspec import Struct

from orip.version import __version__

_EXTENSIONS = ("orip.bundle.compiled._observation_loop", "orip.prelim._kernels")


class UnfitWorkerError(Exception):
    """A worker has another orip than the program that hands out the tasks."""


class WorkerFacts(Struct, frozen=True):
    """What a worker has to have in common with the program that hands out the tasks.

    Parameters
    ----------
    orip : str
        Version.
    is_compiled : bool
        The compiled loops are there.
    sees_files : bool
        The folder that client and workers share is there, under the same path.
    can_fork : bool
        The system copies processes.
    """

    orip: str
    is_compiled: bool
    sees_files: bool
    can_fork: bool


def worker_facts(marker: str) -> WorkerFacts:
    """Return the facts of this process; `marker` is the path of a file in the shared folder."""
    is_compiled = all(importlib.util.find_spec(name) is not None for name in _EXTENSIONS)
    return WorkerFacts(__version__, is_compiled, Path(marker).is_file(), hasattr(os, "fork"))
